"""The base and its dead-man: what the wheels are told, and what they are never told."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from typing import Any

import msgspec
import pytest
import pytest_asyncio

from agents.base.base import DEAD_MAN, run_base
from agents.base.wheels import WheelReading
from muro_zenoh import channels
from muro_zenoh.messages import BaseState, Odometry, VelocityCommand
from muro_zenoh.transport import Bus, MemoryNetwork, make_bus
from muro_zenoh.transport.mailboxes import Every
from tests.support.clock import ManualClock
from tests.support.leaks import no_task_left
from tests.support.waiting import within

__all__ = ["no_task_left"]


@dataclass
class Wheels:
    """Wheels that note what they are told."""

    reading: WheelReading = field(default_factory=lambda: WheelReading(1.0, 2.0, 0.5, 0.1, -0.2, battery=0.7))
    told: list[tuple[float, float]] = field(default_factory=list)

    def command(self, v: float, omega: float) -> None:
        self.told.append((v, omega))

    def read(self) -> WheelReading:
        return self.reading

    @property
    def now(self) -> tuple[float, float] | None:
        """What they do."""
        return self.told[-1] if self.told else None


@dataclass
class Lab:
    """A base that runs, and an agent's side of the bus."""

    bus: Bus
    network: MemoryNetwork
    clock: ManualClock
    wheels: Wheels
    odometry: Every[Odometry]
    states: Every[BaseState]
    task: asyncio.Task[None]

    async def beat(self, beats: int = 2) -> Odometry:
        """Let the base beat; its last odometry. Its beat is the loop's time, its ages are the clock's."""
        self.odometry.drain()
        for _ in range(beats):
            got = await within(5, self.odometry.next(), "an odometry")
        return got.message

    async def command(self, v: float, omega: float, stamp: float | None = None) -> None:
        """What an agent sends, and a beat of the base."""
        message = VelocityCommand(v=v, omega=omega, stamp=stamp if stamp is not None else self.clock.now())
        self._out.put(message)
        await self.beat()

    @property
    def _out(self) -> Any:
        if not hasattr(self, "_publisher"):
            self._publisher = self.bus.publisher(channels.CMD_VEL, "r1")
        return self._publisher

    async def state(self) -> BaseState:
        """The newest state that the base said."""
        await self.beat()
        said = self.states.drain()
        return said[-1].message


@pytest_asyncio.fixture
async def lab() -> AsyncIterator[Lab]:
    network, clock, wheels = MemoryNetwork(), ManualClock(), Wheels()
    async with make_bus(network.link(), clock=clock) as bus, make_bus(network.link(), clock=clock) as agent:
        odometry = agent.every(channels.ODOMETRY, "r1", depth=1024)
        states = agent.every(channels.BASE, "r1", depth=1024)
        task = asyncio.create_task(run_base(bus, "r1", wheels, clock))
        yield Lab(agent, network, clock, wheels, odometry, states, task)
        task.cancel()
        await asyncio.wait({task})


async def test_before_any_command_the_wheels_stand(lab: Lab) -> None:
    await lab.beat()
    assert set(lab.wheels.told) == {(0.0, 0.0)}
    assert (await lab.state()).dead_man


async def test_a_fresh_command_is_obeyed(lab: Lab) -> None:
    await lab.command(0.2, -0.5)
    assert lab.wheels.now == (0.2, -0.5)
    assert not (await lab.state()).dead_man


async def test_the_newest_command_is_obeyed(lab: Lab) -> None:
    for speed in (0.1, 0.2, 0.3):
        lab._out.put(VelocityCommand(v=speed, omega=0.0))
    await lab.beat()
    assert lab.wheels.now == (0.3, 0.0)


async def test_a_command_holds_as_long_as_it_is_fresh_and_not_longer(lab: Lab) -> None:
    await lab.command(0.2, 0.0)
    lab.clock.advance(DEAD_MAN - 0.01)
    await lab.beat()
    assert lab.wheels.now == (0.2, 0.0)
    lab.clock.advance(0.02)
    await lab.beat()
    assert lab.wheels.now == (0.0, 0.0)
    assert (await lab.state()).dead_man


async def test_the_dead_man_zeroes_again_and_again_and_lets_go_at_the_next_command(lab: Lab) -> None:
    await lab.command(0.2, 0.0)
    lab.clock.advance(1.0)
    await lab.beat()
    told = len(lab.wheels.told)
    await lab.beat(3)
    assert lab.wheels.told[told:]
    assert set(lab.wheels.told[told:]) == {(0.0, 0.0)}
    await lab.command(0.15, 0.0)
    assert lab.wheels.now == (0.15, 0.0)
    assert not (await lab.state()).dead_man


async def test_the_dead_man_is_said_once_an_episode(lab: Lab, caplog: pytest.LogCaptureFixture) -> None:
    for _ in range(2):
        await lab.command(0.2, 0.0)
        lab.clock.advance(1.0)
        await lab.beat(4)
    assert [r.message for r in caplog.records if r.levelname == "WARNING"] == [
        "r1: no fresh command for 0.3 s, wheels at zero"
    ] * 2


async def test_a_backlog_is_no_command(lab: Lab) -> None:
    await lab.command(0.2, 0.0)
    # The link was cut; what the agent said meanwhile comes at once when it is there again.
    began = lab.clock.now()
    lab.clock.advance(2.0)
    await lab.beat()
    for late in (0.1, 0.5, 1.0, 1.6):
        await lab.command(0.3, 0.0, stamp=began + late)
        assert lab.wheels.now == (0.0, 0.0)
    await lab.command(0.1, 0.0)
    assert lab.wheels.now == (0.1, 0.0)


async def test_what_is_left_of_a_late_commands_time_is_all_it_gets(lab: Lab) -> None:
    await lab.command(0.2, 0.0)
    lab.clock.advance(0.5)
    await lab.beat()
    await lab.command(0.3, 0.0, stamp=lab.clock.now() - 0.2)
    assert lab.wheels.now == (0.3, 0.0)
    lab.clock.advance(0.15)
    await lab.beat()
    assert lab.wheels.now == (0.0, 0.0)


async def test_a_clock_of_the_agents_own_does_not_matter(lab: Lab) -> None:
    await lab.command(0.2, 0.0, stamp=5.0)
    assert lab.wheels.now == (0.2, 0.0)
    lab.clock.advance(0.1)
    await lab.command(0.25, 0.0, stamp=5.1)
    assert lab.wheels.now == (0.25, 0.0)


async def test_who_is_commanded_by_two_stands(lab: Lab, caplog: pytest.LogCaptureFixture) -> None:
    async with make_bus(lab.network.link(), clock=lab.clock) as twin:
        other = twin.publisher(channels.CMD_VEL, "r1")
        await lab.command(0.2, 0.0)
        for _ in range(4):  # one has heard a stop, the other has not
            lab.clock.advance(0.1)
            other.put(VelocityCommand(v=0.0, omega=0.0))
            await lab.beat()
            assert lab.wheels.now == (0.0, 0.0)
            lab.clock.advance(0.1)
            told = len(lab.wheels.told)
            await lab.command(0.2, 0.0)
            assert set(lab.wheels.told[told:]) == {(0.0, 0.0)}
    assert [r.message for r in caplog.records if "two processes" in r.message] == [
        "r1: two processes command these wheels, which stand: is an agent running twice?"
    ]
    for _ in range(3):  # one alone is obeyed again
        lab.clock.advance(0.1)
        await lab.command(0.2, 0.0)
    assert lab.wheels.now == (0.2, 0.0)


async def test_an_agent_that_starts_again_is_obeyed_when_the_old_ones_command_has_ended(lab: Lab) -> None:
    await lab.command(0.2, 0.0)
    lab.clock.advance(DEAD_MAN + 0.01)
    async with make_bus(lab.network.link(), clock=lab.clock) as again:
        again.publisher(channels.CMD_VEL, "r1").put(VelocityCommand(v=0.1, omega=0.0))
        await lab.beat()
        assert lab.wheels.now == (0.1, 0.0)


@pytest.mark.parametrize("hazard", ["bumper", "cliff", "wheel_drop"])
async def test_a_hazard_stops_the_wheels_at_once_and_as_long_as_it_lasts(lab: Lab, hazard: str) -> None:
    await lab.command(0.2, 0.1)
    lab.wheels.reading = lab.wheels.reading._replace(**{hazard: True})
    await lab.beat()
    assert lab.wheels.now == (0.0, 0.0)
    told = len(lab.wheels.told)
    await lab.command(0.2, 0.1)
    assert set(lab.wheels.told[told:]) == {(0.0, 0.0)}
    assert getattr(await lab.state(), hazard)
    lab.wheels.reading = lab.wheels.reading._replace(**{hazard: False})
    await lab.command(0.2, 0.1)
    assert lab.wheels.now == (0.2, 0.1)
    assert not getattr(await lab.state(), hazard)


async def test_charging_alone_stops_nobody(lab: Lab) -> None:
    lab.wheels.reading = lab.wheels.reading._replace(charging=True)
    await lab.command(0.2, 0.1)
    assert lab.wheels.now == (0.2, 0.1)
    assert (await lab.state()).charging


@pytest.mark.parametrize(
    "payload",
    [b"garbage", b"\x83\xa5stamp\xcb\x41\x00\x00\x00\x00\x00\x00\x00\xa1v\xcb\x7f\xf8\x00\x00\x00\x00\x00\x00"],
    ids=["noise", "NaN"],
)
async def test_garbage_neither_drives_nor_keeps_a_command_alive(lab: Lab, payload: bytes) -> None:
    await lab.command(0.2, 0.0)
    for _ in range(5):
        lab.clock.advance(0.1)
        lab.network.put("muro/cmd_vel/r1", payload)
        await lab.beat()
    assert lab.wheels.now == (0.0, 0.0)


async def test_infinite_speeds_are_no_command(lab: Lab) -> None:
    await lab.command(0.2, 0.0)
    for bad in (float("nan"), float("inf")):
        raw = msgspec.msgpack.encode({"stamp": lab.clock.now(), "v": bad, "omega": 0.0})
        lab.network.put("muro/cmd_vel/r1", raw)
        await lab.beat()
        assert lab.wheels.now == (0.2, 0.0)


async def test_odometry_is_what_the_wheels_read_with_its_time(lab: Lab) -> None:
    lab.clock.advance(7.0)
    got = await lab.beat()
    assert (got.x, got.y, got.theta, got.v, got.omega) == (1.0, 2.0, 0.5, 0.1, -0.2)
    assert got.stamp == lab.clock.now()


async def test_the_state_is_said_on_change_and_twice_a_second(lab: Lab) -> None:
    assert (await lab.state()).battery == 0.7
    await lab.beat(3)
    assert lab.states.drain() == []  # nothing has changed, and no time has passed
    lab.clock.advance(0.5)
    await lab.beat()
    assert len(lab.states.drain()) == 1
    lab.wheels.reading = lab.wheels.reading._replace(battery=0.5)
    await lab.beat()
    assert [said.message.battery for said in lab.states.drain()] == [0.5]


async def test_who_is_cancelled_leaves_the_wheels_at_zero(lab: Lab) -> None:
    await lab.command(0.2, 0.1)
    lab.task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await within(1, lab.task, "the end")
    assert lab.wheels.now == (0.0, 0.0)


async def test_wheels_that_fail_end_the_base_with_the_wheels_at_zero(lab: Lab) -> None:
    await lab.command(0.2, 0.1)

    def broken() -> WheelReading:
        raise OSError("the serial line is gone")

    lab.wheels.read = broken  # type: ignore[method-assign]
    with pytest.raises(OSError, match="serial line"):
        await within(1, lab.task, "the end")
    assert lab.wheels.now == (0.0, 0.0)
