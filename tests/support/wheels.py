"""Wheels that tests build, and what is compiled in them."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
import zipfile
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from typing import Any

from tests.support.waiting import seconds

ROOT = Path(__file__).parents[2]


def build(root: Path, into: Path, target: str = "wheel", **variables: str) -> subprocess.CompletedProcess[str]:
    """Build a distribution with hatchling.

    Args:
        root: the folder to build from.
        into: the folder for the distribution.
        target: ``wheel`` or ``sdist``.
        variables: of the environment, besides ours.
    """
    command = [sys.executable, "-P", "-m", "hatchling", "build", "--target", target, "--directory", str(into)]
    environment = {**os.environ, **variables}
    return subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, timeout=seconds(120))


def unpacked_wheel(root: Path, into: Path, **variables: str) -> Path:
    """The folder with the files of a wheel that was built from a folder.

    Args:
        root: the folder to build from.
        into: an empty folder.
        variables: of the environment, besides ours.
    """
    built = build(root, into, **variables)
    assert built.returncode == 0, built.stderr + built.stdout
    (wheel,) = into.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(into / "files")
    return into / "files"


def mypyc_hook() -> dict[str, Any]:
    """The settings of the hook in pyproject.toml that compiles."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    hook: dict[str, Any] = settings["tool"]["hatch"]["build"]["targets"]["wheel"]["hooks"]["mypyc"]
    return hook


def to_compile() -> set[str]:
    """The sources that the hook compiles, as paths in the checkout."""
    included, excluded = (
        {str(path.relative_to(ROOT)) for pattern in mypyc_hook()[key] for path in ROOT.glob(pattern)}
        for key in ("include", "exclude")
    )
    return included - excluded


def compiled_in(folder: Path) -> set[str]:
    """The compiled modules in the packages in a folder, as paths of their sources.

    Args:
        folder: what has the packages in it.
    """
    files = (path for package in ("muro_zenoh", "agents", "basestation") for path in (folder / package).rglob("*"))
    found = (path.relative_to(folder) for path in files if path.name.endswith(tuple(EXTENSION_SUFFIXES)))
    return {str(path.with_name(path.name.split(".")[0] + ".py")) for path in found}
