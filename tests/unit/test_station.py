"""The base station's tasks on the in-memory bus, in virtual time: orders, kept state, snapshots, liveness."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from basestation.station import Station
from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.config import parse_scenario
from muro_zenoh.errors import ConfigError, TransportError
from muro_zenoh.messages import Clear, Estimate, Frame, Health, Resume, SetBehaviour, SetCircle, Stop
from muro_zenoh.runtime.virtual_time import VirtualClock, run_virtually
from muro_zenoh.simulation.camera import OverheadCamera
from muro_zenoh.transport import Bus, MemoryNetwork, make_bus

LAB = parse_scenario({"robots": 2, "behaviour": {"name": "circle"}}, "lab.toml", name="lab")


@dataclass
class Lab:
    """A network, whoever is on it, and a bus of the test's own."""

    network: MemoryNetwork
    stack: AsyncExitStack
    bus: Bus

    async def join(self) -> Bus:
        return await self.stack.enter_async_context(make_bus(self.network.link(), clock=self.bus.clock))

    async def agent(self, name: str, **stop: object) -> Bus:
        """An agent that is alive and has said its health."""
        bus = await self.join()
        bus.announce(Role.AGENT, name)
        health = Health(role="agent", state="x", **stop)  # type: ignore[arg-type]
        bus.publisher(channels.HEALTH, name).put(health)
        return bus


@asynccontextmanager
async def lab() -> AsyncIterator[Lab]:
    network = MemoryNetwork()
    async with AsyncExitStack() as stack:
        bus = await stack.enter_async_context(make_bus(network.link(), clock=VirtualClock()))
        yield Lab(network, stack, bus)


@asynccontextmanager
async def station(there: Lab, state: Path | None = None) -> AsyncIterator[None]:
    """A base station that runs."""
    async with make_bus(there.network.link(), clock=there.bus.clock) as bus:
        task = asyncio.create_task(Station(bus, LAB, state).run())
        try:
            yield
        finally:
            task.cancel()
            await asyncio.wait({task})


def test_what_it_keeps_goes_out_twice_a_second() -> None:
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
            said = stop.get()
            assert said is not None
            assert said.message.names == ("r1",)
            got = circle.get()
            assert got is not None
            assert got.message.radius == 0.6
            assert behaviour.values()["r2"].message.behaviour == "hold"
            assert (await ask(channels.RESUME, Resume(revision=said.message.revision))).accepted
            refused = await ask(channels.SET_CIRCLE, SetCircle(radius=5.0))
            assert (refused.accepted, "inside the arena" in refused.reason) == (False, True)
            refused = await ask(channels.CLEAR, Clear(name="r1"))
            assert (refused.accepted, refused.reason) == (False, "robot r1 was never seen")

    run_virtually(main())


def test_nothing_is_lifted_before_the_robots_were_heard() -> None:
    async def main() -> None:
        async with lab() as there:
            (await there.join()).announce(Role.AGENT, "r1")  # alive, and has not said yet what it latched
            async with station(there):
                await asyncio.sleep(0.3)
                refused = await there.bus.ask(channels.RESUME, Resume(revision=9))
                assert (refused.accepted, "try again" in refused.reason) == (False, True)
                await asyncio.sleep(1.5)
                assert (await there.bus.ask(channels.RESUME, Resume(revision=9))).accepted

    run_virtually(main())


def test_of_two_base_stations_the_second_leaves() -> None:
    async def main() -> None:
        async with lab() as there, station(there):
            health = there.bus.latest(channels.HEALTH, "basestation")
            await asyncio.sleep(2.5)
            stops = there.bus.every(channels.STOP)
            second = asyncio.create_task(Station(await there.join(), LAB, None).run())
            await asyncio.wait({second}, timeout=0.5)
            with pytest.raises(ExceptionGroup) as caught:
                await second
            assert caught.group_contains(TransportError, match="expected to be the only one")
            await asyncio.sleep(1.1)
            assert len({received.message.epoch for received in stops.drain()}) == 1
            said = health.get()
            assert said is not None
            assert "another base station is running: end one of them" in said.message.reasons

    run_virtually(main())


def test_of_two_base_stations_that_start_together_one_stays() -> None:
    async def main() -> None:
        async with lab() as there:
            both = [asyncio.create_task(Station(await there.join(), LAB, None).run()) for _ in range(2)]
            await asyncio.sleep(2.0)
            assert sorted(task.done() for task in both) == [False, True]
            for task in both:
                task.cancel()
            await asyncio.wait(both)
            assert any(not task.cancelled() and task.exception() for task in both)

    run_virtually(main())


def test_the_stop_state_waits_for_the_robots_that_are_alive() -> None:
    """Whoever latched a stop while no base station ran must not hear of an older state, and nobody else neither."""

    async def main() -> None:
        async with lab() as there:
            first = await there.agent("r1", stop_latched=True, stop_all=True, stop_revision=1)
            second = await there.join()
            second.announce(Role.AGENT, "r2")  # alive, and slow to say how it is
            stops = there.bus.every(channels.STOP)
            async with station(there):
                await asyncio.sleep(0.8)
                assert stops.drain() == []
                second.publisher(channels.HEALTH, "r2").put(Health(role="agent", state="x"))
                await asyncio.sleep(0.6)
                said = [received.message for received in stops.drain()]
                assert said
                assert all(message.all for message in said)
                assert all(message.revision > 1 for message in said)
            await first.close()

    run_virtually(main())


def test_a_robot_that_says_nothing_is_not_waited_for_for_ever() -> None:
    async def main() -> None:
        async with lab() as there:
            mute = await there.join()
            mute.announce(Role.AGENT, "r1")
            stops = there.bus.every(channels.STOP)
            async with station(there):
                await asyncio.sleep(1.0)
                assert stops.drain() == []
                await asyncio.sleep(1.0)
                assert stops.drain() != []

    run_virtually(main())


def test_a_stop_that_a_robot_latched_is_taken_over_at_any_time() -> None:
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


def test_the_health_of_others_stops_nobody() -> None:
    async def main() -> None:
        async with lab() as there, station(there):
            stop = there.bus.latest(channels.STOP)
            health = Health(role="simulator", state="x", stop_latched=True, stop_all=True, stop_revision=9)
            there.bus.publisher(channels.HEALTH, "simulator").put(health)
            await asyncio.sleep(1.0)
            said = stop.get()
            assert said is not None
            assert not said.message.all

    run_virtually(main())


def test_positions_go_out_without_a_camera_and_say_that_nobody_is_seen() -> None:
    async def main() -> None:
        async with lab() as there, station(there):
            agent = await there.agent("r1")
            agent.publisher(channels.ESTIMATE, "r1").put(
                Estimate(x=0.0, y=0.0, theta=0.0, v=0.0, omega=0.0, covariance=(1.0,) * 9)
            )
            snapshots = there.bus.every(channels.ALL_POSITIONS)
            await asyncio.sleep(2.0)
            heard = snapshots.drain()
            assert 8 <= len(heard) <= 12  # 5 Hz at least
            assert all(received.message.robots == () for received in heard)

    run_virtually(main())


def test_it_says_whose_agent_is_missing() -> None:
    async def main() -> None:
        async with lab() as there, station(there):
            health = there.bus.latest(channels.HEALTH, "basestation")
            agent = await there.agent("r1")
            await asyncio.sleep(1.5)
            said = health.get()
            assert said is not None
            assert said.message.reasons == ("no agent of r2",)
            await agent.close()
            await asyncio.sleep(1.5)
            said = health.get()
            assert said is not None
            assert said.message.reasons == ("no agent of r1", "no agent of r2")

    run_virtually(main())


def test_a_full_disk_refuses_an_order_with_the_reason_and_stops_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(fd: int) -> None:
        raise OSError(28, "No space left on device")

    async def main() -> None:
        async with lab() as there, station(there, tmp_path / "state.json"):
            stop = there.bus.latest(channels.STOP)
            await asyncio.sleep(1.0)
            monkeypatch.setattr("os.fsync", full)
            refused = await there.bus.ask(channels.SET_CIRCLE, SetCircle(radius=0.6))
            assert (refused.accepted, "No space left on device" in refused.reason) == (False, True)
            refused = await there.bus.ask(channels.STOP_ORDER, Stop(names=("r1",)))
            assert not refused.accepted
            await there.agent("r2", stop_latched=True, stop_revision=99)
            await asyncio.sleep(0.6)
            said = stop.get()
            assert said is not None
            assert said.message.names == ("r1", "r2")
            # ... and it goes on.
            assert (await there.bus.ask(channels.CLEAR, Clear(name="r2"))).reason == "robot r2 was never seen"

    run_virtually(main())


def test_a_camera_that_is_stuck_tells_no_places(caplog: pytest.LogCaptureFixture) -> None:
    lab_seen = parse_scenario({"robots": 1, "camera": {"north": {}}}, "lab.toml", name="lab")
    camera = OverheadCamera.from_views(1280, 720, lab_seen.camera["north"].views(lab_seen.arena), noise=3.0)
    robot = lab_seen.robot["r1"]
    rng = np.random.default_rng(1)

    def picture() -> Frame:
        grey = camera.render(np.array([[0.3, 0.1, 0.2]]), [robot.mount], [robot.radius], rng)
        return Frame(width=1280, height=720, format="grey", data=grey.tobytes())

    async def main() -> None:
        async with lab() as there, make_bus(there.network.link(), clock=there.bus.clock) as bus:
            task = asyncio.create_task(Station(bus, lab_seen, None).run())
            fixes = there.bus.every(channels.POSE, "r1")
            frames = there.bus.publisher(channels.CAMERA, "north")
            await asyncio.sleep(0.1)
            stuck = picture()
            for frame in (stuck, stuck, stuck, picture(), stuck):
                frames.put(frame)
                await asyncio.sleep(0.05)
            assert len(fixes.drain()) == 3  # the first, the new one, and one that is not like the one before
            assert [r.message for r in caplog.records if "is the camera stuck?" in r.message] != []
            task.cancel()
            await asyncio.wait({task})

    run_virtually(main())


def test_a_camera_with_tags_of_no_family_is_a_wrong_setting() -> None:
    table = {"robots": 1, "camera": {"north": {"family": "DICT_9X9_9"}}}
    wrong = parse_scenario(table, "lab.toml", name="lab")

    async def main() -> None:
        async with lab() as there:
            with pytest.raises(ConfigError, match=r"camera\.north\.family: got 'DICT_9X9_9'"):
                Station(there.bus, wrong, None)

    run_virtually(main())
