"""kill -9 of the base station: no robot drives without it, and no kept state is lost."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from muro_zenoh import channels
from muro_zenoh.geometry import Circle
from muro_zenoh.messages import Odometry, SetBehaviour, SetCircle, Stop
from muro_zenoh.transport import Received
from tests.support.fleet import RealFleet, real_fleet

pytestmark = pytest.mark.slow

CIRCLE = Circle(0.1, -0.05, 0.7, True)


async def test_the_base_station_is_killed_and_restarted(tmp_path: Path) -> None:
    async with real_fleet(tmp_path) as fleet:
        await fleet.until(fleet.driving, 10, "all drive")
        await fleet.ask(
            channels.SET_CIRCLE, SetCircle(x=CIRCLE.x, y=CIRCLE.y, radius=CIRCLE.radius, clockwise=CIRCLE.clockwise)
        )
        await fleet.ask(channels.SET_BEHAVIOUR, SetBehaviour(behaviour="circle", parameters={"speed": 0.15}))
        await fleet.ask(channels.STOP_ORDER, Stop(names=("r3",)))
        await fleet.until(lambda: fleet.stationary("r3"), 5, "r3 is stationary")
        await fleet.until(lambda: fleet.radius_error(("r1", "r2")) < 0.03, 20, "the new circle")
        await _who_drives_is_stopped_by_the_age_of_the_poses(fleet)
        await _it_goes_on_as_it_was(fleet)
        await _a_stop_needs_no_base_station(fleet)


async def _who_drives_is_stopped_by_the_age_of_the_poses(fleet: RealFleet) -> None:
    fleet.commands(), fleet.wheels()
    await fleet.until(lambda: fleet.driving("r1", "r2"), 5, "they drive")
    killed = fleet.kill("basestation")
    await fleet.until(
        lambda: fleet.holds("r1", "no pose for") and fleet.holds("r2", "no pose for"), 5, "they report the reason"
    )
    await fleet.until(lambda: fleet.bus.clock.now() - killed > 2.0, 5, "two seconds")

    # The stamps are the writers' clocks; on one machine they are one.
    commands = fleet.commands()
    for name in ("r1", "r2"):
        stamps = [
            c.message.stamp - killed for c in commands if c.name == name and (c.message.v, c.message.omega) != (0, 0)
        ]
        assert stamps, f"{name} was driving until then"
        assert max(stamps) < 0.6, f"{name} was commanded to drive {max(stamps):.2f} s after the kill"
        assert any(c.message.stamp - killed > 1.0 for c in commands if c.name == name), "zero is commanded, not silence"
    # What the wheels did by the simulator's clock: from 0.15 m/s they stand within the wheels' lag and the braking.
    late: list[Received[Odometry]] = []

    def all_have_reported() -> bool:
        late.extend(w for w in fleet.wheels() if w.message.stamp - killed > 1.6)
        return {w.name for w in late} == set(fleet.robots)

    await fleet.until(all_have_reported, 5, "odometry of all")
    assert max(abs(w.message.v) for w in late) < 0.005


async def _it_goes_on_as_it_was(fleet: RealFleet) -> None:
    assert fleet.circle is not None
    fleet.start("basestation")
    await fleet.until(lambda: fleet.driving("r1", "r2"), 10, "they drive again")
    assert fleet.circle == CIRCLE
    for name in fleet.robots:
        kept = fleet.behaviour.values()[name].message
        assert (kept.behaviour, kept.parameters) == ("circle", {"speed": 0.15})
    stop = fleet.stop.get()
    assert stop is not None
    assert (stop.message.all, stop.message.names) == (False, ("r3",))
    await fleet.throughout(lambda: fleet.stationary("r3"), 1.0, "r3 stays stationary")
    await fleet.until(lambda: fleet.radius_error(("r1", "r2")) < 0.03, 15, "the same circle")
    resumed = fleet.muro("resume", "r3")
    assert resumed.returncode == 0, resumed.stdout + resumed.stderr
    await fleet.until(fleet.driving, 5, "r3 drives, too")


async def _a_stop_needs_no_base_station(fleet: RealFleet) -> None:
    fleet.kill("basestation")
    fleet.kill("r3")
    stopped = fleet.muro("stop")
    assert stopped.returncode == 0, stopped.stdout + stopped.stderr
    assert re.search(r"^r1 .* has stopped\nr2 .* has stopped$", stopped.stdout, re.MULTILINE)
    await fleet.until(fleet.stationary, 3, "all stand")
    fleet.start("r3")  # it was not running when the stop was ordered
    await fleet.until(lambda: fleet.holds("r3", "no stop state received yet"), 5, "r3 has received no stop state")

    fleet.commands()
    fleet.start("basestation")
    await fleet.until(lambda: fleet.holds("r3", "stopped by order (all robots)"), 10, "r3 receives the stop")
    await fleet.until(lambda: fleet.number("basestation", "frames") > 20, 10, "robots are seen again")
    await fleet.throughout(fleet.stationary, 1.0, "none drives")
    turned = {c.name for c in fleet.commands() if (c.message.v, c.message.omega) != (0.0, 0.0)}
    assert turned == set(), "until an operator resumes, no command but zero"

    resumed = fleet.muro("resume")
    assert resumed.returncode == 0, resumed.stdout + resumed.stderr
    await fleet.until(fleet.driving, 5, "all drive")
