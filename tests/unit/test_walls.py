"""Walls inside the arena: how far a place or a path is from them, and that the filter of a robot knows them."""

from __future__ import annotations

import contextlib
import math
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from muro_zenoh.behaviours.interface import Neighbour, Snapshot
from muro_zenoh.config import parse_scenario
from muro_zenoh.control.path_tracking import TrackingGains
from muro_zenoh.control.ride import RideSettings, set_out
from muro_zenoh.control.speed_profile import SpeedProfile
from muro_zenoh.errors import ParameterError, PlanningError
from muro_zenoh.geometry import Bounds, Pose2, State, Twist2
from muro_zenoh.planning.arena import plan_inside, require_path_clear
from muro_zenoh.planning.clearance import clearance
from muro_zenoh.planning.destination import Destination
from muro_zenoh.planning.dubins import plan
from muro_zenoh.planning.path import Path, Segment
from muro_zenoh.walls import Wall, edges, require_clear

ARENA = Bounds(-2.1, 2.1, -1.5, 1.5)
DOORWAY = (Wall(0.0, -1.5, 0.0, -0.4), Wall(0.0, 0.4, 0.0, 1.5))
KEEP = 0.197

COORDINATE = st.floats(-2.0, 2.0)
POSES = st.builds(Pose2, COORDINATE, COORDINATE, st.floats(-math.pi, math.pi))
WALLS = st.builds(Wall, COORDINATE, COORDINATE, COORDINATE, COORDINATE).filter(
    lambda wall: math.dist(wall[:2], wall[2:]) > 0.01
)


@given(wall=WALLS, x=COORDINATE, y=COORDINATE)
def test_the_distance_is_that_of_the_nearest_of_its_points(wall: Wall, x: float, y: float) -> None:
    parts = np.linspace(0.0, 1.0, 2001)
    along_x, along_y = wall.x + parts * (wall.x_end - wall.x), wall.y + parts * (wall.y_end - wall.y)
    assert wall.distance(x, y) == pytest.approx(float(np.hypot(along_x - x, along_y - y).min()), abs=2e-3)
    many = wall.distance(np.array([x, 1.0]), np.array([y, 0.5]))
    assert many.tolist() == pytest.approx([wall.distance(x, y), wall.distance(1.0, 0.5)])


def test_an_arena_has_four_edges() -> None:
    around = edges(ARENA)
    assert len(around) == 4
    assert min(wall.distance(1.9, 0.0) for wall in around) == pytest.approx(0.2)
    assert min(wall.distance(0.0, -1.4) for wall in around) == pytest.approx(0.1)
    assert sum(math.dist(wall[:2], wall[2:]) for wall in around) == pytest.approx(2 * (4.2 + 3.0))


def test_a_place_is_clear_of_a_wall_from_its_distance_on() -> None:
    require_clear("goal", KEEP, 1.0, DOORWAY, KEEP)
    require_clear("goal", 0.0, 0.0, DOORWAY, KEEP)
    with pytest.raises(ParameterError, match=r"goal: got \(0\.19, 1\), 0\.190 m from the wall from \(0, 0\.4\)"):
        require_clear("goal", 0.19, 1.0, DOORWAY, KEEP)


# ---- paths


PATHS = st.builds(
    Path,
    POSES,
    st.lists(
        # Below 1e-4 / m a bend is no longer told from a straight line to 1e-9 m.
        st.builds(Segment, st.floats(0.0, 1.5), st.just(0.0) | st.floats(1e-4, 6.0) | st.floats(-6.0, -1e-4)),
        max_size=4,
    ).map(tuple),
)


@settings(max_examples=300)
@given(path=PATHS | st.builds(plan, POSES, POSES, st.just(0.3)), wall=WALLS, enough=st.floats(0.0, 1.0))
def test_the_clearance_of_a_path_is_that_of_its_nearest_point(path: Path, wall: Wall, enough: float) -> None:
    sampled = min(wall.distance(pose.x, pose.y) for pose in path.sample(0.01))
    found = clearance(path, wall)
    assert found <= sampled + 1e-9
    assert found >= sampled - 0.0051, "no point of a path is farther than half a step from a sampled one"
    assert clearance(path, wall, enough) == pytest.approx(min(found, enough), abs=1e-12)


@pytest.mark.parametrize(
    ("segments", "wall", "distance"),
    [
        ((Segment(2.0, 0.0),), Wall(1.0, -1.0, 1.0, 1.0), 0.0),  # straight through
        ((Segment(1.2, 0.0),), Wall(1.0, -1.0, 1.0, 1.0), 0.0),  # and it ends behind it
        ((Segment(2.0, 0.0),), Wall(1.0, -1.0, 1.0, -0.1), 0.1),  # past its end
        ((Segment(2.0, 0.0),), Wall(-1.0, 0.3, 3.0, 0.3), 0.3),  # along it
        ((Segment(math.pi, 1.0),), Wall(1.25, 0.0, 1.25, 2.0), 0.25),  # the outermost point of half a circle
        ((Segment(math.pi, 1.0),), Wall(-1.0, 1.0, 0.5, 1.0), 0.5),  # inside it
        ((Segment(math.pi, 1.0),), Wall(-1.0, 1.0, 1.5, 1.0), 0.0),  # it crosses at its outermost point
        ((Segment(math.pi, 1.0),), Wall(0.5, -1.0, 0.5, 1.0), 0.0),  # it crosses on its way out
        ((Segment(math.pi, 1.0),), Wall(0.5, 1.0, 0.5, 3.0), 0.0),  # on its way back
        ((Segment(math.pi, 1.0),), Wall(-0.5, 1.0, -0.5, 1.2), math.hypot(0.5, 0.8)),  # it does not come round so far
        ((Segment(math.tau, -1.0),), Wall(-0.2, -2.2, 0.2, -2.2), 0.2),  # to the right
        ((), Wall(1.0, 1.0, 1.0, -1.0), 1.0),  # it has no length
        ((Segment(1.0, 0.0), Segment(1.0, 0.0)), Wall(1.0, 0.0, 1.0, 1.0), 0.0),  # where two pieces meet
        ((Segment(2.0, 0.0),), Wall(-2.0, 0.0, -1.0, 0.0), 1.0),  # in line with it, behind
        ((Segment(2.0, 0.0),), Wall(1.0, 0.0, 4.0, 0.0), 0.0),  # along its very line
        ((Segment(4.0 * math.pi, 1.0),), Wall(-1.1, 1.0, -3.0, 1.0), 0.1),  # twice round
    ],
)
def test_the_clearance_is_exact(segments: tuple[Segment, ...], wall: Wall, distance: float) -> None:
    path = Path(Pose2(0.0, 0.0, 0.0), segments)
    assert clearance(path, wall) == pytest.approx(distance, abs=1e-9)
    assert clearance(path, wall, 0.2) == pytest.approx(min(distance, 0.2), abs=1e-9)


def test_a_path_through_a_doorway_is_planned_and_one_through_a_wall_refused() -> None:
    front, behind, beyond = Pose2(-0.6, 0.0, 0.0), Pose2(0.6, 0.0, 0.0), Pose2(-1.3, 0.8, 0.0)
    path = plan_inside(front, behind, 0.3, ARENA, KEEP, DOORWAY)
    assert path.length == pytest.approx(1.2)
    crossing = r"path from \(-1\.300, 0\.800\) to \(1\.300, 0\.800\) m crosses the wall from \(0, 0\.4\) to \(0, 1\.5\)"
    with pytest.raises(PlanningError, match=crossing):
        plan_inside(beyond, Pose2(1.3, 0.8, 0.0), 0.3, ARENA, KEEP, DOORWAY)
    with pytest.raises(PlanningError, match=r"goal: got \(0\.1, 0\.8\), 0\.100 m from the wall"):
        plan_inside(beyond, Pose2(0.1, 0.8, 0.0), 0.3, ARENA, KEEP, DOORWAY)


def test_a_longer_path_is_taken_where_the_shortest_one_comes_too_near_a_wall() -> None:
    start, goal = Pose2(0.0, 0.0, 0.0), Pose2(-0.1, 0.0, math.pi)
    free = plan_inside(start, goal, 0.3, ARENA)
    side = math.copysign(1.0, free.pose_at(0.5 * free.length).y)
    wall = Wall(-1.0, side * 0.5, 1.0, side * 0.5)
    other = plan_inside(start, goal, 0.3, ARENA, KEEP, (wall,))
    assert clearance(free, wall) < KEEP <= clearance(other, wall)
    assert other.length >= free.length - 1e-9


@pytest.mark.parametrize("walls", [DOORWAY, (Wall(0.0, -1.5, 0.0, 1.5),)])
@pytest.mark.parametrize("goal", [Destination(1.0, 0.2), Destination(1.3, 0.8, 1.0)])
def test_a_goal_to_which_there_is_no_path_is_soon_given_up(walls: tuple[Wall, ...], goal: Destination) -> None:
    """It is planned between two commands: in function calls, as many as a slow computer does in a tenth of a second."""
    ride, calls = RideSettings(SpeedProfile(), TrackingGains(), 0.3, ARENA, KEEP, walls=walls), 0

    def count(frame: object, event: str, arg: object) -> None:
        nonlocal calls
        calls += event == "call"

    sys.setprofile(count)
    try:
        with contextlib.suppress(PlanningError):
            set_out(Pose2(-1.0, 0.8, 0.4), goal, 0.0, ride)
    finally:
        sys.setprofile(None)
    assert 0 < calls < 30_000


def test_a_robot_too_near_a_wall_can_drive_away_from_it() -> None:
    require_path_clear(Path(Pose2(0.1, 1.0, 0.0), (Segment(1.0, 0.0),)), DOORWAY, KEEP)
    with pytest.raises(PlanningError, match=r"comes within 0\.050 m of the wall"):
        require_path_clear(Path(Pose2(0.1, 1.0, math.pi), (Segment(0.05, 0.0),)), DOORWAY, KEEP)


# ---- the filter


@pytest.mark.parametrize("walled", [True, False])
def test_the_filter_of_a_robot_knows_the_walls_of_its_scenario(walled: bool) -> None:
    wall = {"start": [0.3, -1.0], "end": [0.3, 1.0]}
    lab = parse_scenario({"robots": 1, "wall": [wall] if walled else []}, "lab.toml", name="lab")
    separation = lab.separation_of("r1")
    assert separation is not None
    for k in range(40):  # it listens before it drives
        seen = Snapshot((Neighbour("r1", 0.0, 0.0, 0.0, 0.0, 0.0, 0.05),), 7.0 + 0.05 * k, 3, 0.0)
        step = separation.step(7.0 + 0.05 * k, State(0.0, 0.0, 0.0, 0.0, 0.0), Twist2(0.4, 0.0), seen)
    assert ("wall" in step.reason) == walled
    assert (step.twist == Twist2(0.4, 0.0)) == (not walled)
