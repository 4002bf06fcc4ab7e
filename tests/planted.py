"""`python tests/planted.py`: plant each fault of planted.toml in a copy of the code, and count the trials to find it.

A fault that `muro check random` does not find within the trials is a hole in the check. The table is for
docs/checking.md.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PACKAGES = ("muro_zenoh", "agents", "basestation")


class Planted(NamedTuple):
    """A fault of the code: in a ``file`` the text ``new`` stands in place of ``old``."""

    name: str
    file: str
    old: str
    new: str


def planted() -> list[Planted]:
    """All of planted.toml."""
    rows = tomllib.loads((ROOT / "tests" / "planted.toml").read_text(encoding="utf-8"))["fault"]
    return [Planted(**row) for row in rows]


def changed(fault: Planted, root: Path = ROOT) -> str:
    """The text of the file with the fault.

    Args:
        fault: the fault.
        root: of the code.

    Raises:
        ValueError: what is to be replaced does not occur exactly once: the code has changed, so must the list.
    """
    text = (root / fault.file).read_text(encoding="utf-8")
    if text.count(fault.old) != 1:
        raise ValueError(f"{fault.name}: got {text.count(fault.old)} times {fault.old!r} in {fault.file}, expected one")
    return text.replace(fault.old, fault.new)


def trials_to_find(fault: Planted, trials: int, jobs: int, seed: int) -> tuple[int, str]:
    """How many trials were run until the fault was found, and what it broke; 0 when it was not found.

    Args:
        fault: the fault.
        trials: how many at most.
        jobs: number of processes.
        seed: of the first trial.
    """
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder)
        for package in PACKAGES:
            shutil.copytree(ROOT / package, copy / package, ignore=shutil.ignore_patterns("__pycache__"))
        (copy / fault.file).write_text(changed(fault), encoding="utf-8")
        command = [sys.executable, "-m", "muro_zenoh", "check", "random", "--first", "--json", "found.json"]
        command += ["--trials", str(trials), "--jobs", str(jobs), "--seed", str(seed), "--out", "breach"]
        environment = {**os.environ, "PYTHONPATH": folder}
        done = subprocess.run(command, cwd=copy, env=environment, capture_output=True, text=True, check=False)
        if not (copy / "found.json").exists():
            raise RuntimeError(f"{fault.name}: {done.stderr}")
        found = json.loads((copy / "found.json").read_text())
        broken = [promise for promise, count in found["breaches"].items() if count]
        if found["unfinished"]:
            broken.append("finished")
        return (found["trials"] + found["replaced"], broken[0]) if broken else (0, "")


def main() -> int:
    """Print the table; 1 when a fault was not found."""
    parser = argparse.ArgumentParser(description="Plant faults in the code, and find them.")
    parser.add_argument("--trials", type=int, default=1000, help="at most so many for each")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes")
    parser.add_argument("--seed", type=int, default=1, help="of the first trial")
    parser.add_argument("--only", default="", help="those whose name has this in it")
    options = parser.parse_args()
    missed = 0
    print("| planted fault | found by trial | broken promise |\n|---|---|---|")
    for fault in planted():
        if options.only in fault.name:
            number, promise = trials_to_find(fault, options.trials, options.jobs, options.seed)
            missed += not number
            print(f"| {fault.name} | {number or f'not in {options.trials}'} | {promise or '-'} |", flush=True)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
