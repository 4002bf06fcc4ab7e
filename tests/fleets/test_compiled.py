"""The compiled build does what its source does, to the last bit, and never gets into a checkout."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tarfile
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from typing import Any

import pytest

from tests.support.c_compiler import lack
from tests.support.waiting import seconds
from tests.support.wheels import ROOT, build, compiled_in, to_compile, unpacked_wheel

WITHOUT_PAGE = {"MURO_WITHOUT_PAGE": "1"}

# A random trial; and the doorway, since random trials have no walls.
TRIALS = """
import json
from muro_zenoh import is_compiled
from muro_zenoh.checking.check import quiet
from muro_zenoh.checking.random_trial import random_trial
from muro_zenoh.checking.trial import run_trial
from muro_zenoh.config import find_scenario
with quiet():
    trials = [random_trial(3), find_scenario("doorway", overrides={"duration": 6.0})]
    digests = [run_trial(trial, 3)[1].digest for trial in trials]
print(json.dumps({"compiled": is_compiled(), "digests": digests}))
"""


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An unpacked source distribution of the checkout."""
    pytest.importorskip("hatchling", reason="no hatchling, which builds distributions: make setup")
    folder = tmp_path_factory.mktemp("sdist")
    built = build(ROOT, folder, "sdist", **WITHOUT_PAGE)
    assert built.returncode == 0, built.stderr
    (archive,) = folder.glob("*.tar.gz")
    with tarfile.open(archive) as tar:
        tar.extractall(folder, filter="data")
    (root,) = (path for path in folder.iterdir() if path.is_dir())
    return root


def test_a_wheel_is_compiled_on_demand_only(sources: Path, tmp_path: Path) -> None:
    """And a compiled module that somebody has left beside a source does not get into it."""
    left = sources / "muro_zenoh" / f"geometry{EXTENSION_SUFFIXES[0]}"
    left.touch()
    try:
        assert compiled_in(unpacked_wheel(sources, tmp_path, **WITHOUT_PAGE)) == set()
    finally:
        left.unlink()


@pytest.mark.parametrize("variable", ["HATCH_BUILD_HOOKS_ENABLE", "HATCH_BUILD_HOOK_ENABLE_MYPYC"])
def test_nothing_is_compiled_in_a_checkout(sources: Path, tmp_path: Path, variable: str) -> None:
    """Beside a source it would go on running when that is edited."""
    pytest.importorskip("hatch_mypyc", reason="no hatch-mypyc, which compiles: make setup")
    checkout = tmp_path / "checkout"
    shutil.copytree(sources, checkout, ignore=shutil.ignore_patterns("tests", "docs", "PKG-INFO"))
    refused = build(checkout, tmp_path, **{variable: "1"})
    assert refused.returncode != 0
    assert "`make compiled`" in refused.stderr
    assert (checkout / "pyproject.toml").is_file()
    assert compiled_in(checkout) == set()


def test_an_editable_install_is_never_compiled(sources: Path, tmp_path: Path) -> None:
    """Not from an unpacked source distribution either: its sources would be edited."""
    pytest.importorskip("hatch_mypyc", reason="no hatch-mypyc, which compiles: make setup")
    call = f"from hatchling.build import build_editable; build_editable({str(tmp_path)!r})"
    environment = {**os.environ, "HATCH_BUILD_HOOKS_ENABLE": "1"}
    refused = subprocess.run(
        [sys.executable, "-P", "-c", call],
        cwd=sources,
        env=environment,
        capture_output=True,
        text=True,
        timeout=seconds(30),
    )
    assert refused.returncode != 0
    assert "got an editable install" in refused.stderr
    assert compiled_in(sources) == set()


@pytest.mark.slow
def test_compiled_trials_are_those_of_the_source_to_the_last_bit(sources: Path, tmp_path: Path) -> None:
    pytest.importorskip("hatch_mypyc", reason="no hatch-mypyc, which compiles: make setup")
    if lack():
        pytest.skip(lack())
    root = tmp_path / "root"
    shutil.copytree(sources, root, ignore=shutil.ignore_patterns("tests", "docs"))
    # Optimising takes the compiler a minute. What it may do to results is the subject of `make compiled`.
    settings = root / "pyproject.toml"
    settings.write_text(settings.read_text(encoding="utf-8").replace('opt_level = "2"', 'opt_level = "0"'), "utf-8")
    files = unpacked_wheel(root, tmp_path, HATCH_BUILD_HOOKS_ENABLE="1", **WITHOUT_PAGE)
    assert compiled_in(files) == to_compile()
    source, compiled = trials(ROOT, tmp_path), trials(files, tmp_path)
    assert (source["compiled"], compiled["compiled"]) == (False, True)
    assert source["digests"] == compiled["digests"]


def trials(path: Path, folder: Path) -> dict[str, Any]:
    """What comes of the trials, in a process whose path has no other packages of ours."""
    command, environment = [sys.executable, "-P", "-c", TRIALS], {**os.environ, "PYTHONPATH": str(path)}
    ran = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=seconds(60), check=True
    )
    got: dict[str, Any] = json.loads(ran.stdout)
    return got
