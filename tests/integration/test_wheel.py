"""The wheel has all of the page: somebody who installs it has no npm, and the page loads nothing from the internet."""

from __future__ import annotations

import re
import shutil
from pathlib import Path, PurePosixPath

import pytest

from tests.support.browser import STATIC
from tests.support.wheels import ROOT, build, unpacked_wheel

PAGE = PurePosixPath(STATIC.relative_to(ROOT))


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The files of a wheel that was built from here, by their names."""
    pytest.importorskip("hatchling", reason="no hatchling, which builds wheels: make setup")
    if not (STATIC / "vendor" / "msgpack.min.js").exists():
        pytest.skip("the page's libraries are not installed: make setup")
    files = unpacked_wheel(ROOT, tmp_path_factory.mktemp("wheel"))
    return {str(path.relative_to(files)): path.read_bytes() for path in files.rglob("*") if path.is_file()}


def test_a_wheel_has_all_that_the_page_loads(wheel: dict[str, bytes]) -> None:
    """From index.html on: what it links to, and what the modules import."""
    found: set[str] = set()
    waiting = ["index.html"]
    while waiting:
        name = waiting.pop()
        if name in found:
            continue
        found.add(name)
        text = wheel[str(PAGE / name)].decode()
        if name.endswith(".html"):
            waiting += re.findall(r'(?:src|href)="([^"#]+)"', text)
        elif name.endswith(".js") and not name.startswith("vendor/"):
            waiting += re.findall(r'from "\./([^"]+)"', text)
    assert {"main.js", "driving.js", "vendor/msgpack.min.js", "vendor/uPlot.iife.min.js"} <= found
    types_only = {"protocol.js"}
    assert {path.name for path in STATIC.glob("*.*")} - types_only == {name for name in found if "/" not in name}


def test_no_wheel_is_built_without_what_the_page_loads(tmp_path: Path) -> None:
    pytest.importorskip("hatchling", reason="no hatchling, which builds wheels: make setup")
    for name in ("hatch_build.py", "pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tmp_path)
    for package in ("muro_zenoh", "agents", "basestation"):
        (tmp_path / package).mkdir()
        (tmp_path / package / "__init__.py").touch()
    (tmp_path / PAGE).mkdir(parents=True)
    shutil.copy(STATIC / "index.html", tmp_path / PAGE)
    refused = build(tmp_path, tmp_path)
    assert refused.returncode != 0
    assert "run `make setup` first" in refused.stderr
    assert "vendor/msgpack.min.js" in refused.stderr
    assert build(tmp_path, tmp_path, MURO_WITHOUT_PAGE="1").returncode == 0


def test_a_wheel_has_the_licences_of_the_libraries_in_it(wheel: dict[str, bytes]) -> None:
    for library in ("msgpack", "uPlot"):
        assert b"Permission" in wheel[str(PAGE / "vendor" / f"{library}.LICENSE")]
