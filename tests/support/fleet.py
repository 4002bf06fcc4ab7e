"""A fleet of real processes without a supervisor: the tests kill and start them themselves."""

from __future__ import annotations

import asyncio
import json
import math
import re
import signal
import subprocess
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import zenoh

from muro_zenoh import channels
from muro_zenoh.config import BusSettings, as_table, parse_scenario
from muro_zenoh.control import ring
from muro_zenoh.geometry import Circle
from muro_zenoh.messages import Health, Message, Reply, Truth, VelocityCommand
from muro_zenoh.transport import Bus, Received, open_bus
from tests.support.process import MURO, Process, muro
from tests.support.router import free_port, router_command
from tests.support.waiting import given_again, seconds

_ENVIRONMENT = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


class RealFleet:
    """Router, simulator, base station and agents, and an observer. Made by :func:`real_fleet`.

    Attributes:
        robots: their names.
        endpoint: where the router listens.
        process: what runs, by name (``router``, ``simulator``, ``basestation``, ``r1`` ...).
        bus: the observer's; for looking, not for driving.
    """

    bus: Bus

    def __init__(self, folder: Path, table: Mapping[str, Any], seed: int, env: Mapping[str, str]) -> None:
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        bus = {"mode": "client", "connect": [self.endpoint]}
        scenario = parse_scenario({**table, "bus": bus}, "test", name="test")
        self.robots = scenario.robots
        self.process: dict[str, Process] = {}
        self._file = folder / "scenario.json"
        self._file.write_text(json.dumps(as_table(scenario)))
        self._state = folder / "state.json"
        self._seed = seed
        self._env = {**_ENVIRONMENT, **env}

    # ---- processes

    def start(self, *names: str) -> None:
        """Start processes concurrently, and wait until all are ready."""
        basestation = ["basestation", str(self._file), "--state", str(self._state), "--no-web"]
        commands = {
            "router": router_command(self.endpoint),
            "simulator": [*MURO, "sim", str(self._file), "--seed", str(self._seed)],
            "basestation": [*MURO, *basestation],
        }
        for name in names:
            command = commands.get(name) or [*MURO, "agent", str(self._file), name]
            self.process[name] = Process(command, name=name, env=self._env)
        for name in names:
            self.process[name].ready(30.0)

    def kill(self, name: str) -> float:
        """kill -9; returns the time by the clock of all processes on this machine [s since 1970]."""
        process = self.process[name]
        process.send(signal.SIGKILL)
        at = self.bus.clock.now()
        process.wait()
        process.stop()
        del self.process[name]
        return at

    def close(self) -> None:
        """Stop the remaining processes, the router last."""
        errors = []
        for process in reversed(list(self.process.values())):
            try:
                process.stop()
            except AssertionError as error:
                errors.append(error)
        self.process.clear()
        if errors:
            raise errors[0]

    def muro(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """A command of the operator."""
        return muro(*arguments, "--connect", self.endpoint, env=self._env)

    # ---- observations

    async def observe(self) -> None:
        """Declare the observer's subscriptions."""
        bus = self.bus
        self._truth = bus.latest(channels.TRUTH, "*")
        self._health = bus.latest(channels.HEALTH, "*")
        self._commands = bus.every(channels.CMD_VEL, "*", depth=8192)
        self._odometry = bus.every(channels.ODOMETRY, "*", depth=8192)
        self._circle = bus.latest(channels.CIRCLE)
        self.behaviour = bus.latest(channels.BEHAVIOUR, "*")
        self.stop = bus.latest(channels.STOP)
        self.cal_v = bus.latest(channels.CAL_V, "*")
        self.cal_omega = bus.latest(channels.CAL_OMEGA, "*")
        self.roster = bus.roster()

    async def until(self, condition: Callable[[], bool], limit: float, what: str) -> None:
        """Wait until a condition holds.

        Raises:
            AssertionError: it does not within ``limit`` (scaled) [s]; with the processes' reports.
        """
        loop = asyncio.get_running_loop()
        end = loop.time() + seconds(limit)
        while not condition():
            for process in self.process.values():
                assert process.running, f"{what}: {process.name} ended\n{process.last_lines()}"
            assert loop.time() < end, f"{what}: not within {seconds(limit):g} s\n{self.report()}"
            await asyncio.sleep(0.02)

    async def throughout(self, condition: Callable[[], bool], duration: float, what: str) -> None:
        """Assert that a condition holds all the time."""
        loop = asyncio.get_running_loop()
        end = loop.time() + duration
        while loop.time() < end:
            assert condition(), f"{what}: no longer\n{self.report()}"
            await asyncio.sleep(0.02)

    def report(self) -> str:
        """The state of all processes, for failures."""
        lines = [f"{name}: {h.state} {h.reasons} {h.numbers}" for name, h in self.health.items()]
        places = [f"{name}: {t.x:.3f} {t.y:.3f} {t.theta:.2f} v {t.v:.3f}" for name, t in self.truth.items()]
        return "\n".join([*lines, *places, *(p.last_lines(8) for p in self.process.values())])

    @property
    def health(self) -> dict[str, Health]:
        """The newest health of each process."""
        return {name: received.message for name, received in self._health.values().items()}

    def number(self, name: str, key: str) -> float:
        """A number in a process's health; 0 when it has none."""
        health = self.health.get(name)
        return health.numbers.get(key, 0.0) if health is not None else 0.0

    @property
    def truth(self) -> dict[str, Truth]:
        """The true state of each robot."""
        return {name: received.message for name, received in self._truth.values().items()}

    @property
    def circle(self) -> Circle | None:
        """The circle that the base station keeps."""
        received = self._circle.get()
        return received.message.circle if received is not None else None

    def commands(self) -> list[Received[VelocityCommand]]:
        """All commands since the last call."""
        return self._commands.drain()

    def wheels(self) -> list[Received[Any]]:
        """All odometry since the last call."""
        return self._odometry.drain()

    def holds(self, name: str, reason: str) -> bool:
        """Whether an agent reports that it does not drive for this reason."""
        return any(reason in given for given in self.health[name].reasons) if name in self.health else False

    def driving(self, *names: str) -> bool:
        """Whether these robots (all) actually move."""
        truth = self.truth
        return all(name in truth and abs(truth[name].v) > 0.02 for name in names or self.robots)

    def stationary(self, *names: str) -> bool:
        """Whether these robots (all) are actually stationary."""
        truth = self.truth
        return all(name in truth and abs(truth[name].v) < 0.005 for name in names or self.robots)

    def radius_error(self, names: tuple[str, ...] = ()) -> float:
        """Largest true distance from the circle [m]."""
        circle, truth = self.circle, self.truth
        if circle is None or not set(self.robots) <= set(truth):
            return math.inf
        return max(
            abs(math.hypot(truth[n].x - circle.x, truth[n].y - circle.y) - circle.radius) for n in names or self.robots
        )

    def spacing_error(self, names: tuple[str, ...] = ()) -> float:
        """Largest true |gap - 2 pi / N| of these robots (all) around the circle [rad]."""
        circle, truth = self.circle, self.truth
        names = names or self.robots
        if circle is None or not set(names) <= set(truth):
            return math.inf
        places = {name: (truth[name].x, truth[name].y) for name in names}
        return ring.spacing_error(ring.angles_round(places, circle))

    async def ring(self, names: tuple[str, ...] = (), limit: float = 90.0) -> None:
        """Wait until these robots (all) are spread evenly on the circle, and stay so for a second.

        The bounds are wide, for a machine that has much else to do and robots that stutter; a ring of one robot more or
        less is off by more. How exact a ring is, the score sheets of quiet runs say.
        """
        loop = asyncio.get_running_loop()
        since = math.inf

        def even_for_a_while() -> bool:
            nonlocal since
            even = self.spacing_error(names) < 0.25 and self.radius_error(names) < 0.1
            since = min(since, loop.time()) if even else math.inf
            return loop.time() - since > 1.0

        await self.until(even_for_a_while, limit, f"an even ring of {', '.join(names or self.robots)}")

    async def ask(self, verb: channels.Verb[Any], order: Message) -> Reply:
        """Give an order that must be accepted; one that came when its receiver had just stood still is given again."""
        reply = await given_again(lambda: self.bus.ask(verb, order, timeout=seconds(5)), lambda reply: reply.reason)
        assert reply.accepted, reply.reason
        return reply


@asynccontextmanager
async def real_fleet(
    folder: Path,
    *,
    robots: int = 3,
    behaviour: Mapping[str, Any] | None = None,
    seed: int = 1,
    env: Mapping[str, str] | None = None,
) -> AsyncIterator[RealFleet]:
    """A fleet of real processes that are all ready; all are stopped at the end of the block."""
    table = {
        "robots": robots,
        "all": {"tag_x": -0.03, "tag_y": 0.02, "tag_yaw": 0.2},
        "camera": {"north": {}},
        "behaviour": behaviour or {"name": "pursuit"},
    }
    fleet = RealFleet(folder, table, seed, env or {})
    try:
        fleet.start("router")
        async with open_bus(BusSettings(connect=(fleet.endpoint,)), channels.Role.OPERATOR) as bus:
            fleet.bus = bus
            await fleet.observe()
            fleet.start("simulator", "basestation", *fleet.robots)
            yield fleet
    finally:
        fleet.close()


def stranger(endpoint: str) -> zenoh.Session:
    """A bare Zenoh session, as of a program without this library."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    return zenoh.open(config)


def find(process: Process, pattern: str, timeout: float = 10.0) -> re.Match[str]:
    """The next line of a process in which a pattern is found; those before it are skipped."""
    while True:
        found = re.search(pattern, process.line("", timeout))
        if found:
            return found
