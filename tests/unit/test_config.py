"""Settings: right ones are read, wrong ones are refused with the file, the full key, what was got and expected."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from muro_zenoh import channels
from muro_zenoh.config import (
    TIMEOUTS,
    BehaviourSettings,
    Checks,
    RobotSettings,
    Scenario,
    Section,
    Timeouts,
    as_table,
    load_scenario,
    parameters_as,
    parse_scenario,
)
from muro_zenoh.config.sections import BusSettings
from muro_zenoh.config.writing import as_toml
from muro_zenoh.errors import ConfigError
from muro_zenoh.geometry import Circle
from muro_zenoh.quantities import Speed, quantities
from muro_zenoh.scoring.checks import CHECKS
from muro_zenoh.walls import Wall

ROOT = Path(__file__).parents[2]
BUILT_IN = sorted((ROOT / "muro_zenoh" / "scenarios").glob("*.toml"))
DEPLOYED = sorted((ROOT / "deploy").glob("*.toml"))


def parse(table: dict[str, Any], robots: int | None = None) -> Scenario:
    return parse_scenario(table, "lab.toml", name="lab", robots=robots)


def write(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


# ---- what is right


@pytest.mark.parametrize("path", [*BUILT_IN, *DEPLOYED], ids=lambda path: path.stem)
def test_the_files_that_we_ship_are_valid(path: Path) -> None:
    assert load_scenario(path).robot


@pytest.mark.parametrize("path", [*BUILT_IN, *DEPLOYED], ids=lambda path: path.stem)
def test_a_scenario_can_be_passed_to_a_process(path: Path) -> None:
    scenario = load_scenario(path)
    assert parse_scenario(as_table(scenario), "run.json", name=scenario.name) == scenario


def test_an_empty_file_is_a_lab_of_one_stationary_robot() -> None:
    lab = parse({})
    assert lab.robots == ("r1",)
    assert lab.behaviour == BehaviourSettings(name="hold")


def test_a_robots_settings_cascade() -> None:
    lab = parse({"all": {"radius": 0.2, "v_max": 0.4}, "robot": {"r1": {"tag": 1}, "r2": {"tag": 2, "v_max": 0.3}}})
    assert lab.robot["r1"] == RobotSettings(tag=1, radius=0.2, v_max=0.4)
    assert lab.robot["r2"] == RobotSettings(tag=2, radius=0.2, v_max=0.3)


@pytest.mark.parametrize(("given_", "asked", "names"), [(None, 3, 3), (4, None, 4), (4, 2, 2), (None, None, 1)])
def test_robots_are_made_from_all(given_: int | None, asked: int | None, names: int) -> None:
    lab = parse({} if given_ is None else {"robots": given_}, robots=asked)
    assert lab.robots == tuple(f"r{i + 1}" for i in range(names))
    assert [robot.tag for robot in lab.robot.values()] == list(range(names))


def test_of_named_robots_the_first_are_used() -> None:
    table = {"robot": {"anna": {"tag": 4}, "bert": {"tag": 2}, "carl": {"tag": 9}}}
    assert parse(table, robots=2).robots == ("anna", "bert")


def test_the_keys_of_a_behaviour_are_its_parameters() -> None:
    behaviour = parse({"behaviour": {"name": "mylab.swarm:flock", "speed": 0.1, "turns": [1, 2.5]}}).behaviour
    assert behaviour.name == "mylab.swarm:flock"
    assert behaviour.parameters == {"speed": 0.1, "turns": (1, 2.5)}


def test_a_scenario_may_name_a_fleet_file(tmp_path: Path) -> None:
    write(tmp_path, "lab.toml", "[all]\nradius = 0.1\nv_max = 0.3\n[robot.anna]\ntag = 7\n[arena]\nx_max = 3.0\n")
    path = write(tmp_path, "run.toml", 'fleet = "lab.toml"\n[all]\nv_max = 0.2\n[arena]\ny_max = 2.0\n')
    lab = load_scenario(path)
    assert lab.name == "run"
    assert lab.robot == {"anna": RobotSettings(tag=7, radius=0.1, v_max=0.2)}
    assert (lab.arena.x_max, lab.arena.y_max, lab.arena.x_min) == (3.0, 2.0, -2.1)


def test_the_walls_are_the_scenario_s_own_and_those_of_the_fleet_file(tmp_path: Path) -> None:
    write(tmp_path, "lab.toml", "[[wall]]\nstart = [0.0, -1.5]\nend = [0.0, -0.4]\n")
    lab = load_scenario(write(tmp_path, "run.toml", 'fleet = "lab.toml"\nduration = 5\n'))
    assert lab.walls == (Wall(0.0, -1.5, 0.0, -0.4),)
    assert (
        parse(as_table(lab)).walls == parse(tomllib.loads(as_toml(lab))).walls == lab.vehicle("r1").walls == lab.walls
    )
    own = 'fleet = "lab.toml"\n[[wall]]\nstart = [1, 1]\nend = [1, 0]\n'
    both = load_scenario(write(tmp_path, "own.toml", own))
    assert both.walls == (Wall(1.0, 1.0, 1.0, 0.0), Wall(0.0, -1.5, 0.0, -0.4))
    assert load_scenario(tmp_path / "own.toml", overrides={"wall": []}).walls == ()


def test_an_error_in_a_wall_names_the_file_that_has_it_and_its_row_there(tmp_path: Path) -> None:
    right, outside = "[[wall]]\nstart = [1, 1]\nend = [1, 0]\n", "[[wall]]\nstart = [0.0, -1.6]\nend = [0.0, -0.4]\n"
    none = write(tmp_path, "none.toml", 'fleet = "lab.toml"\n')
    own = write(tmp_path, "own.toml", f'fleet = "lab.toml"\n{right}{right}')
    wrong = write(tmp_path, "wrong.toml", f'fleet = "lab.toml"\n{right}{outside}')
    write(tmp_path, "lab.toml", right + outside)
    for path in (none, own):
        with pytest.raises(ConfigError, match=r"^lab\.toml: wall\[1\]\.start: got \(0, -1\.6\), outside the arena"):
            load_scenario(path)
    with pytest.raises(ConfigError, match=r"^wrong\.toml: wall\[1\]\.start: got \(0, -1\.6\)"):
        load_scenario(wrong)
    with pytest.raises(ConfigError, match=r"^--set wall\[2\]\.end: got nothing"):
        load_scenario(own, overrides={"wall": [*[{"start": [1, 1], "end": [1, 0]}] * 2, {"start": [1, 1]}]})
    write(tmp_path, "lab.toml", right + "[[wall]]\nstart = [0.0, -1.6]\n")
    with pytest.raises(ConfigError, match=r"^lab\.toml: wall\[1\]\.end: got nothing"):
        load_scenario(own)
    write(tmp_path, "lab.toml", "[wall]\nstart = [0.0, -1.6]\n")
    with pytest.raises(ConfigError, match=r"^lab\.toml: wall: got .*, expected rows \[\[wall\]\]"):
        load_scenario(own)


def test_a_wall_leaves_room_for_what_is_beside_it() -> None:
    table = {
        "robots": 1,
        "wall": [WALL],
        "starts": {"r1": [-0.2, -1.0, 0.0]},
        "goals": {"r1": [[0.2, -1.0], [0.0, 0.0]]},
    }
    small = {"name": "circle"}, {"x": -1.0, "radius": 0.6}
    assert parse({**table, "behaviour": small[0], "circle": small[1]}).walls


def test_the_command_line_overrides_the_file(tmp_path: Path) -> None:
    path = write(tmp_path, "run.toml", "[circle]\nradius = 0.5\n")
    lab = load_scenario(path, overrides={"circle.radius": 0.7, "behaviour.name": "circle", "duration": 5})
    assert (lab.circle.radius, lab.behaviour.name, lab.duration) == (0.7, "circle", 5.0)


def test_the_command_line_names_another_fleet_file(tmp_path: Path) -> None:
    lab = write(tmp_path, "lab.toml", "[robot.anna]\ntag = 7\n[circle]\nradius = 0.5\n")
    for text in ("duration = 5\n", 'fleet = "gone.toml"\nduration = 5\n'):
        run = load_scenario(write(tmp_path, "run.toml", text), overrides={"fleet": str(lab)})
        assert (run.robots, run.circle.radius, run.duration) == (("anna",), 0.5, 5.0)
    with pytest.raises(ConfigError, match=r"nofile\.toml: got no such file"):
        load_scenario(ROOT / "muro_zenoh/scenarios/pursuit.toml", overrides={"fleet": "nofile.toml"})
    with pytest.raises(ConfigError, match=r"^--set fleet: got 3 \(integer\), expected text"):
        load_scenario(tmp_path / "run.toml", overrides={"fleet": 3})


@pytest.mark.parametrize("path", BUILT_IN, ids=lambda path: path.stem)
def test_a_robot_of_any_scenario_can_be_overridden(path: Path) -> None:
    plain, changed = load_scenario(path), load_scenario(path, overrides={"robot.r1.v_max": 0.45})
    assert changed.robot["r1"].v_max == 0.45
    assert changed.robots == plain.robots
    assert [r.tag for r in changed.robot.values()] == [r.tag for r in plain.robot.values()]


@pytest.mark.parametrize(
    ("text", "robots", "overrides", "names"),
    [
        ("robots = 2", None, {}, "r1, r2"),
        ("robots = 2", 3, {}, "r1, r2, r3"),
        ("robots = 2", None, {"robots": 4}, "r1, r2, r3, r4"),
        ("", None, {}, "r1"),
        ("[robot.anna]\ntag = 1\n[robot.ben]\ntag = 2", None, {}, "anna, ben"),
        ("[robot.anna]\ntag = 1\n[robot.ben]\ntag = 2", 1, {}, "anna"),
    ],
)
def test_a_robot_that_is_not_there_cannot_be_overridden(
    text: str, robots: int | None, overrides: dict[str, object], names: str, tmp_path: Path
) -> None:
    path = write(tmp_path, "run.toml", text)
    last = names.split(", ")[-1]
    there = load_scenario(path, robots=robots, overrides={f"robot.{last}.v_max": 0.3, **overrides})
    assert (", ".join(there.robots), there.robot[last].v_max) == (names, 0.3)
    with pytest.raises(ConfigError, match=rf"^--set robot\.r9\.v_max: got robot r9, expected one of {names}$"):
        load_scenario(path, robots=robots, overrides={"robot.r9.v_max": 0.3, **overrides})


def test_another_behaviour_does_not_take_the_parameters_of_the_file_s(tmp_path: Path) -> None:
    path = write(tmp_path, "run.toml", '[behaviour]\nname = "pursuit"\ncruise = 0.15\n')

    def behaviour(**overrides: object) -> BehaviourSettings:
        return load_scenario(path, overrides={f"behaviour.{key}": v for key, v in overrides.items()}).behaviour

    assert behaviour(name="hold") == BehaviourSettings(name="hold")
    assert behaviour(speed=0.1, name="circle") == BehaviourSettings(name="circle", parameters={"speed": 0.1})
    assert behaviour(name="pursuit").parameters == {"cruise": 0.15}


@settings(max_examples=50)
@given(
    radius=st.floats(0.05, 0.4),
    v_max=st.floats(0.1, 2.0),
    count=st.integers(1, 12),
    clockwise=st.booleans(),
    x=st.floats(-0.5, 0.5),
)
def test_any_scenario_can_be_handed_to_a_process(
    radius: float, v_max: float, count: int, clockwise: bool, x: float
) -> None:
    table = {"robots": count, "all": {"radius": radius, "v_max": v_max}, "circle": {"x": x, "clockwise": clockwise}}
    lab = parse(table)
    assert parse(as_table(lab)) == lab


# ---- what is wrong

WALL = {"start": [0.0, -1.5], "end": [0.0, -0.4]}
WRONG: list[tuple[dict[str, Any], str]] = [
    ({"colour": 1}, "lab.toml: colour: got an unknown key, expected one of fleet,"),
    ({"circel": {}}, "Did you mean circle?"),
    (
        {"circle": {"raduis": 1.0}},
        "lab.toml: circle.raduis: got an unknown key, expected one of x, y",
    ),
    ({"circle": {"raduis": 1.0}}, "Did you mean radius?"),
    (
        {"circle": {"radius": "0.8 m"}},
        "lab.toml: circle.radius: got '0.8 m' (text), expected a number at least 0.001 [m]",
    ),
    ({"circle": {"radius": -1}}, "lab.toml: circle.radius: got -1 (integer), expected a number at least 0.001 [m]"),
    ({"circle": {"radius": True}}, "lab.toml: circle.radius: got True (boolean), expected a number at least 0.001 [m]"),
    ({"circle": {"clockwise": "no"}}, "lab.toml: circle.clockwise: got 'no' (text), expected true or false"),
    ({"circle": {"x": float("nan")}}, "lab.toml: circle.x: got nan"),
    (
        {"circle": {"radius": float("inf")}},
        "lab.toml: circle.radius: got inf (number), expected a number at least 0.001 [m]",
    ),
    ({"circle": 3}, "lab.toml: circle: got 3 (integer), expected a table [circle]"),
    ({"arena": {"x_min": [1]}}, "lab.toml: arena.x_min: got [1] (array), expected a number"),
    ({"robot": {"r1": {"tag": 1.5}}}, "lab.toml: robot.r1.tag: got 1.5 (number), expected a whole number at least 0"),
    ({"robot": {"r1": {"tag_yaw": 90}}}, "lab.toml: robot.r1.tag_yaw: got 90 (integer), expected a number at least"),
    ({"robot": {"r1": {"tag_yaw": 90}}}, "[rad]"),
    (
        {"robot": {"r1": {"v_max": "fast"}}},
        "robot.r1.v_max: got 'fast' (text), expected a number above 0 [m/s]",
    ),
    ({"robot": {"r1": {"base": "../kobuki"}}}, "lab.toml: robot.r1.base: got '../kobuki' (text), expected text like"),
    ({"robot": {"R1": {"tag": 1}}}, "lab.toml: robot.R1: got 'R1' (text), expected text like"),
    *(
        (
            {"robot": {"r1": {"tag": 1}, name: {"tag": 2}}},
            f"lab.toml: robot.{name}: got the name of one of our own processes, expected another name than muro,",
        )
        for name in ("muro", "router", "simulator", "basestation")
    ),
    ({"robot": {"r1": 4}}, "lab.toml: robot.r1: got 4 (integer), expected a table [robot.r1]"),
    ({"robot": [1]}, "lab.toml: robot: got [1] (array), expected a table [robot]"),
    ({"all": {"radius": 0}}, "lab.toml: all.radius: got 0 (integer), expected a number at least 0.001 [m]"),
    ({"all": {"tag": 3}}, "lab.toml: all.tag: got 3 (integer), expected no tag in [all]"),
    ({"robots": 0}, "lab.toml: robots: got 0 (integer), expected a whole number at least 1"),
    ({"robots": 2, "robot": {"r1": {}}}, "lab.toml: robots: got a number besides [robot.*]"),
    ({"camera": {"north": {"rate": 0}}}, "lab.toml: camera.north.rate: got 0 (integer), expected a number above 0"),
    ({"camera": {"north": {"rate": 0}}}, "[Hz]"),
    (
        {"camera": {"north": {"width": 1e3}}},
        "camera.north.width: got 1000.0 (number), expected a whole number",
    ),
    ({"camera": {"North": {}}}, "lab.toml: camera.North: got 'North'"),
    (
        {"bus": {"mode": "server"}},
        "bus.mode: got 'server' (text), expected one of 'client', 'peer', 'router'",
    ),
    (
        {"bus": {"connect": ["localhost"]}},
        "bus.connect: got ['localhost'] (array), expected an array of text like",
    ),
    ({"bus": {"realm": "My Lab"}}, "lab.toml: bus.realm: got 'My Lab' (text), expected text like"),
    (
        {"bus": {"lease": 0.01}},
        "lab.toml: bus.lease: got 0.01 (number), expected a number at least 0.2 and at most 60 [s]",
    ),
    *(
        ({"timeouts": {key: 0.05}}, f"lab.toml: timeouts.{key}: got 0.05 (number), expected a number at least 0.1")
        for key in ("command", "pose", "snapshot")
    ),
    (
        {"timeouts": {"command": 3}},
        "lab.toml: timeouts.command: got 3 (integer), expected a number at least 0.1 and at most 1 [s]",
    ),
    ({"wall": {}}, "lab.toml: wall: got {} (table), expected rows [[wall]]"),
    ({"wall": [WALL, 3]}, "lab.toml: wall[1]: got 3 (integer), expected a table"),
    ({"wall": [{"start": [0.0, 1.0]}]}, "lab.toml: wall[0].end: got nothing, expected an array of a number [m]"),
    ({"wall": [{**WALL, "end": [0.0]}]}, "lab.toml: wall[0].end: got [0.0] (array), expected an array of a number [m]"),
    ({"wall": [{**WALL, "end": [0.0, float("nan")]}]}, "lab.toml: wall[0].end: got [0.0, nan] (array), expected"),
    ({"wall": [{**WALL, "start": [float("inf"), 0.0]}]}, "lab.toml: wall[0].start: got [inf, 0.0] (array), expected"),
    ({"wall": [{**WALL, "ends": [0.0, 1.0]}]}, "wall[0].ends: got an unknown key, expected one of start, end. Did you"),
    (
        {"wall": [WALL, {**WALL, "end": [0.0, -1.5]}]},
        "lab.toml: wall[1].end: got (0, -1.5), where it starts, expected another place than start",
    ),
    ({"duration": 0}, "lab.toml: duration: got 0 (integer), expected a number above 0"),
    ({"behaviour": {"name": 3}}, "lab.toml: behaviour.name: got 3 (integer), expected text"),
    ({"behaviour": {"name": "circle", "when": {"x": 1}}}, "lab.toml: behaviour.when: got {'x': 1} (table)"),
    ({"checks": {"settle_time": "soon"}}, "lab.toml: checks.settle_time: got 'soon' (text), expected a number above 0"),
    (
        {"simulation": {"drive_error": 20}},
        "simulation.drive_error: got 20 (integer), expected a number at least 0",
    ),
]


@pytest.mark.parametrize(("table", "said"), WRONG, ids=[said[:50] for _, said in WRONG])
def test_a_wrong_value_is_named(table: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(said)):
        parse(table)


SMALL = {"x_min": -1.0, "x_max": 1.0, "y_min": -1.0, "y_max": 1.0}
PIXELS = [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]]
IMPOSSIBLE: dict[str, tuple[dict[str, Any], str]] = {
    "an arena inside out": (
        {"arena": {"x_min": 3.0}},
        "lab.toml: arena: got x 3 to 2.1, y -1.5 to 1.5 m, expected x_min <",
    ),
    "an arena without height": ({"arena": {"y_min": 1.5}}, "lab.toml: arena: got"),
    "two robots with one tag": (
        {"robot": {"r1": {"tag": 3}, "r2": {"tag": 3}}},
        "lab.toml: robot.r2.tag: got 3, which robot r1 has too, expected a unique tag",
    ),
    "a tag that its family has not": (
        {"camera": {"north": {"family": "DICT_5X5_100"}}, "robot": {"r1": {"tag": 99}, "r2": {"tag": 100}}},
        "lab.toml: robot.r2.tag: got 100, expected one of 0 to 99, which family DICT_5X5_100 of camera north has",
    ),
    "a robot that no camera can see": (
        {"camera": {"north": {}}, "robot": {"r1": {}}},
        "lab.toml: robot.r1.tag: got no tag, expected the id of its tag",
    ),
    "a circle outside the arena": (
        {"arena": SMALL, "behaviour": {"name": "circle"}, "circle": {"radius": 0.9}},
        "lab.toml: circle.radius: got 0.9 m around (0, 0), expected at most 0.803 m, so that robots stay inside the "
        "arena, 0.197 m",
    ),
    "a circle whose centre is outside": (
        {"arena": SMALL, "behaviour": {"name": "pursuit"}, "circle": {"radius": 0.5, "x": 4.0}},
        "lab.toml: circle.radius: got 0.5 m around (4, 0), expected at most 0 m",
    ),
    "too many robots for the circle": (
        {"robots": 13, "behaviour": {"name": "pursuit"}, "circle": {"radius": 0.8}},
        "lab.toml: circle.radius: got 13 robots on a circle of 0.8 m, 0.383 m apart, expected at least 0.4 m between "
        "their centres. At most 12 robots fit on it; 13 robots need a radius of 0.84 m.",
    ),
    "pixels without metres": (
        {"camera": {"north": {"pixels": PIXELS}}},
        "lab.toml: camera.north: got pixels or metres alone, expected both, or neither",
    ),
    "more pixels than metres": (
        {"camera": {"north": {"pixels": [*PIXELS, [5.0, 5.0]], "metres": PIXELS}}},
        "lab.toml: camera.north.metres: got 4 points, expected as many as pixels has: 5",
    ),
    "a camera too slow for the age that a pose may have": (
        {"robots": 1, "camera": {"north": {"rate": 5.0}}},
        "lab.toml: timeouts.pose: got 0.25 [s], expected at least 0.45: the frames of camera north are 0.05 s old, "
        "0.2 s apart, and one may be lost",
    ),
    "three points": ({"camera": {"north": {"pixels": PIXELS[:3]}}}, "lab.toml: camera.north.pixels: got"),
    "a goal outside the arena": (
        {"robots": 1, "goals": {"r1": [[0.0, 0.0], [5.0, 0.0]]}},
        "lab.toml: goals.r1[1]: got (5, 0), outside the arena or too near its border, expected x -1.903 to 1.903, "
        "y -1.303 to 1.303 m, 0.197 m inside the border",
    ),
    "a wall outside the arena": (
        {"wall": [WALL, {"start": [0.0, 0.4], "end": [0.0, 1.6]}]},
        "lab.toml: wall[1].end: got (0, 1.6), outside the arena, expected x -2.1 to 2.1, y -1.5 to 1.5 m. Let the wall",
    ),
    "a goal at a wall": (
        {"robots": 1, "wall": [WALL], "goals": {"r1": [[0.0, 0.0], [0.19, -1.0]]}},
        "lab.toml: goals.r1[1]: got (0.19, -1), 0.190 m from the wall from (0, -1.5) to (0, -0.4), expected at least "
        "0.197 m from every wall. Choose a place farther from it.",
    ),
    "a goal of all robots at a wall": (
        {"wall": [WALL], "behaviour": {"name": "steer", "goals": [[0.0, -0.25]]}},
        "lab.toml: behaviour.goals[0]: got (0, -0.25), 0.150 m from the wall from (0, -1.5) to (0, -0.4), expected",
    ),
    "a start at a wall": (
        {"robots": 1, "wall": [WALL], "starts": {"r1": [-0.19, -1.0, 0.0]}},
        "lab.toml: starts.r1: got (-0.19, -1), 0.190 m from the wall from (0, -1.5) to (0, -0.4), expected at least",
    ),
    "a circle through a wall": (
        {"wall": [WALL], "behaviour": {"name": "circle"}},
        "lab.toml: circle.radius: got 0.8 m around (0, 0), 0.000 m from the wall from (0, -1.5) to (0, -0.4), expected "
        "a circle that is at least 0.197 m from every wall. Choose another centre or radius.",
    ),
    "a circle round a wall, too near it": (
        {"wall": [{"start": [0.0, 0.0], "end": [0.0, -0.61]}], "behaviour": {"name": "pursuit"}},
        "lab.toml: circle.radius: got 0.8 m around (0, 0), 0.190 m from the wall from (0, 0) to (0, -0.61), expected",
    ),
    "a circle beside a wall, too near it": (
        {"wall": [{"start": [0.99, -1.0], "end": [0.99, 1.0]}], "behaviour": {"name": "circle"}},
        "lab.toml: circle.radius: got 0.8 m around (0, 0), 0.190 m from the wall from (0.99, -1) to (0.99, 1)",
    ),
    "cells that go through walls": (
        {"wall": [WALL], "behaviour": {"name": "coverage"}},
        "lab.toml: behaviour.name: got coverage in an arena with 1 wall, expected an arena without [[wall]], because "
        "Voronoi cells go through walls. Leave the walls out, or choose another behaviour.",
    ),
    "two last goals that two robots cannot both stand at": (
        {"robots": 3, "goals": {"r1": [[0.0, 0.0], [1.0, 0.0]], "r2": [[1.0, 0.0], [0.0, 1.0]], "r3": [[0.7, 0.2]]}},
        "lab.toml: goals.r3: got a last goal 0.361 m from that of r1, expected at least 0.4 m between the centres",
    ),
    "a certificate for less time than the wheels may follow a command": (
        {"robots": 1, "timeouts": {"command": 0.5}},
        "lab.toml: separation.hold: got 0.35 [s], expected at least 0.55: timeouts.command, and one period of 0.05 s",
    ),
    "two ages of the positions": (
        {"robots": 1, "timeouts": {"snapshot": 1.0}},
        "lab.toml: separation.snapshot_limit: got 0.5 [s], expected timeouts.snapshot, 1: how old the positions may be",
    ),
}


@pytest.mark.parametrize("what", IMPOSSIBLE)
def test_what_is_impossible_is_refused_before_anything_starts(what: str) -> None:
    table, said = IMPOSSIBLE[what]
    with pytest.raises(ConfigError, match=re.escape(said)):
        parse(table)


def test_a_slower_camera_needs_poses_that_may_be_older() -> None:
    table = {"robots": 1, "camera": {"north": {"rate": 5.0}}}
    assert parse({**table, "timeouts": {"pose": 0.45}}).timeouts == Timeouts(pose=0.45)


def test_the_limits_of_age_have_one_default() -> None:
    assert (TIMEOUTS.command, TIMEOUTS.pose, TIMEOUTS.snapshot) == (0.3, 0.25, 0.5)
    assert channels.CMD_VEL.stale_after == TIMEOUTS.command
    assert channels.POSE.stale_after == TIMEOUTS.pose
    assert channels.ALL_POSITIONS.stale_after == TIMEOUTS.snapshot


def test_as_many_robots_as_the_error_allows_do_fit() -> None:
    for name in ("pursuit", "circle"):
        table = {"behaviour": {"name": name}, "circle": {"radius": 0.8}}
        assert len(parse(table, robots=12).robot) == 12
        with pytest.raises(ConfigError, match="At most 12"):
            parse(table, robots=13)


def test_where_the_filter_is_off_only_the_bodies_need_room() -> None:
    table = {"behaviour": {"name": "pursuit"}, "circle": {"radius": 0.8}, "separation": {"enabled": False}}
    assert len(parse({**table, "timeouts": {"command": 0.5}}, robots=14).robot) == 14
    with pytest.raises(ConfigError, match=r"at least 0\.354 m between their centres\. At most 14"):
        parse(table, robots=15)
    goals = {"r1": [[0.0, 0.0]], "r2": [[0.36, 0.0]]}
    assert parse({**table, "goals": goals}, robots=2).goals
    with pytest.raises(ConfigError, match=r"goals\.r2"):
        parse({"goals": goals}, robots=2)


@pytest.mark.parametrize(
    ("robots", "said"), [(0, "--robots: got 0, expected 1 or more"), (3, "--robots: got 3, expected at most 2")]
)
def test_an_impossible_number_of_robots_is_named(robots: int, said: str) -> None:
    table = {} if robots == 0 else {"robot": {"r1": {"tag": 1}, "r2": {"tag": 2}}}
    with pytest.raises(ConfigError, match=said):
        parse(table, robots=robots)


def test_an_error_names_the_file_of_the_key(tmp_path: Path) -> None:
    write(tmp_path, "lab.toml", "[all]\nv_max = -1\n[robot.anna]\ntag = 7\nradius = 'big'\n[circle]\nradius = 1.0\n")
    path = write(tmp_path, "run.toml", 'fleet = "lab.toml"\n[all]\nradius = 0.1\n')
    with pytest.raises(ConfigError, match=r"^lab\.toml: all\.v_max: got -1"):
        load_scenario(path)
    with pytest.raises(ConfigError, match=r"^lab\.toml: robot\.anna\.radius: got 'big'"):
        load_scenario(path, overrides={"all.v_max": 0.5})
    with pytest.raises(ConfigError, match=r"^bad\.toml: all\.radius: got 0 "):
        load_scenario(write(tmp_path, "bad.toml", 'fleet = "lab.toml"\n[all]\nradius = 0\nv_max = 0.5\n'))
    with pytest.raises(ConfigError, match=r"^--set all\.radius: got 0 "):
        load_scenario(path, overrides={"all.radius": 0, "all.v_max": 0.5})
    with pytest.raises(ConfigError, match=r"^--set robot: got 5 "):
        load_scenario(path, overrides={"all.v_max": 0.5, "robot": 5})


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("radius = ", r"run\.toml: got .*, expected TOML"),
        ('fleet = "gone.toml"', r"gone\.toml: got no such file, expected a TOML file"),
        ("fleet = 3", r"run\.toml: fleet: got 3 \(integer\), expected text"),
        ('fleet = "run.toml"', r"run\.toml: fleet: got 'run.toml' \(text\), expected no key fleet in a fleet file"),
        ("\x00", r"run\.toml: got .*, expected TOML"),
    ],
)
def test_a_file_that_cannot_be_parsed_is_named(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        load_scenario(write(tmp_path, "run.toml", text))


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="expected a readable TOML file"):
        load_scenario(tmp_path)
    with pytest.raises(ConfigError, match=r"absent\.toml: got no such file"):
        load_scenario(tmp_path / "absent.toml")
    (tmp_path / "run.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(ConfigError, match="expected TOML"):
        load_scenario(tmp_path / "run.toml")


@given(text=st.text(max_size=60))
def test_any_text_is_a_scenario_or_a_config_error(text: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.getbasetemp() / "any.toml"
    path.write_bytes(text.encode("utf-8", "replace"))
    try:
        scenario = load_scenario(path)
    except ConfigError:
        return
    assert scenario.robot


# ---- behaviours' parameters, units


class Cruise(Section, frozen=True, kw_only=True):
    """A behaviour's parameters.

    Attributes:
        cruise: how fast.
        turns: how often.
    """

    cruise: Speed = 0.2
    turns: int = 1


def test_parameters_become_a_value() -> None:
    assert parameters_as(Cruise, {"cruise": 1}, "lab.toml") == Cruise(cruise=1.0)


def test_wrong_parameters_are_named() -> None:
    said = "order: behaviour.cruise: got 0 (integer), expected a number above 0 [m/s]"
    with pytest.raises(ConfigError, match=re.escape(said)):
        parameters_as(Cruise, {"cruise": 0}, "order")
    with pytest.raises(ConfigError, match=r"Did you mean cruise\?"):
        parameters_as(Cruise, {"cruize": 0.1}, "order")


@pytest.mark.parametrize(
    ("kind", "key", "unit"),
    [(Circle, "radius", "m"), (RobotSettings, "alpha_max", "rad/s^2"), (RobotSettings, "tag_x", "m"),
     (BusSettings, "lease", "s")],
)  # fmt: skip
def test_units_are_declared_on_the_fields(kind: type, key: str, unit: str) -> None:
    assert quantities(kind)[key].unit == unit


@pytest.mark.parametrize("kind", Section.__subclasses__(), ids=lambda kind: kind.__name__)
def test_every_setting_is_documented(kind: type[Section]) -> None:
    text = kind.__doc__ or ""
    checks = {judged.name for judged in CHECKS} if kind is Checks else set()  # a check is the report's key beside it
    missing = [
        field
        for field in kind.__struct_fields__
        if field not in checks and not re.search(rf"^ +{field}: ", text, re.MULTILINE)
    ]
    assert not missing, f"{kind.__name__}: say what these are: {missing}"
