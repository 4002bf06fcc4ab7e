"""The way round: planner, gates, patience."""

from __future__ import annotations

import math

import pytest

from muro_zenoh.geometry import Bounds, State
from muro_zenoh.safety.separation.gates import gate_ahead, gates_between, place_to_wait
from muro_zenoh.safety.separation.guidance import FIDGET, Near
from muro_zenoh.safety.separation.liveness import Patience, first_met, free_direction
from muro_zenoh.safety.separation.planner import CELL, SLICE, Planner, Segment

ARENA = Bounds(-2.1, 2.1, -1.5, 1.5)
DOOR = ((0.0, 0.4, 0.0, 1.5), (0.0, -1.5, 0.0, -0.4))
KEEP = 0.197


def planner() -> Planner:
    return Planner(ARENA.shrunk(KEEP), [Segment(x, y, p - x, q - y, KEEP) for x, y, p, q in DOOR])


def near(x: float, y: float, vx: float = 0.0, vy: float = 0.0, theta: float = 0.0, omega: float = 0.0) -> Near:
    return Near(x, y, vx, vy, 0.4, "r2", theta, omega)


def test_the_way_to_the_other_room_goes_through_the_door() -> None:
    way = planner().way((-1.0, 1.0), (1.0, 1.0), [])
    assert way[0] == (-1.0, 1.0)
    assert way[-1] == (1.0, 1.0)
    at_the_door = [y for x, y in way if abs(x) < 0.06]
    assert at_the_door
    assert all(abs(y) <= 0.4 - KEEP for y in at_the_door)


def test_a_wall_hides_what_is_behind_it() -> None:
    assert planner().sees((-1.0, 1.0), (-0.3, -1.0))
    assert planner().sees((-1.0, 0.0), (1.0, 0.0))
    assert not planner().sees((-1.0, 1.0), (1.0, 1.0))


def test_the_way_leads_round_a_standing_robot_but_is_never_forbidden() -> None:
    open_floor = Planner(ARENA.shrunk(KEEP), ())
    way = open_floor.way((-1.0, 0.0), (1.0, 0.0), [(0.0, 0.0, 0.4)])
    assert min(math.hypot(x, y) for x, y in way) > 0.3
    everywhere = [(x, y, 0.4) for x in (-0.4, 0.0, 0.4) for y in (-1.2, -0.6, 0.0, 0.6, 1.2)]
    assert open_floor.way((-1.0, 0.0), (1.0, 0.0), everywhere)[-1] == (1.0, 0.0)


def test_walls_that_leave_no_way_give_none() -> None:
    closed = Planner(ARENA.shrunk(KEEP), [Segment(0.0, -1.5, 0.0, 3.0, KEEP)])
    assert closed.way((-1.0, 0.0), (1.0, 0.0), []) == []


def test_a_search_takes_few_cells_at_a_time() -> None:
    """Behind the long wall nothing is found: every free cell on this side is looked at, in slices."""
    inside = ARENA.shrunk(KEEP)
    closed = Planner(inside, [Segment(0.0, -1.5, 0.0, 3.0, KEEP)])
    *slices, way = closed.search((-1.0, 0.0), (1.0, 0.0), [])
    assert way == []
    free = sum(x <= -KEEP for x in (inside.x_min + CELL * k for k in range(38))) * (int(inside.height / CELL) + 1)
    assert len(slices) == 1 + free // SLICE > 4


def test_the_door_is_a_gate() -> None:
    (gate,) = gates_between(DOOR, ARENA, KEEP)
    assert (gate.x, gate.y, gate.half) == pytest.approx((0.0, 0.0, 0.4))
    assert abs(gate.nx) == pytest.approx(1.0)
    assert gate_ahead([gate], [(-0.8, 0.3), (0.5, 0.1)]) == gate
    assert gate_ahead([gate], [(-0.8, 0.3), (-0.5, 1.1)]) is None
    assert gate_ahead([gate], [(-1.8, 0.0), (1.5, 0.0)]) is None  # far away yet


@pytest.mark.parametrize(
    ("other", "waits"),
    [
        (near(0.3, 0.0, vx=-0.4, theta=math.pi), True),  # nearer, and comes
        (near(0.3, 0.0, theta=math.pi), False),  # parked
        (near(0.3, 0.0, theta=math.pi, omega=FIDGET), True),  # waits
        (near(0.9, 0.0, vx=-0.4, theta=math.pi), False),  # further from the gate than I am
        (near(-0.3, 0.0, vx=0.4), False),  # on my side: I follow
    ],
)
def test_the_nearest_goes_first(other: Near, waits: bool) -> None:
    (gate,) = gates_between(DOOR, ARENA, KEEP)
    place = place_to_wait(gate, -0.6, 0.0, [other])
    assert (place is not None) == waits
    if place is not None:  # back from the gate on my side, and to my right
        assert place == pytest.approx((-0.5, -0.8))


def test_robots_that_meet_both_turn_clockwise() -> None:
    x, y = free_direction(0.0, 0.0, 0.4, 0.0, [near(0.9, 0.0, vx=-0.4)], ARENA, -1.0)
    assert y < 0.0 < x
    assert first_met(0.0, 0.0, x, y, [near(0.9, 0.0, vx=-0.4)])[1] is None


def test_patience_ends_one_robot_after_the_other_and_tries_two_things() -> None:
    first, second = Patience(0), Patience(1)
    still = State(0.0, 0.0, 0.0, 0.0, 0.0)
    log: dict[int, list[tuple[float, bool]]] = {0: [], 1: []}
    for k in range(240):
        now = 0.05 * k
        for rank, patience in enumerate((first, second)):
            patience.look(now, still, True)
            log[rank].append((patience.side, patience.retreating))
    began = [next(k for k, entry in enumerate(log[rank]) if entry != (-1.0, False)) for rank in (0, 1)]
    assert began[0] < began[1]
    assert {(1.0, False), (-1.0, True)} <= set(log[0])
    first.look(12.0, still, False)
    assert first.look(12.1, still, True) == pytest.approx(0.1)
