"""The processes of a run: their router's endpoint, and a command line for each."""

from __future__ import annotations

import asyncio
import os
import socket
import sys
from collections.abc import Mapping
from pathlib import Path

import msgspec

from basestation.dashboard.offer import Offer
from muro_zenoh.config import Scenario
from muro_zenoh.errors import SupervisionError
from muro_zenoh.supervision.child import Child, ChildSpec
from muro_zenoh.supervision.fault_targets import camera_process, cameras_apart
from muro_zenoh.supervision.faults import Links
from muro_zenoh.supervision.folder import write_scenario
from muro_zenoh.supervision.supervisor import Supervisor

HOST = "127.0.0.1"
PORT = 7447
"""Zenoh's default port."""

_PORT_TRIES = 5


def free_port(preferred: int = PORT) -> int:
    """A free port: the preferred one if possible.

    Args:
        preferred: the port to try first.
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
    """The scenario with every process as a client of one router. The bases are in the simulator: no agent looks for its
    own on this machine.

    Args:
        scenario: the scenario.
        endpoint: the router's endpoint.
    """
    bus = msgspec.structs.replace(scenario.bus, mode="client", connect=(endpoint,), listen=())
    robots = {name: msgspec.structs.replace(robot, base_link=None) for name, robot in scenario.robot.items()}
    return msgspec.structs.replace(scenario, bus=bus, robot=robots)


async def start_all(
    supervisor: Supervisor, scenario: Scenario, seed: int, folder: Path, links: Links, page: Offer | str
) -> tuple[Scenario, asyncio.Task[list[Child]]]:
    """Start a router on the default port, or on a free one when that is taken, and all other processes.

    They start together because most of the start-up time is imports; a client waits for its router.

    Args:
        supervisor: starts and restarts them.
        scenario: the scenario.
        seed: the simulator's seed.
        folder: of the run; the scenario is written there.
        links: the relays for links with faults.
        page: what the base station serves; nothing when it is a text.

    Returns:
        The scenario with every process connected to the router, which is ready; and the task that ends when all other
        processes are ready.

    Raises:
        SupervisionError: a process does not start.
    """
    for attempt in range(1, _PORT_TRIES + 1):
        port = free_port(PORT)
        connected = connected_to(scenario, f"tcp/{HOST}:{port}")
        file = write_scenario(connected, folder)
        links.lead_to(connected.bus.connect[0])
        # The router is started first, so that it is stopped last.
        routing = asyncio.create_task(supervisor.start([router_spec(file)]), name="start the router")
        others = asyncio.create_task(
            supervisor.start(fleet_specs(connected, file, seed, folder, links.endpoints, page)), name="start the fleet"
        )
        try:
            await routing
        except BaseException as error:
            for task in (routing, others):
                task.cancel()
            await asyncio.wait({routing, others})
            for task in (routing, others):
                if not task.cancelled():
                    task.exception()  # retrieved; only the relevant one is raised here
            # Another process may have taken the port between our check and the router's start.
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
    # With the single thread of the other processes a router could not forward large messages.
    environment.pop("ZENOH_RUNTIME", None)
    return ChildSpec("router", muro_command("router", str(file)), environment)


def fleet_specs(
    scenario: Scenario, file: Path, seed: int, folder: Path, relays: Mapping[str, str], page: Offer | str = ""
) -> list[ChildSpec]:
    """All processes of a run except the router: simulator, base station, an agent per robot. When a fault befalls a
    camera, each camera is a process too.

    Args:
        scenario: the scenario.
        file: the file of the scenario.
        seed: the simulator's seed.
        folder: of the run.
        relays: where a process connects instead of to the router, by its name.
        page: what the base station serves; nothing when it is a text.
    """
    environment = _environment()
    simulate = ("sim", str(file), "--seed", str(seed))
    apart = cameras_apart(scenario)
    commands = {
        "simulator": (*simulate, "--bases") if apart else simulate,
        **({camera_process(name): (*simulate, "--camera", name) for name in scenario.camera} if apart else {}),
        "basestation": (
            *("basestation", str(file), "--state", str(folder / "state.json")),
            *(("--no-web",) if isinstance(page, str) else page.options),
        ),
        **{name: ("agent", str(file), name) for name in scenario.robots},
    }
    for name, endpoint in relays.items():
        commands[name] = (*commands[name], "--connect", endpoint)
    return [ChildSpec(name, muro_command(*arguments), environment) for name, arguments in commands.items()]


def muro_command(*arguments: str) -> tuple[str, ...]:
    """The command line of one of our processes.

    Args:
        arguments: the arguments after ``muro``.
    """
    # -P: do not import from a folder "agents" in the operator's current folder.
    return sys.executable, "-P", "-m", "muro_zenoh", *arguments


def _environment() -> dict[str, str]:
    environment = dict(os.environ)
    # The matrices are small; a thread pool in every process would only cost memory and start-up time.
    for library in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        environment.setdefault(library, "1")
    return environment
