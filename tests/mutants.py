"""`make mutants`: break the modules that keep robots from driving, one line at a time, and see a test fail.

mutmut breaks what is inside functions; its modules and tests are in ``[tool.mutmut]`` of pyproject.toml. Here the
constants of those modules are broken too (a limit of 0.3 s becomes 0.24 and 0.375 s), which mutmut leaves alone. What
survives must be explained in mutants.toml. The report is ``mutants/report.md``.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[1]
COPY = ROOT / "mutants"
FATES = ("killed", "types", "timeout", "survived")
TIMEOUT = 120.0
"""Tests with a broken constant take this long at most [s]."""


class Mutant(NamedTuple):
    """One change and what came of it: ``name`` of the function or constant; the lines ``old`` and ``new``, stripped;
    ``fate``, one of :data:`FATES`."""

    module: str
    name: str
    old: str
    new: str
    fate: str


def main() -> int:
    """Run all, print and write the report; 1 when a survivor is not explained, or an explanation is out of use."""
    parser = argparse.ArgumentParser(description="Break the code and see a test fail.")
    parser.add_argument("module", nargs="?", default="", help="only modules whose path has this in it")
    parser.add_argument("--jobs", type=int, default=1, help="how many at a time")
    options = parser.parse_args()
    os.chdir(ROOT)
    patterns = tomllib.loads(Path("pyproject.toml").read_text())["tool"]["mutmut"]["only_mutate"]
    paths = sorted(str(path) for pattern in patterns for path in Path().glob(pattern))
    modules = [path for path in paths if options.module in path and path.removesuffix("__init__.py") == path]
    if not modules:
        print(f"got {options.module!r}, expected a part of one of: {', '.join(paths)}")
        return 2
    shutil.rmtree(COPY, ignore_errors=True)
    names = [f"{dotted(path)}.*" for path in modules] if options.module else []
    # The same examples each time, or a survivor would be a matter of luck.
    subprocess.run(
        ["mutmut", "run", f"--max-children={options.jobs}", *names], check=True, env={**os.environ, "CI": "true"}
    )
    found = {path: [*of_functions(path), *of_constants(path)] for path in modules}
    report, ok = judge(found, complete=not options.module)
    (COPY / "report.md").write_text(report)
    print(report)
    return 0 if ok else 1


def dotted(path: str) -> str:
    """The module's name."""
    return path.removesuffix(".py").replace("/", ".")


def of_functions(path: str) -> Iterator[Mutant]:
    """What mutmut found in a module."""
    from mutmut.mutation.diff_apply import get_diff_for_mutant
    from mutmut.stats import status_by_exit_code

    codes = json.loads((COPY / f"{path}.meta").read_text())["exit_code_by_key"]
    for key, code in codes.items():
        status = status_by_exit_code[code]
        fate = {"killed": "killed", "caught by type check": "types", "timeout": "timeout"}.get(status, "survived")
        old, new = sides(get_diff_for_mutant(key, path=path)) if fate == "survived" else ("", "")
        yield Mutant(
            path, key.rpartition("__mutmut_")[0].rpartition(".")[2].lstrip("xǁ_").replace("ǁ", "."), old, new, fate
        )


def sides(diff: str) -> tuple[str, str]:
    """The lines that a diff takes away, and those that it puts there."""
    lines = [line for line in diff.splitlines() if not line.startswith(("---", "+++"))]
    lines = [re.sub(r"  # .*", "", line) for line in lines]  # a comment may be reworded
    old, new = ([line[1:].strip() for line in lines if line.startswith(sign)] for sign in "-+")
    return " ".join(old), " ".join(new)


def of_constants(path: str) -> Iterator[Mutant]:
    """Each numeric constant of a module, made smaller and larger in the copy, with the tests that use the module."""
    stats = json.loads((COPY / "mutmut-stats.json").read_text())
    uses = stats["tests_by_mangled_function_name"].items()
    tests = {test for function, names in uses if function.startswith(f"{dotted(path)}.x") for test in names}
    # Without their parameters, which may be made of the very constant.
    quickest = list(dict.fromkeys(test.partition("[")[0] for test in sorted(tests, key=stats["duration_by_test"].get)))
    copy = COPY / path
    source = copy.read_text()
    for name, value, code in constants(source):
        for new in neighbours(value):
            copy.write_text(source.replace(code, f"{code.partition('=')[0]}= {new!r}", 1))
            yield Mutant(path, name, f"{name} = {value!r}", f"{name} = {new!r}", fate_of(quickest))
    copy.write_text(source)


def constants(source: str) -> Iterator[tuple[str, float, str]]:
    """The numeric constants of a module: name, value, and the statement."""
    for node in ast.parse(source).body:
        target = node.targets[0] if isinstance(node, ast.Assign) else getattr(node, "target", None)
        value: Any = getattr(node, "value", None)
        if isinstance(target, ast.Name) and value is not None:
            try:
                number = eval(compile(ast.Expression(value), target.id, "eval"), {"__builtins__": {}})
            except (NameError, TypeError):
                continue  # made of other modules' constants
            if isinstance(number, int | float) and not isinstance(number, bool):
                yield target.id, number, ast.get_source_segment(source, node) or ""


def neighbours(value: float) -> tuple[float, float]:
    """What a constant becomes: a fifth less and a quarter more; a small count one less and one more."""
    if isinstance(value, int):
        return (value - 1, value + 1) if value < 10 else (value * 4 // 5, value * 5 // 4)
    return 0.8 * value, 1.25 * value


def fate_of(tests: list[str]) -> str:
    """What becomes of the copy as it is now."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests]
    environment = {**os.environ, "CI": "true", "PYTHONPATH": str(COPY), "PYTHONDONTWRITEBYTECODE": "1"}
    environment["MUTANT_UNDER_TEST"] = ""
    try:
        done = subprocess.run(command, cwd=COPY, env=environment, capture_output=True, timeout=TIMEOUT, check=False)
    except subprocess.TimeoutExpired:
        return "timeout"
    if done.returncode not in (0, 1, 2):  # passed, failed, failed at the import
        raise RuntimeError(f"got exit code {done.returncode} of pytest, expected 0, 1 or 2: {done.stdout.decode()}")
    return "survived" if done.returncode == 0 else "killed"


def judge(found: dict[str, list[Mutant]], complete: bool) -> tuple[str, bool]:
    """The report, and whether every survivor is explained and every explanation is of use.

    Args:
        found: the mutants of each module.
        complete: all modules were run, so that an explanation that fits nothing is out of date.
    """
    explained = tomllib.loads(Path("tests/mutants.toml").read_text())["explained"]
    reasons = {(e["module"], e["line"], becomes): e["reason"] for e in explained for becomes in e["becomes"]}
    unused = set(reasons)
    rows = [
        "| module | mutants | killed by tests | by types | timeout | survived | explained |",
        "|---" * 7 + "|",
    ]
    left: list[Mutant] = []
    totals: Counter[str] = Counter()
    for path, mutants in found.items():
        counts = Counter(mutant.fate for mutant in mutants)
        for mutant in mutants:
            if mutant.fate == "survived":
                key = (mutant.module, mutant.old, mutant.new)
                unused.discard(key)
                counts["explained"] += key in reasons
                if key not in reasons:
                    left.append(mutant)
        counts["all"] = len(mutants)
        totals += counts
        rows.append(row(path, counts))
    rows.append(row("all", totals))
    lines = [*rows, ""]
    for mutant in left:
        lines += [f"not explained: {mutant.module} {mutant.name}", f"    - {mutant.old}", f"    + {mutant.new}"]
    if complete:
        lines += [f"an explanation that fits nothing: {module}: {old} -> {new}" for module, old, new in sorted(unused)]
    return "\n".join(lines) + "\n", not left and not (complete and unused)


def row(name: str, counts: Counter[str]) -> str:
    """A line of the table."""
    return "| " + " | ".join([name, *(str(counts[key]) for key in ("all", *FATES, "explained"))]) + " |"


if __name__ == "__main__":
    sys.exit(main())
