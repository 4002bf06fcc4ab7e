"""The door through which behaviours come in."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from agents.behaviours import BUILT_IN, check_behaviour, load_behaviour

from muro_zenoh.behaviours.entry_points import load_function
from muro_zenoh.errors import BehaviourError, ConfigError


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder on the path, for modules of the user's own."""
    monkeypatch.syspath_prepend(str(tmp_path))
    before = set(sys.modules)
    yield tmp_path
    for name in set(sys.modules) - before:
        del sys.modules[name]


def module(folder: Path, name: str, text: str) -> None:
    (folder / f"{name}.py").write_text(text)


@pytest.mark.parametrize("name", BUILT_IN)
def test_the_built_in_ones_come_through_the_same_door(name: str) -> None:
    assert load_behaviour(name) is load_behaviour(BUILT_IN[name])


def test_a_users_own_comes_in(lab: Path) -> None:
    module(lab, "swarm", "async def flock(robot):\n    robot.append('flocked')\n")
    done: list[str] = []
    asyncio.run(load_behaviour("swarm:flock")(done))  # type: ignore[arg-type]  # anything will do for a robot
    assert done == ["flocked"]


@pytest.mark.parametrize("name", ["", "fly", "Circle", "circle ", "agents.tasks.hold"])
def test_a_name_that_is_none_lists_those_that_are(name: str) -> None:
    with pytest.raises(BehaviourError, match=r"expected one of circle, pursuit, .* or your own as module:function"):
        load_behaviour(name)


def test_a_module_that_is_not_there_says_where_it_was_looked_for() -> None:
    with pytest.raises(BehaviourError, match=r"'nolab.swarm:flock': No module named 'nolab'; .*PYTHONPATH"):
        load_behaviour("nolab.swarm:flock")


@pytest.mark.parametrize("name", [":flock", "swarm:", "..swarm:flock", "sw arm:flock", ":", "swarm:flock:more"])
def test_half_a_name_is_an_error_that_names_it(name: str, lab: Path) -> None:
    module(lab, "swarm", "async def flock(robot): ...\n")
    with pytest.raises(BehaviourError, match=name):
        load_behaviour(name)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("x = 1\n", "module swarm has no function 'flock'"),
        ("import nothing_like_it\n", "No module named 'nothing_like_it'"),
        ("raise RuntimeError('no camera')\n", r"importing swarm failed: RuntimeError\('no camera'\)"),
        ("def flock(robot:\n", "importing swarm failed: SyntaxError"),
        ("raise SystemExit(3)\n", r"importing swarm failed: SystemExit\(3\)"),
        ("flock = 'birds'\n", "got 'birds', expected a function"),
        ("def flock(robot): ...\n", r"expected `async def f\(robot\)`"),
        ("async def flock(): ...\n", r"expected `async def f\(robot\)`"),
        ("async def flock(robot, more): ...\n", r"expected `async def f\(robot\)`"),
        ("class flock: ...\n", r"expected `async def f\(robot\)`"),
        ("async def flock(robot):\n    yield 1\n", r"expected `async def f\(robot\)`"),
        ("flock = print\n", r"expected `async def f\(robot\)`"),
    ],
)
def test_what_is_no_behaviour_says_why(lab: Path, text: str, reason: str) -> None:
    module(lab, "swarm", text)
    with pytest.raises(BehaviourError, match=reason):
        load_behaviour("swarm:flock")


def test_functions_that_settings_name_come_through_a_door_too() -> None:
    assert load_function("math:sqrt")(4.0) == 2.0
    with pytest.raises(BehaviourError, match="got 'sqrt', expected module:function"):
        load_function("sqrt")


@pytest.mark.parametrize(
    ("name", "parameters", "words"),
    [
        ("spiral", {}, ["lab.toml: behaviour.name", "'spiral'", "pursuit"]),
        ("nomod:fn", {}, ["lab.toml: behaviour.name", "'nomod:fn'", "nomod"]),
        ("pursuit", {"criuse": 0.2}, ["lab.toml: behaviour.criuse", "cruise"]),
        ("pursuit", {"cruise": 9.0}, ["lab.toml: behaviour", "v_max", "cruise 9.0"]),
        ("circle", {"law": "magic"}, ["lab.toml: behaviour", "'magic'", "vector_field"]),
        ("circle", {"speed": "fast"}, ["lab.toml: behaviour.speed", "'fast'", "[m/s]"]),
        ("dubins", {"v_min": -1.0}, ["lab.toml: behaviour.v_min", "-1", "above 0"]),
    ],
)
def test_what_no_robot_could_run_is_refused_before_anything_starts(
    name: str, parameters: dict[str, object], words: list[str]
) -> None:
    with pytest.raises(ConfigError) as refused:
        check_behaviour(name, parameters, "lab.toml")
    for word in words:
        assert word in str(refused.value)


def test_each_circle_law_takes_its_own_gains_from_the_settings() -> None:
    check_behaviour("circle", {"law": "lqr", "radial_size": 0.05, "heading_size": 0.3, "turn_size": 1.0}, "lab.toml")
    check_behaviour("circle", {"law": "passivity", "psi": 0.6}, "lab.toml")
    check_behaviour("circle", {"k_o": 10.0, "k_h": 2.0}, "lab.toml")
    with pytest.raises(ConfigError, match="psi"):
        check_behaviour("circle", {"law": "lqr", "psi": 0.6}, "lab.toml")


def test_every_built_in_behaviour_can_run_as_it_is() -> None:
    for name in BUILT_IN:
        check_behaviour(name, {}, "lab.toml")
