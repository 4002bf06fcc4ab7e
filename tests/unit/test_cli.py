"""The command line's help and its errors; what its commands do to a fleet is proved with a fleet."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import msgpack  # type: ignore[import-untyped]  # it publishes no types
import pytest
from click.testing import CliRunner

import muro_zenoh
from muro_zenoh.cli.main import main
from muro_zenoh.cli.options import assignments, override_bus, toml_value
from muro_zenoh.cli.payloads import full_key, shown, type_of
from muro_zenoh.config import PROCESSES, BusSettings, built_in_scenarios, find_scenario, load_scenario, parse_scenario
from muro_zenoh.errors import ConfigError
from muro_zenoh.supervision.folder import make_run_folder, write_scenario
from muro_zenoh.supervision.launch import fleet_specs, free_port, router_spec
from muro_zenoh.transport.router import router_settings


def commands(command: click.Command, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    yield path
    if isinstance(command, click.Group):
        context = click.Context(command)
        for name in command.list_commands(context):
            child = command.get_command(context, name)
            assert child is not None
            yield from commands(child, (*path, name))


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def refused(*arguments: str) -> str:
    """The output of a command that refuses with exit code 2 and changes nothing."""
    result = CliRunner().invoke(main, arguments, prog_name="muro")
    assert result.exit_code == 2, result.output
    assert os.listdir() in ([], ["lab.toml"])
    return result.output


# ---- help


@pytest.mark.parametrize("path", [pytest.param(p, id=" ".join(p) or "muro") for p in commands(main)])
def test_every_command_s_help_has_an_example_that_parses(path: tuple[str, ...]) -> None:
    result = CliRunner().invoke(main, [*path, "--help"], prog_name="muro")
    assert result.exit_code == 0
    examples = result.output.split("Example")[1].replace("\\\n", " ")
    lines = [line.strip() for line in examples.splitlines()[1:] if line.strip()]
    assert lines
    assert all(line.startswith(" ".join(("muro", *path))) for line in lines)
    if not path:
        return
    for line in lines:
        # Parsed down to its last command, not carried out.
        words = [word.strip("'") for word in line.split()[1:]]
        context, command = click.Context(main, info_name="muro"), main
        while isinstance(command, click.Group):
            found = command.get_command(context, words[0])
            assert found is not None, line
            command, words = found, words[1:]  # type: ignore[assignment]  # a group at first, a command at last
        command.make_context(command.name, words)


def test_help_and_version_import_neither_zenoh_nor_numpy_nor_rich() -> None:
    code = (
        "import sys; from muro_zenoh.cli.main import main; main(['run', '--help'], standalone_mode=False); "
        "sys.exit(str(sorted({'zenoh', 'numpy', 'rich', 'asyncio', 'msgspec'} & set(sys.modules))))"
    )
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stderr.strip() == "[]"


@pytest.mark.parametrize("command", ["agent", "base", "basestation", "sim", "router"])
def test_a_process_imports_no_other_command_and_nothing_that_only_people_need(command: str) -> None:
    unwanted = {
        "rich",
        "muro_zenoh.cli.run",
        "muro_zenoh.cli.topic",
        "muro_zenoh.scoring",
        "muro_zenoh.supervision.run",
    }
    arguments = [command, "pursuit", *(["r1"] if command in ("agent", "base") else [])]
    code = (
        "import sys, muro_zenoh.runtime.process as process\n"
        f"process.run_process = lambda *_: print(sorted({unwanted!r} & set(sys.modules))) or 0\n"
        f"from muro_zenoh.cli.main import main; main({arguments!r}, prog_name='muro')"
    )
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.returncode) == ("[]\n", 0), done.stderr


# ---- wrong use


def test_an_unknown_scenario_lists_the_built_in_ones() -> None:
    said = refused("run", "pursiut")
    assert {"circle", "hold", "pursuit"} <= set(built_in_scenarios())
    names = ", ".join(built_in_scenarios())
    assert f"got 'pursiut', which is not a file, expected a TOML file, or one of {names}. Did you mean pursuit?" in said


def test_a_python_file_is_no_scenario_but_may_be_named_in_one() -> None:
    said = refused("run", "examples/flock.py")
    assert "a Python file, expected a TOML file. Name a function of it there" in said
    assert '[behaviour] name = "flock:<function>"' in said


def test_a_file_that_is_not_toml() -> None:
    Path("lab.toml").write_text("robots = = 5\n")
    assert "lab.toml: got Invalid value" in refused("run", "lab.toml")


def test_a_wrong_key_in_a_file() -> None:
    Path("lab.toml").write_text("[circle]\nradus = 1.0\n")
    assert "lab.toml: circle.radus: got an unknown key" in refused("run", "lab.toml")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("circle.radus=1", "circle.radus: got an unknown key, expected one of x, y, radius, clockwise"),
        ("circle.radius=wide", "circle.radius: got 'wide' (text), expected a number at least 0.001 [m]"),
        ("circle.radius=-1", "circle.radius: got -1 (integer), expected a number at least 0.001 [m]"),
        ("circle.radius", "--set: got 'circle.radius', expected KEY=VALUE, such as circle.radius=0.9"),
        ("=3", "--set: got '=3', expected KEY=VALUE"),
        ("circle..x=3", "--set: got 'circle..x=3', expected KEY=VALUE"),
        ("circle.radius=[1", "--set circle.radius: got '[1', expected a TOML value"),
        ("duration.x.y=1", "--set duration.x.y: got duration = 60.0, expected a table there"),
        ("circle.radius=1.9", "circle.radius: got 1.9 m around (0, 0), expected at most"),
    ],
)
def test_a_wrong_setting(given: str, said: str) -> None:
    assert said in refused("run", "pursuit", "--set", given)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["run"], "Missing argument 'SCENARIO'"),
        (["run", "pursuit", "--robots", "0"], "0 is not in the range x>=1"),
        (["run", "pursuit", "--robots", "40"], "At most 12 robots fit"),
        (["run", "pursuit", "--duration", "0"], "not in the range x>0"),
        (
            ["run", "pursuit", "--report", "nowhere/r.json"],
            "--report: got nowhere/r.json, whose folder cannot be written to",
        ),
        (["run", "pursuit", "--connect", "lab:7447"], "--connect: got 'lab:7447', expected an endpoint"),
        (["agent", "pursuit", "r1", "--listen", "7447"], "--listen: got '7447', expected an endpoint"),
        (["agent", "pursuit", "r1", "--realm", "My lab"], "--realm: got 'My lab'"),
        (["agent", "pursuit", "r1", "--mode", "server"], "'server' is not one of"),
        (["agent", "nowhere.toml", "r1"], "got 'nowhere.toml', which is not a file"),
        (["stop", "R2!"], "robot: got 'R2!'"),
        (["set", "circle"], "nothing to change"),
        (["set", "circle", "--radius", "0"], "not in the range x>0"),
        (["set", "behaviour", "circle", "speed"], "parameter: got 'speed', expected KEY=VALUE"),
        (["set", "behaviour", "circle", "speed={a=1}"], "expected numbers, text, true or false"),
        (["topic", "echo", "pose//r1"], "KEY: got 'pose//r1'"),
        (["fly"], "No such command 'fly'"),
    ],
)
def test_wrong_use(arguments: list[str], said: str) -> None:
    assert said in refused(*arguments)


def test_a_foreign_package_under_the_name_of_ours_is_named(tmp_path: Path) -> None:
    foreign = tmp_path / "elsewhere" / "agents"
    foreign.mkdir(parents=True)
    (foreign / "__init__.py").write_text("")
    done = subprocess.run(
        [sys.executable, "-P", "-m", "muro_zenoh", "run", "pursuit"],
        env={**os.environ, "PYTHONPATH": f"{foreign.parent}{os.pathsep}{Path(muro_zenoh.__file__).parents[1]}"},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 2
    assert f"package agents: got the one in {foreign}, expected muro-zenoh's own in" in done.stderr


# ---- values as they are typed


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0.9", 0.9),
        ("3", 3),
        ("true", True),
        ('"a b"', "a b"),
        ("[1, 2.5]", [1, 2.5]),
        ("pursuit", "pursuit"),
        ("mylab.swarm:flock", "mylab.swarm:flock"),
    ],
)
def test_values_are_toml_or_a_bare_word(text: str, value: object) -> None:
    assert toml_value(text, "--set") == value


def test_assignments_keep_the_equals_signs_of_their_values() -> None:
    assert assignments(('bus.config = "a=b"', "x.y=1"), "--set") == {"bus.config": "a=b", "x.y": 1}


def test_flags_override_the_file_s_bus() -> None:
    base = BusSettings(realm="lab", connect=("tcp/10.0.0.1:7447",))
    assert override_bus(base, {"connect": (), "listen": (), "mode": None}) == base
    overridden = override_bus(base, {"connect": ("tcp/10.0.0.2:1", "udp/h:2"), "mode": "peer"})
    assert (overridden.realm, overridden.mode, overridden.connect) == ("lab", "peer", ("tcp/10.0.0.2:1", "udp/h:2"))


@pytest.mark.parametrize(
    ("fleet", "flags", "listen"),
    [
        (None, {}, ("tcp/127.0.0.1:7447",)),
        (None, {"listen": ("tcp/0.0.0.0:1",)}, ("tcp/0.0.0.0:1",)),
        (None, {"config": "router.json5"}, ()),
        (None, {"config": "router.json5", "listen": ("tcp/127.0.0.1:7447",)}, ("tcp/127.0.0.1:7447",)),
        (BusSettings(connect=("tcp/lab:2",)), {}, ("tcp/lab:2",)),
        (BusSettings(connect=("tcp/lab:2",)), {"config": "router.json5"}, ("tcp/lab:2",)),
        (BusSettings(connect=("tcp/lab:2",), listen=("tcp/0.0.0.0:3",)), {}, ("tcp/0.0.0.0:3",)),
        (BusSettings(listen=("tcp/0.0.0.0:3",)), {"listen": ("tcp/0.0.0.0:1",)}, ("tcp/0.0.0.0:1",)),
    ],
)
def test_where_a_router_listens(fleet: BusSettings | None, flags: dict[str, object], listen: tuple[str, ...]) -> None:
    settings = router_settings(fleet, lambda base: override_bus(base, flags))
    assert (settings.mode, settings.listen, settings.connect) == ("router", listen, ())
    assert router_settings(fleet, lambda base: override_bus(base, {"connect": ("tcp/up:4",)})).connect == ("tcp/up:4",)


# ---- what a run is made of


@pytest.mark.parametrize("name", sorted(built_in_scenarios()))
def test_a_built_in_scenario_goes_to_the_processes_as_it_is(name: str, tmp_path: Path) -> None:
    scenario = find_scenario(name)
    assert len(scenario.robot) == (6 if name == "doorway" else 5)
    assert all(robot.tag_x and robot.tag_y and robot.tag_yaw for robot in scenario.robot.values())
    assert load_scenario(write_scenario(scenario, tmp_path)) == scenario


SHAKY_CAMERA = {"kind": "freeze", "target": "camera/north"}


def test_every_process_of_a_run_is_started_by_a_command_that_parses(tmp_path: Path) -> None:
    scenario = find_scenario("pursuit", 2)
    file = write_scenario(scenario, tmp_path)
    specs = [router_spec(file), *fleet_specs(scenario, file, 7, tmp_path, {"r2": "tcp/127.0.0.1:1"})]
    assert [spec.name for spec in specs] == ["router", "simulator", "basestation", "r1", "r2"]
    assert {"muro", *(spec.name for spec in specs)} == {*PROCESSES, "r1", "r2"}, "a robot could have its name"
    shaky = parse_scenario({"robots": 1, "camera": {"north": {}}, "fault": [SHAKY_CAMERA]}, "lab.toml", name="lab")
    specs += fleet_specs(shaky, file, 7, tmp_path, {})
    context = click.Context(main, info_name="muro")
    for spec in specs:
        python, flags, (word, *words) = spec.command[0], spec.command[1:4], spec.command[4:]
        assert (python, flags) == (sys.executable, ("-P", "-m", "muro_zenoh"))
        command = main.get_command(context, word)
        assert command is not None, word
        command.make_context(word, words, parent=context)


def test_a_number_of_robots_can_be_chosen() -> None:
    assert find_scenario("pursuit", 8, {"circle.radius": 1.0}).robots == tuple(f"r{i}" for i in range(1, 9))


def test_a_scenario_in_json_that_is_not_one() -> None:
    Path("scenario.json").write_text("[1, 2]")
    with pytest.raises(ConfigError, match=r"scenario.json: got \[1, 2\] \(array\), expected a table of settings"):
        load_scenario("scenario.json")
    Path("scenario.json").write_text("{")
    with pytest.raises(ConfigError, match="expected JSON"):
        load_scenario("scenario.json")


def test_two_runs_within_a_second_have_a_folder_each() -> None:
    folders = {make_run_folder("pursuit") for _ in range(3)}
    assert len(folders) == 3
    assert all(folder.parent == Path("runs") and folder.is_dir() for folder in folders)


def test_a_taken_port_is_not_chosen() -> None:
    import socket

    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen(1)
        port = taken.getsockname()[1]
        assert free_port(port) != port
    assert free_port(port) == port


# ---- keys and payloads


@pytest.mark.parametrize(
    ("typed", "key"),
    [
        ("pose/r1", "muro/pose/r1"),
        ("muro/pose/r1", "muro/pose/r1"),
        ("cmd_vel/*", "muro/cmd_vel/*"),
        ("**", "**"),
        ("**/r1", "**/r1"),
        ("/rt/odom", "rt/odom"),
        ("muroscope", "muro/muroscope"),
    ],
)
def test_keys_are_within_the_realm_or_absolute(typed: str, key: str) -> None:
    assert full_key(typed, "muro") == key


@pytest.mark.parametrize("typed", ["", "/", "a//b", "a/", "a*b", "a/***", "a?b", "a#", "$"])
def test_what_is_not_a_key_is_refused(typed: str) -> None:
    with pytest.raises(ConfigError, match="KEY"):
        full_key(typed, "muro")


def test_payloads_are_shown_as_text() -> None:
    packed = msgpack.packb({"x": 1.5, "name": "r1", "data": b"\0" * 300, 3: [None, True]})
    assert json.loads(shown(packed, "application/msgpack;Frame.1")) == {
        "x": 1.5,
        "name": "r1",
        "data": "<300 bytes>",
        "3": [None, True],
    }
    assert shown(msgpack.packb({"a": 1}), "zenoh/bytes") == '{"a": 1}'  # a foreign writer, without a type
    assert shown(msgpack.packb(7), "application/msgpack") == "7"
    assert shown(b"hello", "text/plain") == "hello"
    assert shown(b"\x07", "zenoh/bytes") == "<1 raw bytes, encoding zenoh/bytes: 07>"
    assert shown(b"", None) == "<0 raw bytes, encoding unknown: >"
    assert shown(b"\xc1" * 100, "application/msgpack").startswith("<100 raw bytes, encoding application/msgpack: c1 c1")
    assert shown(b"\x81\xa1a" + b"\xd9\xff", "application/cdr").startswith("<5 raw bytes")


def test_a_type_is_what_the_writer_says() -> None:
    assert type_of("application/msgpack;PoseFix.1") == "PoseFix.1"
    assert type_of("text/plain") == "text/plain"
    assert type_of(None) == "-"
