"""The way round: planner, gates, patience."""

from __future__ import annotations

import math
from itertools import combinations

import pytest

from muro_zenoh.geometry import Bounds, State
from muro_zenoh.safety.separation.gates import Wait, Waits, gate_ahead, gates_between, place_to_wait
from muro_zenoh.safety.separation.guidance import FIDGET, Near
from muro_zenoh.safety.separation.liveness import Patience, first_met, free_direction, roomiest
from muro_zenoh.safety.separation.planner import CELL, SLICE, Planner, Segment
from muro_zenoh.safety.separation.route import Route
from muro_zenoh.walls import Wall

ARENA = Bounds(-2.1, 2.1, -1.5, 1.5)
DOOR = (Wall(0.0, 0.4, 0.0, 1.5), Wall(0.0, -1.5, 0.0, -0.4))
KEEP = 0.197
MY_TURN, THEIR_TURN = 12.0, 4.0
"""Of the robots on the door's left side [s]."""


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


@pytest.mark.parametrize(("omega", "is_parked"), [(0.0, True), (FIDGET, False)])
def test_the_way_leads_round_a_neighbour_that_is_parked(omega: float, is_parked: bool) -> None:
    """One that turns to and fro waits, and will go on."""
    route, other = Route(ARENA, ARENA.shrunk(KEEP), (), KEEP), near(0.6, 0.05, omega=omega)
    for k in range(60):
        vx, vy = route.toward(0.05 * k, (0.0, 0.0), (0.4, 0.0), (1.2, 0.0), [other], 0.0, True, 0.05 * k)
        if k * 0.05 < 0.95:
            assert (vx, vy) == (0.4, 0.0)
            assert route.parked == []
    assert (route.parked == [other]) is is_parked
    assert ((vx, vy) != (0.4, 0.0)) is is_parked
    if is_parked:
        assert math.hypot(vx, vy) == pytest.approx(0.4)
        # half a metre on, it is as far from the other as it has to be
        assert math.hypot(0.6 - vx / 0.4 * 0.5, 0.05 - vy / 0.4 * 0.5) > 0.35


def test_a_robot_without_a_place_to_drive_to_waits_at_no_gate() -> None:
    route = Route(ARENA, ARENA.shrunk(KEEP), DOOR, KEEP)
    comes = near(0.1, 0.0, vx=-0.3, theta=math.pi)
    route.toward(0.0, (-0.8, 0.0), (0.4, 0.0), (1.2, 0.0), [comes], 0.0, True, THEIR_TURN)
    assert route.waits
    route.leave()
    assert not route.waits
    route.toward(0.1, (-0.8, 0.0), (0.4, 0.0), (1.2, 0.0), [], 0.0, True, MY_TURN)
    assert route.passes
    assert route.at_gate
    route.leave()
    assert not route.passes
    assert not route.at_gate


def test_the_way_to_an_earlier_place_is_not_followed() -> None:
    route = Route(ARENA, ARENA.shrunk(KEEP), DOOR, KEEP)
    for k in range(20):  # to the other room
        there = route.toward(0.05 * k, (-0.8, 1.0), (0.4, 0.0), (0.8, 1.0), [], 1.2, True, MY_TURN)
    assert there[1] < 0.0
    route.leave()
    assert route.toward(1.0, (-0.8, 1.0), (-0.4, 0.0), (-1.6, 1.0), [], 0.0, True, MY_TURN) == (-0.4, 0.0)


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


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(
    ("walls", "gates"),
    [
        ([*DOOR[:1], Wall(0.0, -1.5, 0.0, -0.6), Wall(0.0, -0.6, 0.0, -0.4)], [(0.0, 0.0)]),  # a wall in two rows
        ([*DOOR, Wall(-0.3, 0.1, 0.3, 0.1)], [(0.0, -0.15)]),  # something stands in it, too near to one side
        ([Wall(-0.2, -0.2, 0.2, 0.2), Wall(-0.2, 0.2, 0.2, -0.2)], []),  # they cross
        ([Wall(0.0, -1.5, 0.0, 0.9)], [(0.0, 1.2)]),  # between a wall and the arena's edge
    ],
)
def test_a_gate_is_what_is_free_between_two_walls(
    walls: list[Wall], gates: list[tuple[float, float]], turned: bool
) -> None:
    if turned:
        walls = [Wall(wall.x_end, wall.y_end, wall.x, wall.y) for wall in walls]
    found = [(gate.x, gate.y) for gate in gates_between(walls, ARENA, KEEP)]
    assert found == [pytest.approx(gate) for gate in gates]


@pytest.mark.parametrize(
    ("other", "waits"),
    [
        (near(0.8, 0.0, vx=-0.4, theta=math.pi), True),  # comes, and it is its turn
        (near(0.8, 0.0, theta=math.pi), False),  # parked
        (near(0.8, 0.0, theta=math.pi, omega=FIDGET), True),  # waits
        (near(0.8, 0.0, vx=0.4), False),  # drives away
        (near(1.8, 0.0, vx=-0.4, theta=math.pi), False),  # far from the gate
        (near(-0.5, 0.5, vx=0.4), False),  # on my side: I follow
    ],
)
def test_the_sides_of_a_gate_take_turns(other: Near, waits: bool) -> None:
    (gate,) = gates_between(DOOR, ARENA, KEEP)
    first, second = [place_to_wait(gate, -0.9, 0.0, [other], clock) for clock in (MY_TURN, THEIR_TURN)]
    assert first is None
    assert (second is not None) == waits
    if second is not None:  # back from the gate on my side, and to my right
        assert second == pytest.approx((-0.55, -0.55))


@pytest.mark.parametrize("clock", [MY_TURN, THEIR_TURN])
def test_who_is_inside_a_gate_goes_on_and_the_others_wait(clock: float) -> None:
    (gate,) = gates_between(DOOR, ARENA, KEEP)
    inside = near(-0.2, 0.0, vx=-0.4, theta=math.pi)
    assert place_to_wait(gate, -0.9, 0.0, [inside], clock) is not None
    assert place_to_wait(gate, -0.2, 0.0, [near(0.6, 0.0, vx=-0.4, theta=math.pi)], clock) is None


def test_one_follows_another_through_a_gate() -> None:
    (gate,) = gates_between(DOOR, ARENA, KEEP)
    before = near(-0.3, 0.0, vx=0.4)
    assert place_to_wait(gate, -0.45, 0.4, [before], MY_TURN) is None
    assert place_to_wait(gate, -0.35, 0.35, [before], MY_TURN) == (-0.35, 0.35)


def test_a_robot_waits_for_one_that_comes_out_until_that_is_out() -> None:
    (gate,) = gates_between(DOOR, ARENA, KEEP)
    leaves, is_out = (near(x, 0.0, vx=-0.4, theta=math.pi) for x in (-0.2, -0.3))
    for clock in (MY_TURN, THEIR_TURN):
        assert place_to_wait(gate, -0.45, 0.4, [near(-0.6, 0.0, vx=0.4), leaves], clock) is not None
        assert place_to_wait(gate, -0.45, 0.4, [near(-0.6, 0.0, vx=0.4), is_out], clock) is None


@pytest.mark.parametrize("clock", [MY_TURN, THEIR_TURN])
@pytest.mark.parametrize(("mine", "theirs", "goes"), [(5.0, 3.0, True), (3.0, 5.0, False)])
def test_it_is_the_turn_of_the_side_on_which_a_robot_has_waited_longest(
    clock: float, mine: float, theirs: float, goes: bool
) -> None:
    (gate,) = gates_between(DOOR, ARENA, KEEP)
    other = near(0.6, 0.5, omega=FIDGET, theta=math.pi)
    waits = [Wait(-0.9, 0.0, 1.0), Wait(-0.6, -1.1, mine), Wait(0.6, 0.5, theirs), Wait(1.7, 0.0, 60.0)]
    assert (place_to_wait(gate, -0.9, 0.0, [other], clock, waits) is None) is goes


@pytest.mark.parametrize("clock", [MY_TURN, THEIR_TURN])
@pytest.mark.parametrize(("mine", "theirs", "goes"), [(5.0, 3.5, False), (5.0, 2.5, True)])
def test_each_robot_more_on_a_side_counts_like_a_second(clock: float, mine: float, theirs: float, goes: bool) -> None:
    """Those that are parked do not."""
    (gate,) = gates_between(DOOR, ARENA, KEEP)
    other = near(0.6, 0.5, omega=FIDGET, theta=math.pi)
    waits = [Wait(-0.9, 0.0, mine), Wait(0.6, 0.5, theirs)]
    fleet = [other, near(1.5, 1.0, vx=0.4), near(1.9, -1.0, omega=FIDGET), near(1.5, -0.5), near(-1.5, -0.5)]
    assert (place_to_wait(gate, -0.9, 0.0, [other], clock, waits, fleet) is None) is goes
    waits = [Wait(-0.9, 0.0, 15.0), Wait(0.6, 0.5, 6.5)]
    many = [near(1.5, 0.1 * k, vx=0.4) for k in range(12)]
    assert place_to_wait(gate, -0.9, 0.0, [other], clock, waits, [other, *many]) is None, "8 s at most"
    one = near(-0.9, 0.0, omega=FIDGET)
    assert place_to_wait(gate, 0.6, 0.5, [one], clock, waits, [one, *many]) is not None, "the others see it likewise"


def test_who_does_not_go_for_long_keeps_nobody_waiting() -> None:
    """It may not want to go through at all."""
    (gate,) = gates_between(DOOR, ARENA, KEEP)
    other = near(0.6, 0.5, omega=FIDGET, theta=math.pi)
    for seconds, goes in ((15.0, False), (17.0, True)):
        waits = [Wait(-0.9, 0.0, 2.0), Wait(0.6, 0.5, seconds)]
        assert (place_to_wait(gate, -0.9, 0.0, [other], THEIR_TURN, waits) is None) is goes


@pytest.mark.parametrize("seconds", [0.9, 5.0])
def test_the_clock_decides_while_nobody_has_waited_or_both_sides_have_equally(seconds: float) -> None:
    (gate,) = gates_between(DOOR, ARENA, KEEP)
    other = near(0.6, 0.0, omega=FIDGET, theta=math.pi)
    waits = [Wait(-0.9, 0.0, 0.9), Wait(-0.9, 0.0, seconds), Wait(0.6, 0.0, seconds)]
    places = [place_to_wait(gate, -0.9, 0.0, [other], clock, waits, [other]) for clock in (MY_TURN, THEIR_TURN)]
    assert places[0] is None
    assert places[1] is not None


def test_how_long_robots_have_waited() -> None:
    """Who gets on, was parked or out of sight begins anew; one that turns to and fro waits, also in the moment in which
    it does not turn."""
    waits = Waits()

    def look(now: float, x: float, **others: Near) -> dict[float, float]:
        """The waiting times by x."""
        rows = [other._replace(name=name) for name, other in others.items()]
        return {wait.x: pytest.approx(wait.seconds) for wait in waits.look(now, (x, 0.0), rows)}

    fidgets, stands = near(1.0, 0.0, omega=FIDGET), near(1.0, 0.0)
    assert look(0.0, 0.0, r1=fidgets, r2=near(2.0, 0.0)) == {0.0: 0.0, 1.0: 0.0}, "r2 is parked"
    assert look(0.7, 0.2, r1=stands) == {0.0: 0.7, 1.0: 0.7}
    assert look(1.4, 0.4, r1=fidgets) == {0.4: 0.0, 1.0: 0.0}, "one has got on, the other stood for too long"
    assert look(2.0, 0.4, r1=fidgets) == {0.4: 0.6, 1.0: 0.6}
    assert look(2.9, 0.4) == {0.4: 1.5, 1.0: 1.5}, "it is out of sight for a moment"
    assert look(3.1, 0.4) == {0.4: 1.7}
    assert look(3.2, 0.4, r1=fidgets) == {0.4: 1.8, 1.0: 0.0}
    assert look(9.0, 0.4, r1=fidgets) == {0.4: 0.0, 1.0: 0.0}, "nobody looked"


def test_a_route_knows_who_has_waited_longest() -> None:
    """The others come, but it has waited longer: then it goes, although by the clock it is their turn."""
    route = Route(ARENA, ARENA.shrunk(KEEP), DOOR, KEEP)
    for k in range(41):
        comes = near(1.4 - 0.02 * k, 0.0, vx=-0.4, theta=math.pi)
        route.toward(0.05 * k, (-0.9, 0.0), (0.4, 0.0), (1.2, 0.0), [comes], 0.0, True, THEIR_TURN)
        assert route.waits == (0.05 * k < 1.0)


def test_each_waits_in_a_place_of_its_own() -> None:
    (gate,) = gates_between(DOOR, ARENA, KEEP)
    coming = near(0.8, 0.0, vx=-0.4, theta=math.pi)
    queue = [near(-0.55 - 0.1 * k, -0.5, omega=FIDGET, theta=0.5) for k in range(4)]
    places = [place_to_wait(gate, -1.3, -0.5, [coming, *queue[:k]], THEIR_TURN) for k in range(5)]
    found = [place for place in places if place is not None]
    assert len(found) == 5
    assert min(math.dist(a, b) for a, b in combinations(found, 2)) > 0.4
    assert all(ARENA.shrunk(KEEP).holds(x, y) for x, y in found)


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
            patience.look(now, still, True, False)
            log[rank].append((patience.side, patience.retreating))
    began = [next(k for k, entry in enumerate(log[rank]) if entry != (-1.0, False)) for rank in (0, 1)]
    assert began[0] < began[1]
    assert {(1.0, False), (-1.0, True)} <= set(log[0])
    first.look(12.0, still, False, False)
    assert first.look(12.1, still, True, False) == pytest.approx(0.1)


def test_a_robot_in_a_queue_is_patient_and_then_backs_off() -> None:
    patience = Patience(0)
    still = State(0.0, 0.0, 0.0, 0.0, 0.0)
    log = []
    for k in range(160):
        patience.look(0.05 * k, still, True, True)
        log.append((patience.side, patience.retreating))
    began = next(k for k, entry in enumerate(log) if entry != (-1.0, False))
    assert 2.95 < 0.05 * began < 3.2
    assert log[began] == (-1.0, True)


def test_a_robot_that_has_backed_off_from_a_queue_is_patient_again() -> None:
    """Also when it has not got anywhere: while it backs off it waits in no queue, and yet it comes from one."""
    patience, still = Patience(0), State(0.0, 0.0, 0.0, 0.0, 0.0)
    retreats = []
    for k in range(400):
        patience.look(0.0501 * k, still, True, not patience.retreating)
        retreats.append(patience.retreating)
    began = retreats.index(True)
    lasts = retreats[began:].index(False)
    assert 0.0501 * lasts < 2.7
    assert 0.0501 * retreats[began + lasts :].index(True) > 0.4


def test_a_robot_that_backs_off_is_in_the_queue_although_whose_turn_it_is_changes_to_and_fro() -> None:
    patience, still = Patience(0), State(0.0, 0.0, 0.0, 0.0, 0.0)
    for until, first in ((4.0, (3.05, -1.0, True)), (1.0, (2.55, 1.0, False))):  # elsewhere it tries the other side
        patience.begin_anew()
        log = []
        for k in range(80):
            now = 0.05 * k
            patience.look(now, still, True, k % 9 == 0 and now < until)
            log.append((pytest.approx(now, abs=0.06), patience.side, patience.retreating))
        assert next(entry for entry in log if entry[1:] != (-1.0, False)) == first


def test_in_front_of_a_gate_a_robot_backs_off_also_to_where_there_is_less_room() -> None:
    """Elsewhere it stays: where all stand in a queue, they shut in those who come out of the gate."""
    still, shut_in = State(0.0, 0.0, 0.0, 0.0, 0.0), [near(x, y) for x, y in ((-0.7, 0.0), (0.7, 0.0), (0.0, -0.7))]
    for may_stay in (True, False):
        away = roomiest(still, shut_in, ARENA.shrunk(KEEP), 0.2, may_stay=may_stay)
        assert (away == (0.0, 0.0)) is may_stay


def test_a_robot_that_may_not_stay_goes_where_it_gets_anywhere() -> None:
    """There is as little room behind it as here, but ahead and beside it cannot move at all."""
    still, around = State(0.0, 0.0, 0.0, 0.0, 0.0), [near(x, y) for x, y in ((0.4, 0.0), (0.0, 0.41), (0.0, -0.41))]
    x, y = roomiest(still, [*around, near(-0.52, 0.0)], ARENA.shrunk(KEEP), 0.2, may_stay=False)
    assert (x, y) == pytest.approx((-0.2, 0.0))
    assert roomiest(still, [*around, near(-0.45, 0.0)], ARENA.shrunk(KEEP), 0.2, may_stay=False) == (0.0, 0.0)


@pytest.mark.parametrize(("behind", "turns_back"), [(0.9, False), (1.3, True)])
@pytest.mark.parametrize("heading", [0.5 * math.pi, -0.5 * math.pi])
def test_a_robot_that_must_not_stay_turns_back_only_to_much_more_room(
    heading: float, behind: float, turns_back: bool
) -> None:
    """There is none ahead of it where it gets to, and 0.15 m behind it or 0.21 m; beside it there is no way."""
    state, side = State(0.0, 0.0, heading, 0.0, 0.0), math.copysign(1.0, heading)
    around = [near(-0.5, 0.0), near(0.5, 0.0), near(0.0, 0.7 * side), near(0.0, -behind * side)]
    _, uy = roomiest(state, around, ARENA.shrunk(KEEP), 0.2, may_stay=False)
    assert (uy * side < 0.0) is turns_back


def test_a_robot_that_may_stay_goes_to_the_most_room_wherever_it_looks() -> None:
    beside = [near(0.0, 0.6), near(0.0, -0.6), near(1.2, 0.0), near(-1.2, 0.0)]
    ways = [roomiest(State(0.0, 0.0, theta, 0.0, 0.0), beside, ARENA.shrunk(KEEP), 0.2) for theta in (0.0, math.pi)]
    assert ways[0] == ways[1] != (0.0, 0.0)


def test_who_backs_off_from_a_queue_goes_when_it_is_its_turn() -> None:
    """When that is over at once, it goes on backing off; one that backs off elsewhere does so to the end."""
    still = State(0.0, 0.0, 0.0, 0.0, 0.0)
    for queues in (True, False):
        patience = Patience(0)
        steps = (patience.look(0.05 * k, still, True, queues) for k in range(400))
        next(k for k, _ in enumerate(steps) if patience.retreating)
        assert [patience.backs_off(waits) for waits in (True, False, True)] == [True, not queues, True]


def test_a_robot_that_backs_off_knows_whether_it_is_its_turn() -> None:
    route = Route(ARENA, ARENA.shrunk(KEEP), DOOR, KEEP)
    comes = near(0.8, 0.0, vx=-0.4, theta=math.pi)
    for clock, passes in ((THEIR_TURN, False), (MY_TURN, True)):
        route.toward(0.0, (-0.9, 0.0), (0.4, 0.0), (1.2, 0.0), [comes], 0.0, False, clock)
        assert not route.waits
        assert route.passes is passes
    route.toward(0.0, (-0.9, 0.0), (-0.4, 0.0), (-1.5, 0.0), [comes], 0.0, False, MY_TURN)
    assert not route.passes, "no gate is in its way"
