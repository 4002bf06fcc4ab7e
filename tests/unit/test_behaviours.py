"""The table of behaviours, and how settings and users' modules name them."""

from __future__ import annotations

import ast
import asyncio
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from muro_zenoh.behaviours import table
from muro_zenoh.behaviours.entry_points import load_function
from muro_zenoh.behaviours.interface import BehaviourKind
from muro_zenoh.behaviours.table import OwnBehaviour
from muro_zenoh.config import check_behaviour, check_settings, parse_scenario
from muro_zenoh.control.circle import circle_law
from muro_zenoh.errors import BehaviourError, ConfigError
from muro_zenoh.geometry import Circle

ROOT = Path(__file__).parents[2]
FLEET = [parse_scenario({"robots": 5}, "lab.toml", name="lab").vehicle(f"r{k + 1}") for k in range(5)]
CIRCLE = Circle(0.0, 0.0, 0.8)


def refuse(name: str, parameters: dict[str, object], circle: Circle = CIRCLE) -> None:
    """Check a behaviour as a base station and a run do before anything starts."""
    check_settings(name, parameters, "lab.toml", FLEET, circle)
    check_behaviour(name, parameters, "lab.toml", FLEET)


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder on Python's path, for a user's modules."""
    monkeypatch.syspath_prepend(str(tmp_path))
    before = set(sys.modules)
    yield tmp_path
    for name in set(sys.modules) - before:
        del sys.modules[name]


def module(folder: Path, name: str, text: str) -> None:
    (folder / f"{name}.py").write_text(text)


@pytest.mark.parametrize("name", table.names())
def test_each_file_of_the_package_is_a_behaviour_of_that_name(name: str) -> None:
    kind = table.find(name)
    assert isinstance(kind, BehaviourKind)
    assert kind.summary
    assert kind.make.__module__ == f"muro_zenoh.behaviours.{name}"
    assert (Path(table.__file__).parent / f"{name}.py").is_file()


def test_the_behaviours_of_the_reports_exist() -> None:
    assert set(table.names()) >= {"circle", "pursuit", "dubins", "coverage", "steer", "hold"}
    assert table.DEFAULT == "hold"


def test_a_users_function_is_found(lab: Path) -> None:
    module(lab, "swarm", "async def flock(robot):\n    robot.append('flocked')\ndef still(robot):\n    return 0, 0\n")
    found: list[str] = []
    flock, still = table.find("swarm:flock"), table.find("swarm:still")
    assert isinstance(flock, OwnBehaviour)
    assert isinstance(still, OwnBehaviour)
    assert (flock.is_async, still.is_async) == (True, False)
    asyncio.run(flock.function(found))
    assert found == ["flocked"]


@pytest.mark.parametrize("name", ["", "fly", "Circle", "circle ", "muro_zenoh.behaviours.hold", "table"])
def test_an_unknown_name_lists_the_known_ones(name: str) -> None:
    with pytest.raises(BehaviourError, match=r"expected one of circle, coverage, .* or your own as module:function"):
        table.find(name)


def test_a_missing_module_is_reported_with_the_search_path() -> None:
    with pytest.raises(BehaviourError, match=r"^No module named 'nolab'; .*PYTHONPATH"):
        table.find("nolab.swarm:flock")


@pytest.mark.parametrize("name", [":flock", "swarm:", "..swarm:flock", "sw arm:flock", ":", "swarm:flock:more"])
def test_a_malformed_name_is_reported(name: str, lab: Path) -> None:
    module(lab, "swarm", "async def flock(robot): ...\n")
    with pytest.raises(BehaviourError, match=name):
        table.find(name)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("x = 1\n", "module swarm has no function 'flock'"),
        ("import nothing_like_it\n", "No module named 'nothing_like_it'"),
        ("raise RuntimeError('no camera')\n", r"importing swarm failed: RuntimeError\('no camera'\)"),
        ("def flock(robot:\n", "importing swarm failed: SyntaxError"),
        ("raise SystemExit(3)\n", r"importing swarm failed: SystemExit\(3\)"),
        ("flock = 'birds'\n", "got 'birds', expected a function"),
        ("def flock(robot):\n    yield 1\n", r"expected `def f\(robot\)` or"),
        ("async def flock(): ...\n", r"expected `def f\(robot\)` or `async def f\(robot\)`"),
        ("async def flock(robot, more): ...\n", r"expected `def f\(robot\)` or `async def f\(robot\)`"),
        ("class flock: ...\n", r"expected `def f\(robot\)` or `async def f\(robot\)`"),
        ("async def flock(robot):\n    yield 1\n", r"expected `def f\(robot\)` or `async def f\(robot\)`"),
        ("flock = print\n", r"expected `def f\(robot\)` or `async def f\(robot\)`"),
    ],
)
def test_an_invalid_behaviour_is_reported_with_the_reason(lab: Path, text: str, reason: str) -> None:
    module(lab, "swarm", text)
    with pytest.raises(BehaviourError, match=reason) as error:
        table.find("swarm:flock")
    assert "swarm:flock'" not in str(error.value), "who reports it has named the behaviour"


def test_a_function_named_in_settings_is_loaded() -> None:
    assert load_function("math:sqrt")(4.0) == 2.0
    with pytest.raises(BehaviourError, match="got 'sqrt', expected module:function"):
        load_function("sqrt")


@pytest.mark.parametrize(
    ("name", "parameters", "words"),
    [
        ("spiral", {}, ["lab.toml: behaviour.name", "'spiral'", "pursuit"]),
        ("nomod:fn", {}, ["lab.toml: behaviour.name", "'nomod:fn'", "nomod"]),
        ("pursuit", {"criuse": 0.2}, ["lab.toml: behaviour.criuse", "cruise"]),
        ("pursuit", {"cruise": 9.0}, ["lab.toml: behaviour.cruise", "v_max", "got 9"]),
        ("circle", {"law": "magic"}, ["lab.toml: behaviour.law", "'magic'", "vector_field"]),
        ("dubins", {"v_min": 0.5}, ["lab.toml: behaviour", "v_min", "v_max"]),
        ("dubins", {"v_min": 0.6, "v_max": 0.7}, ["lab.toml: behaviour.v_min", "at most the v_max of robot r1"]),
        ("dubins", {"goals": [[9.0, 0.0]]}, ["lab.toml: behaviour.goals[0]", "(9, 0)", "outside the arena"]),
        ("steer", {"goals": [[1.0]]}, ["lab.toml: behaviour.goals[0]", "1 numbers"]),
        ("pursuit", {"pursuit": "importance"}, ["lab.toml: behaviour", "weights", "0 angles"]),
        ("pursuit", {"pursuit": "importance", "importance": "nolab:w"}, ["lab.toml: behaviour", "nolab"]),
        ("coverage", {"peaks": [[1.0, 2.0]]}, ["lab.toml: behaviour.peaks[0]", "2 numbers"]),
        ("circle", {"speed": "fast"}, ["lab.toml: behaviour.speed", "'fast'", "[m/s]"]),
        ("circle", {"law": "lqr", "radial_size": 5e-324}, ["lab.toml: behaviour.radial_size", "5e-324", "0.001 [m]"]),
        ("circle", {"law": "lqr", "turn_size": 5e-324}, ["lab.toml: behaviour.turn_size", "0.001 [rad/s]"]),
        ("circle", {"law": "lqr", "heading_size": 1e-300}, ["lab.toml: behaviour.heading_size", "0.001 [rad]"]),
        ("dubins", {"turning_radius": 1e-13}, ["lab.toml: behaviour.turning_radius", "1e-13", "0.001 [m]"]),
        ("dubins", {"v_min": -1.0}, ["lab.toml: behaviour.v_min", "-1", "above 0"]),
    ],
)
def test_invalid_parameters_are_refused_before_anything_starts(
    name: str, parameters: dict[str, object], words: list[str]
) -> None:
    with pytest.raises(ConfigError) as refused:
        refuse(name, parameters)
    for word in words:
        assert word in str(refused.value)


@pytest.mark.parametrize("parameters", [{"turn_size": 0.001}, {"radial_size": 0.001}, {"heading_size": 1e-3}])
def test_the_least_sizes_of_the_lqr_give_a_finite_twist(parameters: dict[str, Any]) -> None:
    law = circle_law("lqr", **parameters)
    for v in (0.0, 1e-9, 0.3):
        for radius in (0.001, 0.8, 100.0):
            assert math.isfinite(law(0.1, 0.0, 0.3, v, Circle(0.0, 0.0, radius)))


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("raise RuntimeError('no table')", r"got RuntimeError\('no table'\) at angle 0.0000 rad, expected a finite"),
        ("raise SystemExit(2)", r"got SystemExit\(2\) at angle 0.0000 rad"),
        ("return None", r"got TypeError\(.*\) at angle 0.0000 rad"),
        ("return 10**400", r"got OverflowError\(.*\) at angle 0.0000 rad"),
    ],
)
def test_an_importance_that_raises_is_refused_with_its_error(lab: Path, body: str, said: str) -> None:
    module(lab, "lab_importance", f"def weight(angle):\n    {body}\n")
    with pytest.raises(ConfigError, match=said):
        refuse("pursuit", {"pursuit": "importance", "importance": "lab_importance:weight"})


def test_each_circle_law_takes_its_own_gains_from_the_settings() -> None:
    refuse("circle", {"law": "lqr", "radial_size": 0.05, "heading_size": 0.3, "turn_size": 1.0})
    refuse("circle", {"law": "passivity", "psi": 0.6})
    refuse("circle", {"k_o": 10.0, "k_h": 2.0})
    with pytest.raises(ConfigError, match="psi"):
        refuse("circle", {"law": "lqr", "psi": 0.6})


def test_every_built_in_behaviour_runs_with_its_defaults() -> None:
    for name in table.names():
        refuse(name, {})


def test_a_circle_too_small_for_the_robots_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"lab.toml: circle.radius: got 5 robots on a circle of 0.2 m, .* 0.35 m"):
        refuse("pursuit", {}, Circle(0.0, 0.0, 0.2))
    with pytest.raises(ConfigError, match="got 5 robots on a circle"):
        refuse("circle", {}, Circle(0.0, 0.0, 0.2))
    with pytest.raises(ConfigError, match=r"lab.toml: circle.radius: got 1.4 m around \(0, 0\)"):
        refuse("circle", {}, Circle(0.0, 0.0, 1.4))


def test_a_behaviour_is_named_in_its_own_file_only() -> None:
    """By its name as a text, wherever a behaviour is meant; "circle" is also a channel's and a section's,
    "coverage" a row of the score sheet."""
    other_meanings = {
        "muro_zenoh/channels": {"circle"},
        "muro_zenoh/config": {"circle"},
        "muro_zenoh/cli": {"circle", "coverage"},
        "muro_zenoh/scoring": {"coverage"},
        "basestation/dashboard": {"circle"},
        "muro_zenoh/checking/summary.py": {"coverage"},
        "muro_zenoh/checking/random_trial.py": set(table.names()),  # it draws their parameters
        "muro_zenoh/behaviours/interface.py": {"circle"},
    }
    found = []
    for package in ("muro_zenoh", "agents", "basestation"):
        for path in (ROOT / package).rglob("*.py"):
            relative = str(path.relative_to(ROOT))
            allowed = {name for start, words in other_meanings.items() if relative.startswith(start) for name in words}
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                name = node.value if isinstance(node, ast.Constant) else None
                if isinstance(name, str) and name in table.names() and name not in allowed:
                    found.append(f"{relative}:{node.lineno}: {name!r}")
    assert not found


def test_a_behaviour_is_imported_by_those_who_build_on_it_only() -> None:
    """All others go through the table. These use one behaviour as a part, whichever the robots run: a robot's methods
    ``velocity`` and ``goal`` are circle following and a ride; the rollout of circle following steps that behaviour;
    the base station refuses a circle without room for the robots even while none of them follows it.
    """
    allowed = {
        "agents/robot.py": {"circle", "dubins"},
        "muro_zenoh/simulation/rollout/runs.py": {"circle"},
        "basestation/fleet/kept_state.py": {"circle"},
    }
    home = Path(table.__file__).parent
    found: dict[str, set[str]] = {}
    for package in ("muro_zenoh", "agents", "basestation"):
        for path in (ROOT / package).rglob("*.py"):
            named = _imported_behaviours(path.read_text(encoding="utf-8"))
            if named and (path.parent != home or path.stem not in table.names()):
                found[path.relative_to(ROOT).as_posix()] = named
    table_file = found.pop("muro_zenoh/behaviours/table.py")
    assert table_file == {table.DEFAULT}
    assert found == allowed


def _imported_behaviours(text: str) -> set[str]:
    modules: set[str] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            modules.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            modules.update(f"{node.module}.{alias.name}" for alias in node.names)
    package = "muro_zenoh.behaviours."
    words = {name.removeprefix(package).partition(".")[0] for name in modules if name.startswith(package)}
    return words & set(table.names())


def test_imports_of_behaviours_are_found_in_each_of_their_forms() -> None:
    forms = [
        "from muro_zenoh.behaviours import hold, table",
        "from muro_zenoh.behaviours.circle import CircleFollowing",
    ]
    assert [_imported_behaviours(text) for text in forms] == [{"hold"}, {"circle"}]
    assert _imported_behaviours("def f():\n    import muro_zenoh.behaviours.dubins as d") == {"dubins"}
