"""Who counts in a snapshot, and how old its places are by now: pursuit's ring, and what a user's behaviour sees."""

from __future__ import annotations

import math
from collections.abc import Mapping

import pytest

from agents.master import Master
from agents.robot import Connection, Robot
from agents.tasks.control import Listener
from muro_zenoh import channels
from muro_zenoh.behaviours import pursuit
from muro_zenoh.behaviours.interface import Seen, Snapshot
from muro_zenoh.config import parse_scenario
from muro_zenoh.geometry import Circle, State
from muro_zenoh.messages import FleetSnapshot, RobotState, RobotStatus
from muro_zenoh.transport import Latest, MemoryNetwork, make_bus
from muro_zenoh.walls import Wall
from tests.support.clock import ManualClock

LAB = parse_scenario({"robots": 3, "behaviour": {"name": "pursuit"}}, "lab.toml", name="lab")
CIRCLE = Circle(0.0, 0.0, 0.8)


def at(angle: float) -> tuple[float, float, float]:
    """A place on the circle, with the heading along it."""
    return 0.8 * math.cos(angle), 0.8 * math.sin(angle), angle + math.pi / 2


def seen_by_r1(
    others: Mapping[str, tuple[float, RobotStatus]],
    now: float = 100.0,
    stopped: frozenset[str] = frozenset(),
    age: float = 0.0,
    snapshot_age: float = 0.0,
) -> Seen:
    """What r1 sees from the angle 0: the others by name, each at an angle and in a state, all at 0.2 m/s."""
    robots = tuple(RobotState(n, *at(angle), 0.2, 0.25, age, state) for n, (angle, state) in others.items())
    here = State(*at(0.0), 0.2, 0.25)
    return Seen(
        now, here, here, CIRCLE, None, math.inf, Snapshot(robots, 0.0, 1, snapshot_age), snapshot_age, stopped=stopped
    )


def speed(seen: Seen) -> float:
    """What pursuit chooses when it sees this first."""
    chosen = pursuit.make(pursuit.Parameters(), LAB.vehicle("r1")).step(seen).speed
    assert isinstance(chosen, float)
    return chosen


ALONE = speed(seen_by_r1({}))
CLOSE_AHEAD = speed(seen_by_r1({"r2": (0.6, "tracking")}))


def test_a_close_successor_slows_a_robot_down() -> None:
    assert CLOSE_AHEAD < ALONE - 0.02


@pytest.mark.parametrize(
    ("state", "counts"),
    [("tracking", True), ("silent", True), ("disagrees", True), ("stale", False), ("lost", False)],
)
def test_a_neighbour_that_no_camera_sees_is_not_on_the_ring(state: RobotStatus, counts: bool) -> None:
    assert speed(seen_by_r1({"r2": (0.6, state)})) == (CLOSE_AHEAD if counts else ALONE)


@pytest.mark.parametrize(("stopped", "counts"), [({"r2"}, False), ({"r2", "r3"}, False), ({"r3"}, True)])
def test_a_neighbour_that_was_stopped_is_not_on_the_ring_while_it_still_moves(stopped: set[str], counts: bool) -> None:
    seen = seen_by_r1({"r2": (0.6, "tracking")}, stopped=frozenset(stopped))
    assert speed(seen) == (CLOSE_AHEAD if counts else ALONE)


@pytest.mark.parametrize(("age", "snapshot_age"), [(0.4, 0.0), (0.0, 0.4), (0.1, 0.3)])
def test_a_neighbours_position_is_predicted_to_now(age: float, snapshot_age: float) -> None:
    """By the age of its fix when the snapshot was sent, and by that of the snapshot."""
    driven = 0.2 * 0.4 / 0.8  # at 0.2 m/s, on a circle of 0.8 m
    then = speed(seen_by_r1({"r2": (3.1, "tracking")}))
    now = speed(seen_by_r1({"r2": (3.1 + driven, "tracking")}))
    assert now > then + 0.01
    assert speed(seen_by_r1({"r2": (3.1, "tracking")}, age=age, snapshot_age=snapshot_age)) == pytest.approx(now)


async def test_a_snapshot_grows_older_until_the_behaviour_sees_it() -> None:
    network, clock = MemoryNetwork(), ManualClock()
    async with make_bus(network.link(), clock=clock) as station, make_bus(network.link(), clock=clock) as bus:
        listener = Listener(bus, "r1", Master(bus, "r1"))
        listener.need(frozenset(pursuit.BEHAVIOUR.needs))
        out = station.publisher(channels.ALL_POSITIONS)
        state = RobotState("r2", 0.5, 0.0, 0.0, 0.2, 0.0, 0.05, "tracking")
        out.put(FleetSnapshot(robots=(state,)))
        assert listener.surroundings(clock.now()).snapshot is not None
        clock.advance(0.4)
        out.put(FleetSnapshot(stamp=clock.now() - 0.1, robots=(state,)))  # 0.1 s on the way
        clock.advance(0.2)
        snapshot = listener.surroundings(clock.now()).snapshot
        assert snapshot is not None
        assert snapshot.age == pytest.approx(0.3)
        clock.advance(0.19)
        assert listener.surroundings(clock.now()).snapshot is not None
        clock.advance(0.02)  # 0.51 s old
        gone = listener.surroundings(clock.now())
        assert (gone.snapshot, gone.snapshot_age) == (None, pytest.approx(0.51))


def test_a_users_neighbours_are_as_old_as_they_are_now() -> None:
    others: dict[str, tuple[float, RobotStatus]] = {
        "r1": (0.0, "tracking"),
        "r2": (0.6, "tracking"),
        "r3": (2.0, "lost"),
    }
    seen = seen_by_r1(others, age=0.1, snapshot_age=0.3)

    def no_mailbox() -> Latest[object]:
        raise AssertionError("nobody asks for estimates here")

    connection = Connection(lambda: seen, lambda _: None, lambda _: None, no_mailbox, lambda: seen.now)  # type: ignore[arg-type]
    robot = Robot(LAB.vehicle("r1"), LAB.robot["r1"], {}, connection)
    assert [(n.name, n.age, n.state) for n in robot.neighbours] == [
        ("r2", pytest.approx(0.4), "tracking"),
        ("r3", pytest.approx(0.4), "lost"),
    ]


def test_a_user_sees_the_floor_with_its_walls() -> None:
    walls = (Wall(0.0, -1.5, 0.0, -0.4),)
    unused = Connection(*[lambda *_: pytest.fail("not asked for")] * 5)
    robot = Robot(LAB.vehicle("r1")._replace(walls=walls), LAB.robot["r1"], {}, unused)
    assert (robot.arena, robot.walls) == (LAB.arena, walls)
