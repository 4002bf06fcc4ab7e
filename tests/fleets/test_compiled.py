"""The compiled build does what its source does, to the last bit, and never gets into a checkout."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

import pytest

from muro_zenoh import is_compiled
from muro_zenoh.checking.check import quiet
from muro_zenoh.checking.random_trial import random_trial
from muro_zenoh.checking.trial import run_trial
from tests.support.waiting import seconds

ROOT = Path(__file__).parents[2]
SEEDS = (3,)

# In a process of its own, whose path has the wheel's files and not the checkout.
TRIALS = """
import json, sys
from muro_zenoh import is_compiled
from muro_zenoh.checking.check import quiet
from muro_zenoh.checking.random_trial import random_trial
from muro_zenoh.checking.trial import run_trial
with quiet():
    digests = [run_trial(random_trial(seed), seed)[1].digest for seed in map(int, sys.argv[1:])]
files = [module.__file__ for name, module in sys.modules.items() if name.startswith(("muro_zenoh.", "agents."))]
print(json.dumps({"compiled": is_compiled(), "digests": digests, "files": files}))
"""


def build(root: Path, into: Path, target: str, **variables: str) -> subprocess.CompletedProcess[str]:
    """Build a distribution with hatchling."""
    command = [sys.executable, "-P", "-m", "hatchling", "build", "--target", target, "--directory", str(into)]
    environment = {**os.environ, "MURO_WITHOUT_PAGE": "1", **variables}
    return subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, timeout=seconds(120))


def unpacked_wheel(root: Path, into: Path, **variables: str) -> Path:
    """The folder with the files of a wheel that was built from a folder."""
    built = build(root, into, "wheel", **variables)
    assert built.returncode == 0, built.stderr + built.stdout
    (wheel,) = into.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(into / "files")
    return into / "files"


def compiled_files(folder: Path) -> set[str]:
    """The compiled modules in a folder, as paths of their sources."""
    found = (path.relative_to(folder) for path in folder.rglob("*") if path.name.endswith(tuple(EXTENSION_SUFFIXES)))
    return {str(path.with_name(path.name.split(".")[0] + ".py")) for path in found}


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An unpacked source distribution of the checkout."""
    pytest.importorskip("hatchling", reason="no hatchling, which builds distributions: make setup")
    folder = tmp_path_factory.mktemp("sdist")
    built = build(ROOT, folder, "sdist")
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
        assert compiled_files(unpacked_wheel(sources, tmp_path)) == set()
    finally:
        left.unlink()


@pytest.mark.parametrize("variable", ["HATCH_BUILD_HOOKS_ENABLE", "HATCH_BUILD_HOOK_ENABLE_MYPYC"])
def test_nothing_is_compiled_in_a_checkout(sources: Path, tmp_path: Path, variable: str) -> None:
    """Beside a source it would go on running when that is edited."""
    pytest.importorskip("hatch_mypyc", reason="no hatch-mypyc, which compiles: make setup")
    checkout = tmp_path / "checkout"
    shutil.copytree(sources, checkout, ignore=shutil.ignore_patterns("tests", "docs", "PKG-INFO"))
    refused = build(checkout, tmp_path, "wheel", **{variable: "1"})
    assert refused.returncode != 0
    assert "`make compiled`" in refused.stderr
    assert (checkout / "pyproject.toml").is_file()
    assert compiled_files(checkout) == set()


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
    assert compiled_files(sources) == set()


@pytest.mark.slow
def test_compiled_trials_are_those_of_the_source_to_the_last_bit(sources: Path, tmp_path: Path) -> None:
    pytest.importorskip("hatch_mypyc", reason="no hatch-mypyc, which compiles: make setup")
    if shutil.which(os.environ.get("CC", "cc")) is None:
        pytest.skip("no C compiler; on Debian: apt-get install build-essential")
    if not Path(sysconfig.get_path("include"), "Python.h").exists():
        pytest.skip("no Python.h; on Debian: apt-get install python3-dev")
    assert not is_compiled()
    root = tmp_path / "root"
    shutil.copytree(sources, root, ignore=shutil.ignore_patterns("tests", "docs"))
    # Optimising takes the compiler a minute. What it may do to results is the subject of `make compiled`.
    settings = root / "pyproject.toml"
    settings.write_text(settings.read_text(encoding="utf-8").replace('opt_level = "2"', 'opt_level = "0"'), "utf-8")
    files = unpacked_wheel(root, tmp_path, HATCH_BUILD_HOOKS_ENABLE="1")

    environment = {**os.environ, "PYTHONPATH": str(files)}
    command = [sys.executable, "-P", "-c", TRIALS, *map(str, SEEDS)]
    ran = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=seconds(60), check=True
    )
    got = json.loads(ran.stdout)
    imported = {str(Path(file).relative_to(files)) for file in got["files"]}
    suffix = EXTENSION_SUFFIXES[0]
    compiled = {name for name in imported if name.endswith(suffix)}
    assert {f"muro_zenoh/safety/separation/filter{suffix}", f"agents/control_loop{suffix}"} <= compiled
    assert got["compiled"]
    with quiet():
        assert got["digests"] == [run_trial(random_trial(seed), seed)[1].digest for seed in SEEDS]
