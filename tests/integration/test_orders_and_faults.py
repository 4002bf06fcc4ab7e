"""A real fleet with users' behaviours, foreign programs, garbage, and killed router and simulator."""

from __future__ import annotations

import asyncio
import os
import random
import re
import signal
import time
from collections.abc import AsyncIterator
from pathlib import Path

import msgpack
import pytest
import pytest_asyncio

from muro_zenoh import channels
from muro_zenoh.messages import SetBehaviour, SetCircle, encoding_of
from tests.support.fleet import RealFleet, find, real_fleet, stranger
from tests.support.process import CHILDREN, Process
from tests.support.waiting import seconds

pytestmark = pytest.mark.slow

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest_asyncio.fixture
async def fleet(tmp_path: Path) -> AsyncIterator[RealFleet]:
    path = os.pathsep.join(filter(None, [str(EXAMPLES), os.environ.get("PYTHONPATH", "")]))
    async with real_fleet(tmp_path, behaviour={"name": "circle"}, env={"PYTHONPATH": path}) as running:
        await running.until(running.driving, 10, "all drive")
        yield running


async def test_behaviours_of_users(fleet: RealFleet) -> None:
    await _a_frozen_agent_is_no_runaway(fleet)
    await _a_frozen_base_station_stops_all(fleet)
    await _a_foreign_program_says_the_speed(fleet)
    await _an_unknown_behaviour_stops_the_robot(fleet)
    await _the_flock_is_three_processes(fleet)


async def _a_frozen_agent_is_no_runaway(fleet: RealFleet) -> None:
    fleet.process["r1"].send(signal.SIGSTOP)
    await fleet.until(lambda: fleet.stationary("r1"), 5, "the dead-man stops r1")
    await fleet.throughout(lambda: fleet.stationary("r1"), 0.5, "r1 is stationary")
    fleet.process["r1"].send(signal.SIGCONT)
    await fleet.until(lambda: fleet.driving("r1"), 5, "r1 drives again")


async def _a_frozen_base_station_stops_all(fleet: RealFleet) -> None:
    fleet.process["basestation"].send(signal.SIGSTOP)
    await fleet.until(lambda: fleet.stationary() and fleet.holds("r1", "no pose for"), 5, "no poses, nobody drives")
    poses = fleet.bus.every(channels.POSE, "*", depth=1024)
    await fleet.throughout(fleet.stationary, 1.0, "pictures pile up")
    thawed = fleet.bus.clock.now()
    fleet.process["basestation"].send(signal.SIGCONT)
    await fleet.until(fleet.driving, 5, "all drive again")
    # Of the pictures that piled up those are used that are not stale, each at its own time of capture.
    fixes = [pose.message for pose in poses.drain()]
    captured = [fix.stamp - fix.age for fix in fixes if fix.stamp > thawed]  # one may have been on its way to the wire
    assert captured
    assert min(captured) > thawed - channels.CAMERA.stale_after - 0.1
    poses.close()


async def _a_foreign_program_says_the_speed(fleet: RealFleet) -> None:
    await fleet.until(lambda: abs(fleet.truth["r1"].v - 0.2) < 0.02, 10, "r1 at the default speed")
    arguments = [str(CHILDREN / "velocities.py"), fleet.endpoint, "r1", "0.1"]
    with Process(arguments, name="velocities") as other:
        other.ready()
        await fleet.until(lambda: abs(fleet.truth["r1"].v - 0.1) < 0.01, 10, "r1 at the foreign program's speed")
        await fleet.until(lambda: abs(fleet.truth["r2"].v - 0.2) < 0.02, 10, "r2 at its own")
        assert abs(fleet.truth["r1"].v - 0.1) < 0.02
        other.kill()
    await fleet.until(lambda: fleet.holds("r1", "no velocity for") and fleet.stationary("r1"), 5, "r1 holds")


async def _an_unknown_behaviour_stops_the_robot(fleet: RealFleet) -> None:
    reply = fleet.muro("set", "behaviour", "fly", "--robot", "r2")
    assert reply.returncode == 1
    assert "got 'fly', expected one of circle, coverage" in reply.stdout
    await fleet.until(lambda: fleet.driving("r2"), 5, "r2 drives on")
    # Only the robots load a user's behaviour, so the base station accepts it.
    reply = fleet.muro("set", "behaviour", "nolab:fly", "--robot", "r2")
    assert reply.returncode == 1
    assert "r2: cannot run it: " in reply.stdout
    await fleet.until(lambda: fleet.holds("r2", "No module named 'nolab'"), 5, "r2 reports the reason")
    await fleet.until(lambda: fleet.stationary("r2"), 3, "r2 is stationary")
    assert fleet.process["r2"].running
    await fleet.until(lambda: fleet.driving("r3"), 5, "r3 drives on")


async def _the_flock_is_three_processes(fleet: RealFleet) -> None:
    reply = fleet.muro("set", "behaviour", "flock:flock")
    assert reply.returncode == 0, reply.stdout + reply.stderr
    await fleet.until(lambda: {fleet.health[n].state for n in fleet.robots} == {"flock"}, 5, "all flock")
    await fleet.until(fleet.driving, 5, "all drive")


async def test_garbage_on_every_key_is_counted_and_stops_no_robot(fleet: RealFleet) -> None:
    noise = random.Random(7)
    names = [*fleet.robots, "north", "simulator", "basestation", "nobody"]
    keys = [f"muro/{c.word}/{n}" for c in channels.CHANNELS if c.named for n in names]
    keys += [f"muro/{c.word}" for c in channels.CHANNELS if not c.named]
    # Except the truth, which only the observer reads.
    keys = [key for key in keys if not key.startswith("muro/truth/")]
    kinds = {f"muro/{c.word}": encoding_of(c.kind) for c in channels.CHANNELS}

    def all_run() -> None:
        ended = [name for name, process in fleet.process.items() if not process.running]
        assert not ended, "\n".join(fleet.process[name].last_lines() for name in ended)

    def payload() -> bytes:
        return noise.choice(
            [
                b"",
                noise.randbytes(noise.randrange(1, 200)),
                msgpack.packb({"stamp": time.time(), "nonsense": 1}),
                msgpack.packb({"stamp": time.time(), "v": float("nan"), "omega": 0.0}),
                msgpack.packb([1, 2, 3]),
                b"\xdf\xff\xff\xff\xff" + noise.randbytes(20),  # a map of four thousand million
                noise.randbytes(20_000),
            ]
        )

    session = stranger(fleet.endpoint)
    try:
        for _ in range(40):
            for key in keys:
                word = "/".join(key.split("/")[:2])
                if noise.random() < 0.5:
                    session.put(key, payload(), encoding=kinds[word])
                else:
                    session.put(key, payload())
            # An invalid picture, and one of another camera.
            for size, kind, data in ((16, "jpeg", noise.randbytes(50)), (8, "grey", bytes(64)), (8, "grey", b"")):
                frame = {"stamp": time.time(), "width": size, "height": size, "format": kind, "data": data}
                session.put("muro/camera/north", msgpack.packb(frame))
            for verb in channels.VERBS:
                key = channels.verb_key("muro", verb, "r1" if verb.named else "")
                session.get(key, lambda _: None, payload=payload(), timeout=0.5)
            await asyncio.sleep(0.05)
            all_run()
    finally:
        session.close()

    await fleet.until(fleet.driving, 5, "all drive on")
    for name, words in {
        "r1": ("pose", "circle", "behaviour", "stop", "odometry", "velocity"),
        "basestation": ("camera", "health", "estimate", "basestation/stop"),
        "simulator": ("cmd_vel",),
    }.items():
        for word in words:
            key = f"{word}_rejected"
            await fleet.until(lambda n=name, k=key: fleet.number(n, k) > 10, 5, f"{name} counts {key}")  # type: ignore[misc]
    assert fleet.number("basestation", "bad_frames") > 10
    await fleet.ask(channels.SET_CIRCLE, SetCircle(radius=0.7))
    await fleet.until(lambda: fleet.radius_error() < 0.03, 20, "the fleet obeys")
    all_run()  # nobody would have started them again


async def test_a_robot_that_does_not_confirm_a_stop_is_named(fleet: RealFleet) -> None:
    fleet.process["r2"].send(signal.SIGSTOP)
    order = fleet.muro("stop")
    assert order.returncode == 1, order.stdout + order.stderr
    assert re.search(r"^r1 .* has stopped$", order.stdout, re.MULTILINE)
    assert re.search(r"^r3 .* has stopped$", order.stdout, re.MULTILINE)
    # Its lease may be over by the time that it was waited for.
    assert re.search(r"^r2 .* (DOES NOT CONFIRM$|is not alive)", order.stdout, re.MULTILINE)
    assert re.search(r"^2 of 3 robots stopped; r2 silent for \d+\.\d s$", order.stdout, re.MULTILINE)
    await fleet.until(fleet.stationary, 5, "all stand, r2 by its dead-man")
    fleet.commands()
    thawed = fleet.bus.clock.now()
    fleet.process["r2"].send(signal.SIGCONT)
    await fleet.until(lambda: fleet.health["r2"].stop_latched, 5, "r2 hears of it")
    woken = [c.message for c in fleet.commands() if c.name == "r2" and c.message.stamp > thawed]
    assert woken
    assert not any((command.v, command.omega) != (0.0, 0.0) for command in woken), "it drove before it knew of the stop"
    await fleet.throughout(lambda: fleet.stationary("r2"), 1.0, "r2 stands on")
    order = fleet.muro("stop")
    assert order.returncode == 0, order.stdout + order.stderr
    assert re.search(r"^r2 .* has stopped$", order.stdout, re.MULTILINE)


async def test_the_router_and_then_the_simulator_die(fleet: RealFleet) -> None:
    await _without_the_router_the_wheels_stop(fleet)
    await _without_the_simulator_nobody_hangs(fleet)


async def _without_the_router_the_wheels_stop(fleet: RealFleet) -> None:
    simulator = fleet.process["simulator"]
    simulator.forget()
    fleet.kill("router")
    # Only the simulator itself can see its wheels now: its bases log what they did.
    said: set[str] = set()
    while said != set(fleet.robots):
        said.add(find(simulator, r"(r\d): no fresh command for 0\.3 s, wheels at zero", 5)[1])
    fleet.start("router")
    await fleet.until(fleet.driving, 20, "all drive when the router is back")


async def _without_the_simulator_nobody_hangs(fleet: RealFleet) -> None:
    fleet.kill("simulator")
    await fleet.until(
        lambda: all(fleet.holds(name, "no pose for") for name in fleet.robots), 5, "they report the reason"
    )
    numbers = {name: fleet.health[name].seq for name in (*fleet.robots, "basestation")}
    await fleet.until(lambda: all(fleet.health[n].seq >= numbers[n] + 2 for n in numbers), 10, "all still report")
    await fleet.ask(channels.SET_BEHAVIOUR, SetBehaviour(behaviour="hold"))
    await fleet.until(
        lambda: all(fleet.holds(n, "the behaviour is hold") for n in fleet.robots), 5, "orders are accepted"
    )
    began = time.monotonic()
    for name in numbers:
        fleet.process[name].send(signal.SIGTERM)
    codes = {name: fleet.process[name].wait(5) for name in numbers}
    assert time.monotonic() - began < seconds(5)
    assert set(codes.values()) == {0}, codes
