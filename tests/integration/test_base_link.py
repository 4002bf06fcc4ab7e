"""The link between agent and base on their own machine: with the router killed, a stop and a zero reach the wheels."""

from __future__ import annotations

import asyncio
import json
import signal
from collections.abc import AsyncIterator, Callable
from pathlib import Path

import pytest
import pytest_asyncio

from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.config import BusSettings, as_table, parse_scenario
from muro_zenoh.geometry import Circle as Geometric
from muro_zenoh.messages import BaseState, Behaviour, Circle, FleetSnapshot, Odometry, PoseFix, RobotState, StopOrder
from muro_zenoh.transport import Bus, Every, Received, open_bus
from tests.support.process import Process
from tests.support.router import free_port, router_command
from tests.support.waiting import seconds

pytestmark = pytest.mark.slow

_COVARIANCE = (1e-6, 0.0, 0.0, 0.0, 1e-6, 0.0, 0.0, 0.0, 1e-5)
_DEAD_MAN = "no fresh command"


class Robot:
    """A real agent and a real base with simulated wheels, and the lab around them, which the test plays.

    Attributes:
        process: router, agent and base.
        lab: the base station's side; it says that the robot is where its wheels say.
        wheels: what the base says, heard over the link of the robot's own machine, without the router.
        states: the same for its states.
    """

    lab: Bus
    wheels: Every[Odometry]
    states: Every[BaseState]

    def __init__(self, folder: Path, command_timeout: float) -> None:
        self.router = f"tcp/127.0.0.1:{free_port()}"
        self.link = f"tcp/127.0.0.1:{free_port()}"
        table = {
            "robot": {"r1": {"tag": 1, "base_link": self.link}},
            "bus": {"connect": [self.router]},
            "behaviour": {"name": "circle", "speed": 0.2},
            "timeouts": {"command": command_timeout},
            "separation": {"hold": command_timeout + 0.05},  # what is commanded is obeyed for so long
        }
        self._file = folder / "lab.json"
        self._file.write_text(json.dumps(as_table(parse_scenario(table, "test", name="test"))))
        self.process: dict[str, Process] = {}
        self.newest: Odometry | None = None
        self.heard: list[Received[Odometry]] = []
        self._reports: list[BaseState] = []

    def start(self, name: str) -> None:
        """Start a process, and wait until it is ready."""
        command = ["-m", "muro_zenoh", name, str(self._file), "r1"]
        self.process[name] = Process(router_command(self.router) if name == "router" else command, name=name)
        self.process[name].ready(30.0)

    def kill(self, name: str) -> float:
        """kill -9; the time [s since 1970]."""
        process = self.process.pop(name)
        process.kill()
        at = self.lab.clock.now()
        process.stop()
        return at

    async def play(self) -> None:
        """Be the lab: stop state, behaviour, circle, the robot's pose and all positions, 20 times a second."""
        lab = self.lab
        poses, everybody = lab.publisher(channels.POSE, "r1"), lab.publisher(channels.ALL_POSITIONS)
        stop, circle = lab.publisher(channels.STOP), lab.publisher(channels.CIRCLE)
        behaviour = lab.publisher(channels.BEHAVIOUR, "r1")
        while True:
            self.heard += self.wheels.drain()
            stop.put(StopOrder(all=False, revision=1))
            circle.put(Circle.of(Geometric(0.0, 0.5, 0.5)))
            behaviour.put(Behaviour(behaviour="circle", parameters={"speed": 0.2}))
            if self.heard:
                o = self.newest = self.heard[-1].message
                poses.put(PoseFix(x=o.x, y=o.y, theta=o.theta, covariance=_COVARIANCE, camera="north", age=0.0))
                row = RobotState("r1", o.x, o.y, o.theta, o.v, o.omega, 0.0, "tracking")
                everybody.put(FleetSnapshot(robots=(row,)))
            await asyncio.sleep(0.05)

    def reports(self) -> list[BaseState]:
        """The base's states since the last :meth:`forget`."""
        self._reports += [state.message for state in self.states.drain()]
        return self._reports

    def forget(self) -> None:
        """Forget the base's states so far."""
        self.states.drain()
        self._reports.clear()

    @property
    def speed(self) -> float:
        """Of the wheels [m/s]."""
        return self.newest.v if self.newest is not None else 0.0

    async def until(self, condition: Callable[[], bool], limit: float, what: str) -> None:
        """Wait until a condition holds."""
        end = asyncio.get_running_loop().time() + seconds(limit)
        while not condition():
            lines = "\n".join(p.last_lines(10) for p in self.process.values())
            assert asyncio.get_running_loop().time() < end, f"{what}: not within {seconds(limit):g} s\n{lines}"
            await asyncio.sleep(0.02)


@pytest_asyncio.fixture
async def robot(tmp_path: Path, request: pytest.FixtureRequest) -> AsyncIterator[Robot]:
    """The agent first, then its base: it has to be found when it comes. The parameter is the dead-man's timeout [s]."""
    there = Robot(tmp_path, getattr(request, "param", 0.3))
    try:
        there.start("router")
        there.start("agent")
        there.start("base")
        settings = BusSettings(connect=(there.router,)), BusSettings(connect=(there.link,))
        async with open_bus(settings[0], Role.BASESTATION) as lab, open_bus(settings[1], Role.OPERATOR) as beside:
            there.lab = lab
            there.wheels = beside.every(channels.ODOMETRY, "r1", depth=4096)
            there.states = beside.every(channels.BASE, "r1", depth=4096)
            playing = asyncio.create_task(there.play())
            try:
                await there.until(lambda: there.speed > 0.18, 15, "the robot drives")
                yield there
            finally:
                playing.cancel()
                await asyncio.wait({playing})
    finally:
        for process in reversed(list(there.process.values())):
            process.stop()


def _started_to_brake(robot: Robot, since: float) -> float:
    """How long after a time the wheels were first slower than before [s]."""
    return next(o.message.stamp for o in robot.heard if o.message.stamp > since and o.message.v < 0.17) - since


without_dead_man = pytest.mark.parametrize("robot", [1.0], indirect=True)
"""It acts after the agent's zero, which comes by the age of the poses, though the machine stand still meanwhile."""


@without_dead_man
async def test_without_the_router_zero_comes_over_the_link_and_then_the_router_is_back(robot: Robot) -> None:
    robot.forget()
    killed = robot.kill("router")
    await robot.until(lambda: robot.speed < 0.005, 5, "the wheels are at zero")
    # By the age of the poses, which is 0.25 s, and not by the dead-man.
    assert _started_to_brake(robot, killed) < seconds(0.9)
    await asyncio.sleep(1.2)  # longer than any timeout: zero keeps coming
    assert robot.speed < 0.005
    # The agent's zero was there before the dead-man would have acted; without the link the dead-man has to.
    assert robot.reports()
    assert not any(state.dead_man for state in robot.reports())
    robot.start("router")
    await robot.until(lambda: robot.speed > 0.18, 15, "the robot drives when the router is back")
    output = robot.process["base"].last_lines()
    assert _DEAD_MAN not in output, output
    assert "of the same writer" not in output, output  # nothing arrives twice


@without_dead_man
async def test_each_message_arrives_once_and_a_base_that_comes_back_is_found(robot: Robot) -> None:
    roster, health = robot.lab.roster(), robot.lab.latest(channels.HEALTH, "r1")
    await robot.until(lambda: roster.of(Role.AGENT) == roster.of(Role.BASE) == {"r1"}, 5, "the lab sees both")
    await robot.until(lambda: health.get() is not None, 5, "a report of the agent")
    first = health.get()
    await robot.until(lambda: health.get() not in (None, first), 5, "another one")
    await robot.until(lambda: (h := health.get()) is not None and h.message.seq > 3, 5, "a few more")
    report = health.get()
    assert report is not None
    stamp = report.message.stamp
    await robot.until(lambda: robot.newest is not None and robot.newest.stamp > stamp, 5, "odometry after it")
    newest = robot.newest
    assert newest is not None
    assert report.message.numbers["odometry_received"] <= newest.seq  # one each, over the router or beside it
    robot.kill("base")
    robot.start("base")

    def driven_anew() -> bool:
        return robot.newest is not None and robot.newest.epoch != newest.epoch and robot.speed > 0.18

    # Its observer is a client of the base, and finds it again as the agent does.
    await robot.until(driven_anew, 15, "the robot drives with its new base")
    robot.forget()
    robot.kill("router")
    await robot.until(lambda: robot.speed < 0.005, 5, "the wheels are at zero")
    await robot.until(lambda: bool(robot.reports()), 5, "a report of the base")
    assert not any(state.dead_man for state in robot.reports())


async def test_a_base_that_was_frozen_obeys_no_command_of_before(robot: Robot) -> None:
    base = robot.process["base"]
    base.send(signal.SIGSTOP)
    await asyncio.sleep(0.4)  # commands pile up before it
    robot.kill("agent")
    await asyncio.sleep(0.4)
    base.forget()
    received = base.last_lines().count("receiving commands")
    base.send(signal.SIGCONT)
    base.line("", 5)  # its dead-man
    await robot.until(lambda: robot.speed < 0.005, 5, "the wheels are at zero")
    await asyncio.sleep(0.5)
    output = base.last_lines()
    assert _DEAD_MAN in output, output
    assert output.count("receiving commands") <= received, output


async def test_two_bases_cannot_listen_at_one_endpoint(robot: Robot) -> None:
    with Process(["-m", "muro_zenoh", "base", str(robot._file), "r1"], name="twin") as twin:
        assert twin.wait(20) == 1
        assert f"could not open a peer on {robot.link}" in twin.last_lines()
