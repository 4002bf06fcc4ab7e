"""The control task between the bus and the control loop, in virtual time: what it takes from where, and when."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any

import pytest

from agents.control_loop import Outgoing, Surroundings
from agents.master import Master
from agents.tasks.control import Listener, Sender, Signals, control
from muro_zenoh import channels
from muro_zenoh.behaviours.interface import Need, Snapshot
from muro_zenoh.channels import Channel
from muro_zenoh.messages import Circle, FleetSnapshot, Odometry, PoseFix, SpeedReference, VelocityCommand
from muro_zenoh.runtime.virtual_time import VirtualClock, run_virtually
from muro_zenoh.transport import Bus, MemoryNetwork, Publisher, make_bus
from tests.support.clock import ManualClock

COVARIANCE = (1e-6, 0.0, 0.0, 0.0, 1e-6, 0.0, 0.0, 0.0, 1e-5)


class Loop:
    """A control loop that records its updates and has one command to send."""

    def __init__(self) -> None:
        self.changed = False
        self.seen: object | None = None
        self.updates: list[
            tuple[float, list[tuple[float, PoseFix]], list[tuple[float, float, float]], Surroundings]
        ] = []
        self.earlier: list[Snapshot] = []
        self.ended: list[float] = []

    def update(self, now: float, fixes: Any, odometry: Any, around: Surroundings, earlier: Any) -> Outgoing:
        self.earlier.extend(earlier)
        self.updates.append((now, list(fixes), list(odometry), around))
        return [(channels.CMD_VEL, VelocityCommand(v=0.2, omega=0.1))]

    def end(self, now: float) -> Outgoing:
        self.ended.append(now)
        return [(channels.CMD_VEL, VelocityCommand(v=0.0, omega=0.0))]


@dataclass
class Running:
    """The task, its loop, and another process's side of the bus."""

    other: Bus
    clock: VirtualClock
    loop: Loop
    signals: Signals
    task: asyncio.Task[None]

    def fix(self, age: float = 0.0) -> None:
        self.other.publisher(channels.POSE, "r1").put(
            PoseFix(x=0.1, y=0.2, theta=0.3, covariance=COVARIANCE, camera="north", age=age)
        )


@asynccontextmanager
async def running() -> AsyncIterator[Running]:
    network, clock = MemoryNetwork(), VirtualClock()
    async with make_bus(network.link(), clock=clock) as bus, make_bus(network.link(), clock=clock) as other:
        loop, signals = Loop(), Signals()
        working: Coroutine[Any, Any, None] = control(
            bus,
            "r1",
            loop,  # type: ignore[arg-type]
            Listener(bus, "r1", Master(bus, "r1")),
            Sender(bus, "r1"),
            signals,
        )
        task = asyncio.create_task(working)
        await asyncio.sleep(0)
        yield Running(other, clock, loop, signals, task)
        task.cancel()
        await asyncio.wait({task})


def virtual(test: Callable[[Running], Coroutine[Any, Any, None]]) -> Callable[[], None]:
    """A test in virtual time, with a task of its own."""

    async def main() -> None:
        async with running() as there:
            await test(there)

    def run() -> None:
        run_virtually(main())

    run.__name__, run.__doc__ = test.__name__, test.__doc__
    return run


@virtual
async def test_the_loop_is_updated_at_each_fix_with_its_time_of_capture(there: Running) -> None:
    began = there.clock.now()
    await asyncio.sleep(0.05)
    there.fix(age=0.03)
    await asyncio.sleep(0.001)
    ((now, ((captured, fix),), odometry, _),) = there.loop.updates
    assert (now, captured) == pytest.approx((began + 0.05, began + 0.02))
    assert (fix.x, fix.y, odometry) == (0.1, 0.2, [])


@virtual
async def test_where_fixes_are_overdue_the_loop_is_updated_each_75_ms(there: Running) -> None:
    began = there.clock.now()
    await asyncio.sleep(0.23)
    assert [now - began for now, *_ in there.loop.updates] == pytest.approx([0.075, 0.15, 0.225])
    assert all(fixes == [] for _, fixes, *_ in there.loop.updates)
    assert there.signals.latencies == []


@virtual
async def test_all_that_has_come_is_taken_at_once(there: Running) -> None:
    for speed in (0.1, 0.2):
        there.other.publisher(channels.ODOMETRY, "r1").put(Odometry(x=0.0, y=0.0, theta=0.0, v=speed, omega=-speed))
    there.other.publisher(channels.ODOMETRY, "r2").put(Odometry(x=0.0, y=0.0, theta=0.0, v=9.0, omega=9.0))
    there.fix()
    there.fix()
    await asyncio.sleep(0.001)
    ((now, fixes, odometry, _),) = there.loop.updates
    assert [captured for captured, _ in fixes] == pytest.approx([now, now])
    assert odometry == [pytest.approx((now, 0.1, -0.1)), pytest.approx((now, 0.2, -0.2))]


@virtual
async def test_the_time_from_a_fix_to_its_command_is_kept_for_the_report(there: Running) -> None:
    update = there.loop.update

    def slow(*given: Any) -> Outgoing:
        there.clock.now = lambda: now() + 0.007  # type: ignore[method-assign]
        return update(*given)

    now = there.clock.now
    there.loop.update = slow  # type: ignore[method-assign]
    there.fix()
    await asyncio.sleep(0.001)
    assert there.signals.latencies == [pytest.approx(0.007, abs=1e-6)]


@virtual
async def test_what_has_changed_and_the_first_pose_wake_the_other_tasks(there: Running) -> None:
    there.fix()
    await asyncio.sleep(0.001)
    assert not there.signals.changed.is_set()
    assert not there.signals.located.is_set()
    there.loop.changed = True
    there.fix()
    await asyncio.sleep(0.001)
    assert there.signals.changed.is_set()
    assert not there.signals.located.is_set()
    there.loop.seen = object()
    there.fix()
    await asyncio.sleep(0.001)
    assert there.signals.located.is_set()


@virtual
async def test_zero_is_sent_when_the_task_ends(there: Running) -> None:
    sent = there.other.every(channels.CMD_VEL, "r1")
    there.fix()
    await asyncio.sleep(0.001)
    there.task.cancel()
    await asyncio.wait({there.task})
    assert there.task.cancelled()
    assert there.loop.ended == [there.clock.now()]
    assert [(command.message.v, command.message.omega) for command in sent.drain()] == [(0.2, 0.1), (0.0, 0.0)]


# ---- what is sent


async def test_a_channel_is_declared_with_its_first_message_and_once(monkeypatch: pytest.MonkeyPatch) -> None:
    declared: list[tuple[str, str]] = []
    declare = Bus.publisher

    def publisher(bus: Bus, channel: Channel[Any], name: str = "", **options: Any) -> Publisher[Any]:
        declared.append((channel.word, name))
        return declare(bus, channel, name, **options)

    monkeypatch.setattr(Bus, "publisher", publisher)
    async with make_bus(MemoryNetwork().link()) as bus:
        sender = Sender(bus, "r1")
        command = (channels.CMD_VEL, VelocityCommand(v=0.1, omega=0.0))
        sender.send([command])
        sender.send([command, (channels.VELOCITY, SpeedReference(speed=0.1)), command])
    assert declared == [("cmd_vel", "r1"), ("velocity", "r1")]


# ---- what is received


@asynccontextmanager
async def listening() -> AsyncIterator[tuple[Listener, Bus, ManualClock]]:
    network, clock = MemoryNetwork(), ManualClock()
    async with make_bus(network.link(), clock=clock) as bus, make_bus(network.link(), clock=clock) as other:
        yield Listener(bus, "r1", Master(bus, "r1")), other, clock


async def test_a_behaviour_that_needs_nothing_is_shown_nothing() -> None:
    async with listening() as (listener, other, clock):
        other.publisher(channels.CIRCLE).put(Circle(x=0.1, y=0.2, radius=0.7))
        other.publisher(channels.VELOCITY, "r1").put(SpeedReference(speed=0.2))
        listener.need(frozenset())
        assert listener.surroundings(clock.now()) == Surroundings()


async def test_the_circle_is_shown_however_old_it_is_and_over_a_change_of_behaviour() -> None:
    async with listening() as (listener, other, clock):
        listener.need(frozenset({Need.CIRCLE}))
        assert listener.surroundings(clock.now()).circle is None
        other.publisher(channels.CIRCLE).put(Circle(x=0.1, y=0.2, radius=0.7, clockwise=True))
        clock.advance(1e4)
        for needs in (frozenset({Need.CIRCLE, Need.SNAPSHOT}), frozenset({Need.CIRCLE}), frozenset({Need.SPEED})):
            circle = listener.surroundings(clock.now()).circle
            assert circle is not None
            assert (circle.x, circle.y, circle.radius, circle.clockwise) == (0.1, 0.2, 0.7, True)
            mailbox = listener._circle
            listener.need(needs)
            assert (listener._circle is mailbox) == (Need.CIRCLE in needs)
        assert listener.surroundings(clock.now()) == Surroundings()


async def test_what_the_next_behaviour_does_not_need_is_not_received() -> None:
    async with listening() as (listener, other, _):
        listener.need(frozenset({Need.CIRCLE, Need.SNAPSHOT}))
        listener.need(frozenset())
        before = {word: counter.received for word, counter in listener._bus.counters.items()}
        other.publisher(channels.CIRCLE).put(Circle(x=0.1, y=0.2, radius=0.7))
        other.publisher(channels.ALL_POSITIONS).put(FleetSnapshot(robots=()))
        assert {word: counter.received for word, counter in listener._bus.counters.items()} == before


@pytest.mark.parametrize(("age", "fresh"), [(0.25, True), (0.5, True), (0.51, False), (60.0, False)])
async def test_a_speed_is_shown_for_half_a_second_and_its_age_for_good(age: float, fresh: bool) -> None:
    async with listening() as (listener, other, clock):
        listener.need(frozenset({Need.SPEED}))
        assert listener.surroundings(clock.now())[1:3] == (None, math.inf)
        other.publisher(channels.VELOCITY, "r2").put(SpeedReference(speed=0.9))
        other.publisher(channels.VELOCITY, "r1").put(SpeedReference(speed=0.2))
        clock.advance(age)
        around = listener.surroundings(clock.now())
        assert (around.speed, around.speed_age) == (0.2 if fresh else None, pytest.approx(age))


async def test_a_speed_for_the_behaviour_before_is_not_one_for_the_next() -> None:
    async with listening() as (listener, other, clock):
        out = other.publisher(channels.VELOCITY, "r1")
        listener.need(frozenset({Need.SPEED}))
        out.put(SpeedReference(speed=0.2))
        listener.need(frozenset({Need.SPEED}))
        assert listener.surroundings(clock.now()).speed is None
        out.put(SpeedReference(speed=0.3))
        assert listener.surroundings(clock.now()).speed == 0.3
        closed = listener._speed
        listener.need(frozenset())
        out.put(SpeedReference(speed=0.4))
        assert listener.surroundings(clock.now()).speed is None
        assert closed is not None
        assert closed._inbox._closed


async def test_every_snapshot_is_shown_the_newest_apart_and_each_once() -> None:
    """Two cameras give two a period, and robots that drive by different ones keep apart by both."""
    async with listening() as (listener, other, clock):
        out = other.publisher(channels.ALL_POSITIONS)

        def shown() -> tuple[float | None, list[float]]:
            now = clock.now()
            newest = listener.surroundings(now).snapshot
            return newest and newest.stamp, [snapshot.stamp for snapshot in listener.earlier]

        listener.need(frozenset({Need.SNAPSHOT}))
        assert shown() == (None, [])
        stamps = []
        for _ in range(3):
            clock.advance(0.025)
            stamps.append(out.put(FleetSnapshot(robots=())).stamp)
        assert shown() == (stamps[2], stamps[:2])
        assert shown() == (stamps[2], [])
        clock.advance(0.51)
        assert shown() == (None, [])
        out.put(FleetSnapshot(robots=()))
        clock.advance(0.51)
        newer = out.put(FleetSnapshot(robots=())).stamp
        assert shown() == (newer, []), "one that is stale is not shown"
