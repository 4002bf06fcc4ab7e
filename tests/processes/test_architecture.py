"""``docs/architecture.md``: its pictures show the house that stands, and its recipes work as they stand there."""

from __future__ import annotations

import itertools
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.messages import VelocityCommand
from muro_zenoh.transport import open_bus
from tests.support.process import Process
from tests.support.router import router
from tests.support.waiting import seconds, within

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
PACKAGES = ("muro_zenoh", "agents", "basestation")


class Recipe(NamedTuple):
    """A recipe for an addition: to ``file``, by the page's ``snippets``, each with its language."""

    file: str
    snippets: list[tuple[str, str]]


def fenced(text: str) -> list[tuple[str, str]]:
    """The blocks of code in a text, each with its language."""
    return re.findall(r"^```(\w+)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def section(title: str) -> str:
    """The text under a heading of the page."""
    return PAGE.split(f"\n## {title}\n")[1].split("\n## ")[0]


def recipes() -> Iterator[tuple[str, Recipe]]:
    """The recipes of the page, by what is added."""
    for part in section("Where to add").split("\n### ")[1:]:
        heading, _, text = part.partition("\n")
        found = re.fullmatch(r"An? (\w+).*: .*`([^`]+)`", heading)
        assert found, f"{heading!r}: expected `A thing: the file`"
        yield found[1], Recipe(found[2], fenced(text))


RECIPES = dict(recipes())


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A copy of the packages and pages that can be extended."""
    for name in (*PACKAGES, "tests"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "docs").mkdir()
    shutil.copy(ROOT / "docs" / "channels.md", tmp_path / "docs")
    return tmp_path


def add(what: str, copy: Path) -> None:
    """Follow a recipe of the page in a copy."""
    recipe = RECIPES[what]
    path = copy / recipe.file
    for language, snippet in recipe.snippets:
        if language != "diff":
            assert not path.exists(), f"{recipe.file} is there already"
            path.write_text(snippet, encoding="utf-8")
            continue
        lines = snippet.splitlines(keepends=True)
        assert {line[0] for line in lines} == {" ", "+"}, "a recipe only adds"
        before = "".join(line[1:] for line in lines if line[0] == " ")
        after = "".join(line[1:] for line in lines)
        text = path.read_text(encoding="utf-8")
        assert text.count(before) == 1, f"{recipe.file} has no such place, or several:\n{before}"
        path.write_text(text.replace(before, after), encoding="utf-8")


def run(copy: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run Python in a copy, with the copy's packages."""
    return subprocess.run(
        [sys.executable, "-P", *arguments],
        cwd=copy,
        env={**os.environ, "PYTHONPATH": str(copy)},
        capture_output=True,
        text=True,
        timeout=seconds(60),
        check=False,
    )


# ---- the recipes


def test_there_is_a_recipe_for_everything_that_labs_add() -> None:
    assert set(RECIPES) == {"behaviour", "channel", "setting", "check", "camera", "base"}


@pytest.mark.parametrize("what", ["behaviour", "channel", "setting", "check", "camera"])
def test_what_the_recipe_adds_is_all_that_it_takes(what: str, copy: Path) -> None:
    missing = run(copy, "-m", "tests.processes.children.extended", what)
    assert missing.returncode != 0, f"a {what} is there without having been added: this proves nothing"
    add(what, copy)
    result = run(copy, "-m", "tests.processes.children.extended", what)
    assert result.returncode == 0, result.stdout + result.stderr


async def test_a_base_that_the_recipe_adds_obeys_commands(copy: Path) -> None:
    lab = copy / "lab.toml"
    lab.write_text('[robot.r1]\nbase = "ideal"\n', encoding="utf-8")
    command = ("-m", "muro_zenoh", "base", str(lab), "r1")
    refused = run(copy, *command)
    assert "lab: robot.r1.base: got 'ideal', expected one of simulated" in refused.stderr
    add("base", copy)
    with router() as there:
        connect = ("--connect", there.endpoint)
        with Process((*command, *connect), name="base", env={"PYTHONPATH": str(copy)}) as base:
            base.ready()
            async with open_bus(there.settings(), Role.AGENT) as bus:
                odometry = bus.latest(channels.ODOMETRY, "r1")
                wheels = bus.publisher(channels.CMD_VEL, "r1")

                async def turning() -> float:
                    while True:
                        wheels.put(VelocityCommand(v=0.0, omega=0.7))
                        omega = (await odometry.next()).message.omega
                        if omega != 0.0:
                            return omega

                assert await within(10.0, turning(), "odometry of wheels that turn") == 0.7


@pytest.mark.parametrize("what", ["behaviour", "base"])
def test_a_new_file_of_a_recipe_is_as_clean_as_the_rest(what: str, copy: Path) -> None:
    pytest.importorskip("ruff", reason="ruff is not installed")
    add(what, copy)
    shutil.copy(ROOT / "pyproject.toml", copy)
    for checker in (("ruff", "check"), ("ruff", "format", "--check")):
        result = run(copy, "-m", *checker, RECIPES[what].file)
        assert result.returncode == 0, result.stdout + result.stderr


# ---- the pictures


def enforced_floors() -> list[list[str]]:
    """The rooms on each floor, top down, as import-linter holds them."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    [layers] = [contract["layers"] for contract in contracts if contract["id"] == "layers"]
    return [[name.removeprefix("muro_zenoh.") for name in re.findall(r"[\w.]+", layer)] for layer in layers]


def test_the_house_has_the_floors_that_are_enforced() -> None:
    picture = fenced(section("The house"))[0][1]
    floors = enforced_floors()
    places = [[_place(picture, name) for name in floor] for floor in floors]
    for above, below in itertools.pairwise(places):
        assert max(above) < min(below), f"{picture}\n{floors}"
    for floor, at in zip(floors, places, strict=True):
        assert len({line for line, _ in at}) == 1, f"{floor} are on one floor"


def _place(picture: str, name: str) -> tuple[int, int]:
    """Line and column of a room in the picture."""
    for number, line in enumerate(picture.splitlines()):
        found = re.search(rf"(?:│|  ) {name}/?(?=  | │)", line) or re.search(rf"│ {name}/? ", line)
        if found:
            return number, found.start()
    raise AssertionError(f"{name} is not in the picture:\n{picture}")


def test_every_room_is_on_a_floor() -> None:
    rooms = {path.stem for path in (ROOT / "muro_zenoh").glob("[!_]*") if _is_code(path)}
    assert {name for floor in enforced_floors() for name in floor} == rooms | {"agents", "basestation"}


def _is_code(path: Path) -> bool:
    return path.suffix == ".py" or (path / "__init__.py").exists()


def test_the_files_in_the_picture_are_there() -> None:
    for found in re.finditer(r"│  (\w+(?:/|\.py))", fenced(section("The house"))[0][1]):
        assert any((ROOT / package / found[1]).exists() for package in ("agents", "basestation")), found[1]
    for path in re.findall(r"(?:agents|basestation)/[\w/]+\.py", section("The house")):
        assert (ROOT / path).is_file()


def test_every_channel_and_order_is_on_its_way() -> None:
    picture = fenced(section("The way of the data"))[0][1]
    orders = set(re.findall(r"\[(\w+)\]", picture))
    assert orders == {verb.word for verb in channels.VERBS}
    words = set(re.findall(r"\w+", re.sub(r"\[\w+\]", "", picture)))
    assert {channel.word for channel in channels.CHANNELS} <= words
