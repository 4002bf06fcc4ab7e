"""What ``muro run`` starts: where it listens, the folder of the run, and a command line per process."""

from __future__ import annotations

import asyncio
import difflib
import importlib.util
import json
import os
import socket
import sys
import time
from collections.abc import Mapping
from pathlib import Path

import muro_zenoh
from muro_zenoh.behaviours.entry_points import BEHAVIOURS
from muro_zenoh.behaviours.table import DEFAULT
from muro_zenoh.config import Scenario, as_table, check_behaviour, load_scenario
from muro_zenoh.errors import ConfigError, SupervisionError
from muro_zenoh.supervision.supervisor import Child, ChildSpec, Supervisor

HOST = "127.0.0.1"
PORT = 7447
"""Zenoh's own port."""

_PORT_TRIES = 5


def built_in_scenarios() -> dict[str, Path]:
    """The scenarios that come along, by name."""
    folder = Path(muro_zenoh.__file__).parent / "scenarios"
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def find_scenario(given: str, robots: int | None, overrides: Mapping[str, object]) -> Scenario:
    """The scenario that an operator means: a built-in name, or a file.

    Args:
        given: what was typed.
        robots: how many robots to use.
        overrides: values by full key.

    Raises:
        ConfigError: neither a built-in name nor a file, or a file that says something wrong.
    """
    known = built_in_scenarios()
    if given in known:
        return load_scenario(known[given], robots=robots, overrides=overrides, name=given)
    path = Path(given)
    if not path.is_file():
        close = difflib.get_close_matches(given, known, n=2, cutoff=0.5)
        raise ConfigError(
            "SCENARIO",
            got=f"{given!r}, which is no file",
            expected=f"a TOML file, or one of {', '.join(known)}",
            hint=f"Did you mean {' or '.join(close)}?" if close else "",
        )
    # A behaviour of one's own may stand beside the file.
    os.environ.setdefault(BEHAVIOURS, str(path.resolve().parent))
    return load_scenario(path, robots=robots, overrides=overrides)


def check_own_packages() -> None:
    """Refuse foreign packages under the names of ours, which are generic ones.

    Raises:
        ConfigError: ``agents`` or ``basestation`` is another distribution's, or missing.
    """
    home = Path(muro_zenoh.__file__).resolve().parent.parent
    for name in ("agents", "basestation"):
        spec = importlib.util.find_spec(name)
        places = list(spec.submodule_search_locations or [str(spec.origin)]) if spec is not None else []
        if not places or Path(places[0]).resolve().parent != home:
            raise ConfigError(
                f"package {name}",
                got=f"the one in {places[0]}" if places else "none",
                expected=f"muro-zenoh's own in {home}",
                hint="Another distribution uses this name: install muro-zenoh in a virtual environment of its own.",
            )


def check_can_run(scenario: Scenario, file: str) -> None:
    """Refuse a scenario whose robots could only stand.

    Args:
        scenario: the scenario.
        file: where it came from, for errors.

    Raises:
        ConfigError: no camera, no such behaviour, or wrong parameters.
    """
    behaviour = scenario.behaviour
    if not scenario.camera and behaviour.name != DEFAULT:
        raise ConfigError(
            f"{file}: camera", got="none", expected="a section [camera.<name>]: without poses every robot stands"
        )
    for name in scenario.robots:
        check_behaviour(behaviour.name, scenario.behaviour_of(name).parameters, file, [scenario.vehicle(name)])


def make_run_folder(scenario: str, root: Path = Path("runs")) -> Path:
    """A new folder ``<root>/<time>-<scenario>``.

    Args:
        scenario: its name.
        root: the folder of all runs.

    Raises:
        ConfigError: it cannot be made.
    """
    stem = f"{time.strftime('%Y%m%d-%H%M%S')}-{scenario}"
    for attempt in range(1, 100):
        folder = root / (stem if attempt == 1 else f"{stem}-{attempt}")
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError as error:
            raise ConfigError(str(folder), got=error.strerror or str(error), expected="a folder to write to") from error
        return folder
    raise ConfigError(str(root / stem), got="99 runs within a second", expected="fewer")


def write_scenario(scenario: Scenario, folder: Path) -> Path:
    """Write a resolved scenario, as the processes of a run read it.

    Args:
        scenario: the scenario.
        folder: of the run.
    """
    path = folder / "scenario.json"
    path.write_text(json.dumps(as_table(scenario), indent=1) + "\n")
    return path


def free_port(preferred: int = PORT) -> int:
    """A port on which nobody listens: the preferred one, else any.

    Args:
        preferred: which to try first.
    """
    for port in (preferred, 0):
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((HOST, port))
                probe.listen(1)
            except OSError:
                continue
            return int(probe.getsockname()[1])
    raise SupervisionError(f"no free port on {HOST}")


def connected_to(scenario: Scenario, endpoint: str) -> Scenario:
    """The scenario with every process a client of one router.

    Args:
        scenario: the scenario.
        endpoint: where the router is.
    """
    import msgspec

    bus = msgspec.structs.replace(scenario.bus, mode="client", connect=(endpoint,), listen=())
    return msgspec.structs.replace(scenario, bus=bus)


async def start_all(
    supervisor: Supervisor, scenario: Scenario, seed: int, folder: Path
) -> tuple[Scenario, asyncio.Task[list[Child]]]:
    """Start a router on the usual port, or on a free one when that is taken, and all others beside it.

    They start together because most of a start is importing; a client waits for its router.

    Args:
        supervisor: keeps them.
        scenario: the scenario.
        seed: of the simulator.
        folder: of the run; the scenario is written there.

    Returns:
        The scenario with everybody connected to the router, which is ready; and the task that ends when the others are.

    Raises:
        SupervisionError: a process does not start.
    """
    for attempt in range(1, _PORT_TRIES + 1):
        port = free_port(PORT)
        connected = connected_to(scenario, f"tcp/{HOST}:{port}")
        file = write_scenario(connected, folder)
        # The router first, so that it is ended last.
        routing = asyncio.create_task(supervisor.start([router_spec(file)]), name="start the router")
        others = asyncio.create_task(
            supervisor.start(fleet_specs(connected, file, seed, folder)), name="start the fleet"
        )
        try:
            await routing
        except BaseException as error:
            for task in (routing, others):
                task.cancel()
            await asyncio.wait({routing, others})
            for task in (routing, others):
                if not task.cancelled():
                    task.exception()  # the one that is raised here is told
            # Somebody may have taken the port between our look and the router's.
            if isinstance(error, SupervisionError) and attempt < _PORT_TRIES and free_port(port) != port:
                continue
            raise
        return connected, others
    raise AssertionError("unreachable")


def router_spec(file: Path) -> ChildSpec:
    """The router's process.

    Args:
        file: the resolved scenario.
    """
    environment = _environment()
    # The one thread that suits the others would keep a router from forwarding large messages.
    environment.pop("ZENOH_RUNTIME", None)
    return ChildSpec("router", _python("muro_zenoh.transport.router", str(file)), environment)


def fleet_specs(scenario: Scenario, file: Path, seed: int, folder: Path) -> list[ChildSpec]:
    """All processes of a run but the router: simulator, base station, an agent per robot.

    Args:
        scenario: the scenario.
        file: where it was written.
        seed: of the simulator.
        folder: of the run.
    """
    environment = _environment()
    agents = [ChildSpec(name, _python("agents.agent", str(file), name), environment) for name in scenario.robots]
    return [
        ChildSpec("simulator", _python("muro_zenoh.cli.main", "sim", str(file), "--seed", str(seed)), environment),
        ChildSpec(
            "basestation",
            _python("basestation.station", str(file), "--state", str(folder / "state.json")),
            environment,
        ),
        *agents,
    ]


def _python(module: str, *arguments: str) -> tuple[str, ...]:
    # -P: a folder "agents" where the operator happens to stand is not ours.
    return sys.executable, "-P", "-m", module, *arguments


def _environment() -> dict[str, str]:
    environment = dict(os.environ)
    # Matrices here are small; a pool of threads in every process would only cost memory and start-up time.
    for library in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        environment.setdefault(library, "1")
    return environment
