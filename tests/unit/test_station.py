"""The base station on the in-memory bus: orders, kept state, snapshots, liveness."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractAsyncContextManager, AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import pytest

from basestation.fleet.state_store import StateStore
from basestation.localization.localizer import Localizer
from basestation.localization.of_scenario import make_fusion
from basestation.localization.sightings import Sighting, Sightings
from basestation.station import Station
from basestation.tasks.positions import PositionsTask
from basestation.tasks.vision import cameras_on_bus
from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.config import parse_scenario
from muro_zenoh.errors import NoReply, TransportError
from muro_zenoh.geometry import Pose2
from muro_zenoh.messages import Clear, Estimate, Frame, Health, Message, Reply, Resume, SetBehaviour, SetCircle, Stop
from muro_zenoh.runtime.clock import Clock, SystemClock
from muro_zenoh.runtime.virtual_time import VirtualClock, run_virtually
from muro_zenoh.transport import Bus, MemoryNetwork, make_bus
from tests.support.waiting import given_again, seconds, within

T = TypeVar("T", bound=Message)

LAB = parse_scenario({"robots": 2, "behaviour": {"name": "circle"}}, "lab.toml", name="lab")
SEEN = parse_scenario({"robots": 2, "camera": {"north": {}}}, "lab.toml", name="lab")
NO_CAMERA = "no camera in the settings: no robot drives without poses"
BLANK = bytes(1280 * 720)
SURE = (1e-6, 0.0, 0.0, 0.0, 1e-6, 0.0, 0.0, 0.0, 1e-6)


@dataclass
class Lab:
    """A network, and the test's own bus on it."""

    network: MemoryNetwork
    stack: AsyncExitStack
    bus: Bus

    async def join(self) -> Bus:
        return await self.stack.enter_async_context(make_bus(self.network.link(), clock=self.bus.clock))

    async def ask(self, verb: channels.Verb[T], order: T) -> Reply:
        """The answer to an order, however long it takes; given again where the loop had just stood still."""
        return await given_again(lambda: self.bus.ask(verb, order, timeout=seconds(30)), lambda reply: reply.reason)

    async def agent(self, name: str, **stop: object) -> Bus:
        """An agent that is alive and has reported its health."""
        bus = await self.join()
        bus.announce(Role.AGENT, name)
        health = Health(role="agent", state="x", **stop)  # type: ignore[arg-type]
        bus.publisher(channels.HEALTH, name).put(health)
        return bus


@asynccontextmanager
async def lab(clock: Clock | None = None) -> AsyncIterator[Lab]:
    """In virtual time."""
    network = MemoryNetwork()
    async with AsyncExitStack() as stack:
        bus = await stack.enter_async_context(make_bus(network.link(), clock=clock or VirtualClock()))
        yield Lab(network, stack, bus)


def real_lab() -> AbstractAsyncContextManager[Lab]:
    """In real time, for what runs in threads."""
    return lab(SystemClock())


@asynccontextmanager
async def station(there: Lab, state: Path | None = None) -> AsyncIterator[None]:
    """A base station that runs."""
    async with make_bus(there.network.link(), clock=there.bus.clock) as bus:
        task = asyncio.create_task(Station(bus, LAB, state, []).run())
        try:
            yield
        finally:
            task.cancel()
            await asyncio.wait({task})


def test_the_kept_state_is_published_twice_a_second() -> None:
    async def main() -> None:
        async with lab() as there, station(there):
            stops = there.bus.every(channels.STOP)
            circles = there.bus.every(channels.CIRCLE)
            behaviours = there.bus.every(channels.BEHAVIOUR, "*")
            await asyncio.sleep(3.0)
            for inbox, count in ((stops, 6), (circles, 6), (behaviours, 12)):
                assert count - 2 <= len(inbox.drain()) <= count + 2

    run_virtually(main())


def test_orders_are_answered_and_published_at_once() -> None:
    async def main() -> None:
        async with lab() as there, station(there):
            stop, circle = there.bus.latest(channels.STOP), there.bus.latest(channels.CIRCLE)
            behaviour = there.bus.latest(channels.BEHAVIOUR, "*")
            await asyncio.sleep(1.25)
            ask = there.bus.ask
            assert (await ask(channels.SET_CIRCLE, SetCircle(radius=0.6))).accepted
            assert (await ask(channels.SET_BEHAVIOUR, SetBehaviour(behaviour="hold", names=("r2",)))).accepted
            assert (await ask(channels.STOP_ORDER, Stop(names=("r1",)))).accepted
            await asyncio.sleep(0.001)
            newest = stop.get()
            assert newest is not None
            assert newest.message.names == ("r1",)
            got = circle.get()
            assert got is not None
            assert got.message.radius == 0.6
            assert behaviour.values()["r2"].message.behaviour == "hold"
            assert (await ask(channels.RESUME, Resume(revision=newest.message.revision))).accepted
            refused = await ask(channels.SET_CIRCLE, SetCircle(radius=5.0))
            assert (refused.accepted, "inside the arena" in refused.reason) == (False, True)
            refused = await ask(channels.CLEAR, Clear(name="r1"))
            assert (refused.accepted, refused.reason) == (False, "robot r1 was never seen")

    run_virtually(main())


async def test_no_order_is_taken_once_the_base_station_shuts_down(tmp_path: Path) -> None:
    """Nothing would publish it: an operator has to see that nobody keeps the stop."""
    async with real_lab() as there, make_bus(there.network.link()) as bus:
        ending = Station(bus, LAB, tmp_path / "state.json", [])
        task = asyncio.create_task(ending.run())
        await within(5, there.bus.latest(channels.STOP).next(), "the stop state")
        under_way = asyncio.create_task(there.ask(channels.STOP_ORDER, Stop()))
        await asyncio.sleep(0)  # it is sent, and not taken yet
        ending._orders.close()
        refused = await under_way
        assert (refused.accepted, refused.reason) == (False, "the base station is shutting down")
        task.cancel()
        await asyncio.wait({task})
        with pytest.raises(NoReply):
            await there.ask(channels.STOP_ORDER, Stop())
        assert not ending.store.stop.all


def test_a_base_station_that_ends_takes_no_more_orders() -> None:
    async def main() -> None:
        async with lab() as there, make_bus(there.network.link(), clock=there.bus.clock) as bus:
            task = asyncio.create_task(Station(bus, LAB, None, []).run())
            await asyncio.sleep(1.0)
            assert (await there.bus.ask(channels.STOP_ORDER, Stop())).accepted
            task.cancel()
            await asyncio.wait({task})
            with pytest.raises(NoReply):
                await there.bus.ask(channels.STOP_ORDER, Stop())

    run_virtually(main())


def test_a_resume_is_refused_until_the_robots_have_reported() -> None:
    async def main() -> None:
        async with lab() as there:
            (await there.join()).announce(Role.AGENT, "r1")  # alive, and has not yet reported what it latched
            async with station(there):
                await asyncio.sleep(0.3)
                refused = await there.bus.ask(channels.RESUME, Resume(revision=9))
                assert (refused.accepted, "try again" in refused.reason) == (False, True)
                await asyncio.sleep(1.5)
                assert (await there.bus.ask(channels.RESUME, Resume(revision=9))).accepted

    run_virtually(main())


def test_of_two_base_stations_the_second_exits() -> None:
    async def main() -> None:
        async with lab() as there, station(there):
            health = there.bus.latest(channels.HEALTH, "basestation")
            await asyncio.sleep(2.5)
            stops = there.bus.every(channels.STOP)
            second = asyncio.create_task(Station(await there.join(), LAB, None, []).run())
            await asyncio.wait({second}, timeout=0.5)
            with pytest.raises(ExceptionGroup) as caught:
                await second
            assert caught.group_contains(TransportError, match="expected to be the only one")
            await asyncio.sleep(1.1)
            assert len({received.message.epoch for received in stops.drain()}) == 1
            newest = health.get()
            assert newest is not None
            assert "another base station is running: stop one of them" in newest.message.reasons

    run_virtually(main())


def test_of_two_base_stations_that_start_together_one_stays() -> None:
    async def main() -> None:
        async with lab() as there:
            both = [asyncio.create_task(Station(await there.join(), LAB, None, []).run()) for _ in range(2)]
            await asyncio.sleep(2.0)
            assert sorted(task.done() for task in both) == [False, True]
            for task in both:
                task.cancel()
            await asyncio.wait(both)
            assert any(not task.cancelled() and task.exception() for task in both)

    run_virtually(main())


def test_the_stop_state_waits_for_the_robots_that_are_alive() -> None:
    """No robot may receive a state older than the stop that one latched while no base station ran."""

    async def main() -> None:
        async with lab() as there:
            first = await there.agent("r1", stop_latched=True, stop_all=True, stop_revision=1)
            second = await there.join()
            second.announce(Role.AGENT, "r2")  # alive, and slow to report
            stops = there.bus.every(channels.STOP)
            async with station(there):
                await asyncio.sleep(0.8)
                assert stops.drain() == []
                second.publisher(channels.HEALTH, "r2").put(Health(role="agent", state="x"))
                await asyncio.sleep(0.6)
                newest = [received.message for received in stops.drain()]
                assert newest
                assert all(message.all for message in newest)
                assert all(message.revision > 1 for message in newest)
            await first.close()

    run_virtually(main())


def test_the_wait_for_a_silent_robot_has_a_timeout() -> None:
    async def main() -> None:
        async with lab() as there:
            silent = await there.join()
            silent.announce(Role.AGENT, "r1")
            stops = there.bus.every(channels.STOP)
            async with station(there):
                await asyncio.sleep(1.0)
                assert stops.drain() == []
                await asyncio.sleep(1.0)
                assert stops.drain() != []

    run_virtually(main())


def test_a_stop_that_a_robot_latched_is_adopted_at_any_time() -> None:
    async def main() -> None:
        async with lab() as there, station(there):
            stop = there.bus.latest(channels.STOP)
            await asyncio.sleep(1.0)
            before = stop.get()
            assert before is not None
            assert not before.message.all
            await there.agent("r1", stop_latched=True, stop_all=True, stop_revision=before.message.revision)
            await asyncio.sleep(0.001)
            after = stop.get()
            assert after is not None
            assert after.message.all
            assert after.message.revision > before.message.revision

    run_virtually(main())


def test_only_the_health_of_agents_is_adopted() -> None:
    async def main() -> None:
        async with lab() as there, station(there):
            stop = there.bus.latest(channels.STOP)
            health = Health(role="simulator", state="x", stop_latched=True, stop_all=True, stop_revision=9)
            there.bus.publisher(channels.HEALTH, "simulator").put(health)
            await asyncio.sleep(1.0)
            newest = stop.get()
            assert newest is not None
            assert not newest.message.all

    run_virtually(main())


def test_positions_are_published_without_a_camera_and_are_empty() -> None:
    async def main() -> None:
        async with lab() as there, station(there):
            agent = await there.agent("r1")
            agent.publisher(channels.ESTIMATE, "r1").put(
                Estimate(x=0.0, y=0.0, theta=0.0, v=0.0, omega=0.0, covariance=(1.0,) * 9)
            )
            snapshots = there.bus.every(channels.ALL_POSITIONS)
            await asyncio.sleep(2.0)
            received = snapshots.drain()
            assert 8 <= len(received) <= 12  # 5 Hz at least
            assert all(snapshot.message.robots == () for snapshot in received)

    run_virtually(main())


def test_health_names_the_missing_agents() -> None:
    async def main() -> None:
        async with lab() as there, station(there):
            health = there.bus.latest(channels.HEALTH, "basestation")
            agent = await there.agent("r1")
            await asyncio.sleep(1.5)
            newest = health.get()
            assert newest is not None
            assert newest.message.reasons == ("no agent of r2", NO_CAMERA)
            await agent.close()
            await asyncio.sleep(1.5)
            newest = health.get()
            assert newest is not None
            assert newest.message.reasons == ("no agent of r1", "no agent of r2", NO_CAMERA)

    run_virtually(main())


async def test_on_a_full_disk_orders_are_refused_but_a_stop_is_active(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(fd: int) -> None:
        raise OSError(28, "No space left on device")

    async with real_lab() as there, station(there, tmp_path / "state.json"):
        stop = there.bus.latest(channels.STOP)
        await within(5, stop.next(), "the stop state")
        monkeypatch.setattr("os.fsync", full)
        refused = await there.ask(channels.SET_CIRCLE, SetCircle(radius=0.6))
        assert (refused.accepted, "No space left on device" in refused.reason) == (False, True)
        refused = await there.ask(channels.STOP_ORDER, Stop(names=("r1",)))
        assert not refused.accepted
        await there.agent("r2", stop_latched=True, stop_revision=99)
        async with asyncio.timeout(seconds(5)):
            async for received in stop:
                if received.message.names == ("r1", "r2"):
                    break
        # ... and it goes on.
        assert (await there.ask(channels.CLEAR, Clear(name="r2"))).reason == "robot r2 was never seen"


class Hanging:
    """A call that begins and does not return until it is released."""

    def __init__(self) -> None:
        self.begun = threading.Event()
        self.released = threading.Event()

    def __call__(self, *_: object) -> list[Any]:
        self.begun.set()
        assert self.released.wait(seconds(30))
        return []

    async def begins(self) -> None:
        """Wait for the call."""
        assert await asyncio.to_thread(self.begun.wait, seconds(10))


async def test_a_stop_does_not_wait_for_a_detection(monkeypatch: pytest.MonkeyPatch) -> None:
    detection = Hanging()
    monkeypatch.setattr(Localizer, "locate", detection)
    with ThreadPoolExecutor(1) as threads:
        async with real_lab() as there, make_bus(there.network.link()) as bus:
            task = asyncio.create_task(Station(bus, SEEN, None, cameras_on_bus(bus, SEEN, threads)).run())
            stop, snapshots = there.bus.latest(channels.STOP), there.bus.every(channels.ALL_POSITIONS)
            await within(5, stop.next(), "the stop state")
            bus.clocks.note(there.bus.epoch, 0.0, bus.clock.now())  # else the picture is not looked at
            there.bus.publisher(channels.CAMERA, "north").put(Frame(width=1280, height=720, format="grey", data=BLANK))
            await detection.begins()
            assert (await there.ask(channels.STOP_ORDER, Stop())).accepted
            assert (await within(5, stop.next(), "the stop")).message.all
            snapshots.drain()
            await within(5, snapshots.next(), "the table goes on, too")
            assert not detection.released.is_set()
            detection.released.set()
            task.cancel()
            await asyncio.wait({task})


async def test_a_stop_does_not_wait_for_another_orders_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    disk = Hanging()
    path = tmp_path / "state.json"
    async with real_lab() as there, station(there, path):
        stop, circle = there.bus.latest(channels.STOP), there.bus.latest(channels.CIRCLE)
        await within(5, stop.next(), "the stop state")
        monkeypatch.setattr("os.fsync", lambda fd: None if disk.begun.is_set() else disk())
        changing = asyncio.create_task(there.ask(channels.SET_CIRCLE, SetCircle(radius=0.6)))
        await disk.begins()
        assert (await there.ask(channels.STOP_ORDER, Stop())).accepted
        assert (await within(5, stop.next(), "the stop")).message.all
        assert StateStore(LAB, path).stop.all
        assert not changing.done()
        newest = circle.get()
        assert newest is not None
        assert newest.message.radius == 0.8, "nothing holds before it is on the disk"

        disk.released.set()
        assert (await changing).accepted
        kept = StateStore(LAB, path)
        assert (kept.stop.all, kept.circle.radius) == (True, 0.6)


async def test_a_stop_is_published_before_the_disk_has_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    disk = Hanging()
    async with real_lab() as there, station(there, tmp_path / "state.json"):
        stop = there.bus.latest(channels.STOP)
        await within(5, stop.next(), "the stop state")
        monkeypatch.setattr("os.fsync", disk)
        stopping = asyncio.create_task(there.ask(channels.STOP_ORDER, Stop(names=("r2",))))
        await disk.begins()
        assert (await within(5, stop.next(), "the stop")).message.names == ("r2",)
        assert not stopping.done(), "it is accepted when it is on the disk"
        disk.released.set()
        assert (await stopping).accepted
        assert StateStore(LAB, tmp_path / "state.json").stop.names == ("r2",)


def test_a_stop_is_published_at_once_and_not_with_the_next_repetition(monkeypatch: pytest.MonkeyPatch) -> None:
    """The disk hangs for good, and the state is repeated only in half a second."""

    async def main() -> None:
        async with lab() as there, station(there):
            stop = there.bus.latest(channels.STOP)
            await stop.next()
            monkeypatch.setattr(StateStore, "_written", lambda *_: asyncio.get_running_loop().create_future())
            stopping = asyncio.create_task(there.ask(channels.STOP_ORDER, Stop(names=("r2",))))
            await asyncio.sleep(0.01)
            newest = stop.get()
            assert newest is not None
            assert newest.message.names == ("r2",)
            assert not stopping.done()
            stopping.cancel()
            await asyncio.wait({stopping})

    run_virtually(main())


async def test_a_resume_that_a_stop_overtakes_lifts_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    disk = Hanging()
    path = tmp_path / "state.json"
    async with real_lab() as there, station(there, path):
        stop = there.bus.latest(channels.STOP)
        await within(5, stop.next(), "the stop state")
        revision = (await there.ask(channels.STOP_ORDER, Stop(names=("r1",)))).revision
        monkeypatch.setattr("os.fsync", lambda fd: None if disk.begun.is_set() else disk())
        resuming = asyncio.create_task(there.ask(channels.RESUME, Resume(revision=revision)))
        await disk.begins()
        assert (await there.ask(channels.STOP_ORDER, Stop(names=("r2",)))).accepted
        disk.released.set()
        refused = await resuming
        assert (refused.accepted, "an order came in between" in refused.reason) == (False, True)
        assert StateStore(LAB, path).stop.names == ("r1", "r2")


def test_a_fix_that_is_captured_in_the_future_does_not_keep_the_true_ones_out() -> None:
    async def main() -> None:
        async with lab() as there, make_bus(there.network.link(), clock=there.bus.clock) as bus:
            positions = PositionsTask(bus, LAB.robots, make_fusion(LAB))
            poses, snapshots = there.bus.every(channels.POSE, "r1"), there.bus.latest(channels.ALL_POSITIONS)
            for ahead, x in ((40.0, 1.0), (0.0, 1.02)):
                await asyncio.sleep(0.05)
                seen = (Sighting("r1", Pose2(x, 0.0, 0.0), SURE),)
                positions._take(Sightings(camera="north", captured=there.bus.clock.now() + ahead, robots=seen))
            newest = snapshots.get()
            assert newest is not None
            assert [(robot.x, robot.age) for robot in newest.message.robots] == [(1.02, 0.0)]
            assert [fix.message.age for fix in poses.drain()] == [0.0, 0.0]

    run_virtually(main())


def test_stale_frames_are_counted_and_show_nobody() -> None:
    async def main() -> None:
        async with lab() as there, make_bus(there.network.link(), clock=there.bus.clock) as bus:
            positions = PositionsTask(bus, LAB.robots, make_fusion(LAB))
            for quality in ("good", "stale", "bad", "stale"):
                positions._take(Sightings(camera="north", captured=there.bus.clock.now(), frame=quality))
            assert (positions.frames, positions.bad_frames, positions.stale_frames) == (2, 1, 2)

    run_virtually(main())


@pytest.mark.parametrize("begin", [0.0, 0.25, 0.5, 0.75])
@pytest.mark.parametrize(("trouble", "limit"), [("no frames from camera north", 1.0), ("sees the floor tags", 1.3)])
def test_a_camera_in_trouble_is_on_health_at_once(begin: float, trouble: str, limit: float) -> None:
    """Silent within a second, moved within two, whenever the report is due: it does not wait for its second."""

    async def main() -> None:
        async with lab() as there:
            clock, went_wrong = there.bus.clock, 0.0

            async def north() -> AsyncIterator[Sightings]:
                nonlocal went_wrong
                await asyncio.sleep(begin)
                for k in range(120):
                    if k < 60:
                        went_wrong = clock.now()
                    elif "no frames" in trouble:
                        return
                    off = ((0.0, 0.0 if k < 60 else 0.02),) * 4 if k % 10 == 0 else ()
                    yield Sightings(camera="north", captured=clock.now(), floor_off=off)
                    await asyncio.sleep(0.05)

            health = there.bus.every(channels.HEALTH, "basestation")
            async with make_bus(there.network.link(), clock=clock) as bus:
                task = asyncio.create_task(Station(bus, SEEN, None, [north()]).run())
                try:
                    async for received in health:
                        if went_wrong and any(trouble in reason for reason in received.message.reasons):
                            break
                finally:
                    task.cancel()
                    await asyncio.wait({task})
            assert clock.now() - went_wrong < limit

    run_virtually(main())


@pytest.mark.parametrize("begin", [0.0, 0.25, 0.5, 0.75])
def test_a_robot_that_is_not_where_it_says_is_on_health_at_once(begin: float) -> None:
    """Whenever the report is due: it does not wait for its second."""

    async def main() -> None:
        async with lab() as there:
            clock, lied = there.bus.clock, 0.0
            estimates = there.bus.publisher(channels.ESTIMATE, "r1")

            async def north() -> AsyncIterator[Sightings]:
                nonlocal lied
                await asyncio.sleep(begin)
                for k in range(120):
                    lied = lied or (clock.now() if k >= 60 else 0.0)
                    estimates.put(
                        Estimate(x=0.0 if k < 60 else 1.0, y=0.0, theta=0.0, v=0.0, omega=0.0, covariance=SURE)
                    )
                    await asyncio.sleep(0.05)
                    seen = (Sighting("r1", Pose2(0.0, 0.0, 0.0), SURE),)
                    yield Sightings(camera="north", captured=clock.now(), robots=seen)

            health = there.bus.every(channels.HEALTH, "basestation")
            async with make_bus(there.network.link(), clock=clock) as bus:
                task = asyncio.create_task(Station(bus, SEEN, None, [north()]).run())
                try:
                    async for received in health:
                        if any("r1 is not where it says" in reason for reason in received.message.reasons):
                            break
                finally:
                    task.cancel()
                    await asyncio.wait({task})
            assert lied
            assert clock.now() - lied < 0.2

    run_virtually(main())
