"""Dubins plans against OMPL, and their path against its formulas."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from muro_zenoh.elementwise import Array
from muro_zenoh.errors import ParameterError, PlanningError
from muro_zenoh.geometry import Bounds, Pose2, wrap_to_pi
from muro_zenoh.planning.arena import plan_after_turn, plan_inside, require_path_inside
from muro_zenoh.planning.destination import Destination, goal_heading, goal_pose, require_inside
from muro_zenoh.planning.dubins import WORDS, all_words, plan, shortest_word
from muro_zenoh.planning.path import Path, Segment

COORDINATE = st.floats(-3.0, 3.0)
ANGLE = st.floats(-math.pi, math.pi)
POSES = st.builds(Pose2, COORDINATE, COORDINATE, ANGLE)
RADIUS = 0.3


def random_pairs(count: int, reach: float, seed: int) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    ends = rng.uniform(-reach, reach, (2, count, 3))
    ends[:, :, 2] = rng.uniform(-math.pi, math.pi, (2, count))
    return ends[0], ends[1]


def close_pairs(count: int, seed: int) -> tuple[Array, Array]:
    """From two turning radii to a ten-thousandth of one apart, headings alike or opposite.

    Nearer than a millionth OMPL calls two poses the same, and a path that just fails to be straight need not turn.
    """
    rng = np.random.default_rng(seed)
    start = rng.uniform(-1.0, 1.0, (count, 3)) * [3.0, 3.0, math.pi]
    reach = RADIUS * 10.0 ** rng.uniform(-4.0, math.log10(2.0), (count, 1))
    goal = start + rng.uniform(-1.0, 1.0, (count, 3)) * reach * [1.0, 1.0, 3.0]
    goal[::4, 2] += math.pi
    return start, goal


@pytest.mark.parametrize("pairs", [random_pairs(10_000, 3.0, 1), close_pairs(10_000, 2)], ids=["random", "close"])
def test_lengths_agree_with_ompl(pairs: tuple[Array, Array]) -> None:
    base = pytest.importorskip("ompl.base", reason="OMPL publishes no wheel for this platform")
    space = base.DubinsStateSpace(RADIUS)
    a, b = space.allocState(), space.allocState()
    for start, goal in zip(*(ends.tolist() for ends in pairs), strict=True):
        for state, (x, y, theta) in ((a, start), (b, goal)):
            state.setX(x)
            state.setY(y)
            state.setYaw(wrap_to_pi(theta))
        length = shortest_word(Pose2(*start), Pose2(*goal), RADIUS).size * RADIUS
        assert length == pytest.approx(space.distance(a, b), abs=1e-9)


@pytest.mark.parametrize("pairs", [random_pairs(2_000, 1.0, 3), close_pairs(2_000, 4)], ids=["random", "close"])
def test_arrays_and_floats_agree_and_every_word_arrives(pairs: tuple[Array, Array]) -> None:
    words = all_words(*pairs, RADIUS)
    turn = {"L": 1.0, "S": 0.0, "R": -1.0}
    for k, (start, goal) in enumerate(zip(*(ends.tolist() for ends in pairs), strict=True)):
        best = shortest_word(Pose2(*start), Pose2(*goal), RADIUS)
        assert best.size == pytest.approx(words.size[k].min(), abs=1e-12)
        for j, word in enumerate(WORDS):
            if not math.isfinite(words.size[k, j]):
                continue
            sizes = (words.first[k, j], words.middle[k, j], words.last[k, j])
            pieces = tuple(Segment(s * RADIUS, turn[c] / RADIUS) for c, s in zip(word, sizes, strict=True))
            assert_same(Path(Pose2(*start), pieces).end, Pose2(*goal), 3e-8)


def assert_same(pose: Pose2, other: Pose2, tolerance: float) -> None:
    assert math.dist(pose[:2], other[:2]) <= tolerance
    assert abs(wrap_to_pi(pose.theta - other.theta)) <= 10 * tolerance


@given(start=POSES, goal=POSES, radius=st.floats(0.1, 1.0))
def test_the_path_arrives_no_tighter_than_the_radius_and_no_shorter_than_the_straight(
    start: Pose2, goal: Pose2, radius: float
) -> None:
    path = plan(start, goal, radius)
    assert_same(path.end, goal, 1e-8)
    assert path.length >= math.dist(start[:2], goal[:2]) - 1e-9
    assert all(abs(piece.curvature) in (0.0, 1.0 / radius) for piece in path.segments)


def reversed_length(start: Pose2, goal: Pose2) -> float:
    """The length of the plan from the reversed goal to the reversed start."""

    def turned(pose: Pose2) -> Pose2:
        return Pose2(pose.x, pose.y, wrap_to_pi(pose.theta + math.pi))

    return plan(turned(goal), turned(start), RADIUS).length


# Turns vanish and circles touch on this grid again and again, and nowhere on it does one only just not.
STEPS = st.integers(-20, 20)
GRID = st.builds(lambda x, y, turn: Pose2(0.15 * x, 0.15 * y, math.pi / 12 * turn), STEPS, STEPS, st.integers(-11, 12))


@given(start=GRID, goal=GRID)
@example(start=Pose2(0.15 * 9, 0.15 * -5, math.pi), goal=Pose2(0.15 * 5, 0.15 * -1, math.pi))  # touching circles
@example(start=Pose2(0.0, 0.0, 0.0), goal=Pose2(1.5, 0.0, 0.0))
def test_backwards_in_time_it_is_as_long(start: Pose2, goal: Pose2) -> None:
    path = plan(start, goal, RADIUS)
    assert_same(path.end, goal, 3e-8)
    assert reversed_length(start, goal) == pytest.approx(path.length, abs=1e-6)
    words = all_words(np.array(start), np.array(goal), RADIUS)
    assert words.size.min() * RADIUS == pytest.approx(path.length, abs=1e-6)


@pytest.mark.parametrize("pairs", [random_pairs(3_000, 3.0, 5), close_pairs(3_000, 6)], ids=["random", "close"])
def test_backwards_in_time_it_is_as_long_off_the_grid_too(pairs: tuple[Array, Array]) -> None:
    for start, goal in zip(*(ends.tolist() for ends in pairs), strict=True):
        there = plan(Pose2(*start), Pose2(*goal), RADIUS).length
        assert reversed_length(Pose2(*start), Pose2(*goal)) == pytest.approx(there, abs=1e-6)


@pytest.mark.parametrize("word", WORDS)
def test_no_plan_is_longer_than_a_path_that_arrives(word: str) -> None:
    """Paths of any word, whose pieces vanish by turns: a plan with one spurious circle would be longer."""
    rng = np.random.default_rng(7)
    turn = {"L": 1.0, "S": 0.0, "R": -1.0}
    for which in range(1, 8):
        for _ in range(300):
            sizes = [size if which >> k & 1 else 0.0 for k, size in enumerate(rng.uniform(0.0, math.pi, 3).tolist())]
            pieces = tuple(Segment(size * RADIUS, turn[c] / RADIUS) for c, size in zip(word, sizes, strict=True))
            there = Path(Pose2(*rng.uniform(-3.0, 3.0, 3).tolist()), pieces)
            best = shortest_word(there.start, there.end, RADIUS)
            assert best.size * RADIUS <= there.length + 1e-6
            assert all_words(np.array(there.start), np.array(there.end), RADIUS).size.min() <= best.size + 1e-6


def test_a_path_to_its_own_start_has_no_length() -> None:
    for theta in np.linspace(-math.pi, math.pi, 37).tolist():
        pose = Pose2(1.7, -0.3, theta)
        assert plan(pose, pose, RADIUS).length == pytest.approx(0.0, abs=1e-12)


def test_straight_ahead_has_no_spurious_full_circle() -> None:
    rng = np.random.default_rng(6)
    for x, y, theta, ahead in rng.uniform(-3.0, 3.0, (2000, 4)).tolist():
        goal = Pose2(x + abs(ahead) * math.cos(theta), y + abs(ahead) * math.sin(theta), theta)
        assert plan(Pose2(x, y, theta), goal, RADIUS).length == pytest.approx(abs(ahead), abs=1e-8)


def test_a_goal_inside_the_turning_circle_is_reached() -> None:
    path = plan(Pose2(0.0, 0.0, 0.0), Pose2(0.0, 0.3, 0.0), 0.5)
    assert_same(path.end, Pose2(0.0, 0.3, 0.0), 1e-9)
    assert path.length > math.pi * 0.5


@given(start=POSES, goal=POSES)
def test_sampled_poses_are_a_step_apart_and_turn_with_the_curvature(start: Pose2, goal: Pose2) -> None:
    path = plan(start, goal, RADIUS)
    poses = list(path.sample(0.05))
    assert poses[0] == start
    assert_same(poses[-1], goal, 1e-8)
    assert all(math.dist(a[:2], b[:2]) <= 0.05 + 1e-9 for a, b in itertools.pairwise(poses))
    for s in np.linspace(0.0, path.length, 9)[1:-1].tolist():
        if any(abs(s - knot) < 1e-3 for knot in path.distances):
            continue
        ahead, behind = path.pose_at(s + 1e-6), path.pose_at(s - 1e-6)
        assert wrap_to_pi(ahead.theta - behind.theta) / 2e-6 == pytest.approx(path.curvature_at(s), abs=1e-6)
        course = math.atan2(ahead.y - behind.y, ahead.x - behind.x)
        assert wrap_to_pi(course - path.pose_at(s).theta) == pytest.approx(0.0, abs=1e-6)


@given(start=POSES, goal=POSES, x=COORDINATE, y=COORDINATE, window=st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 1.0)))
def test_projection_finds_the_nearest_point_of_its_window(
    start: Pose2, goal: Pose2, x: float, y: float, window: tuple[float, float]
) -> None:
    path = plan(start, goal, RADIUS)
    low, high = (path.length * part for part in sorted(window))
    s = path.project(x, y, low, high)
    assert low - 1e-9 <= s <= high + 1e-9
    found = path.pose_at(s)
    samples = [path.pose_at(way) for way in np.linspace(low, high, 300).tolist()]
    assert math.hypot(found.x - x, found.y - y) <= min(math.hypot(p.x - x, p.y - y) for p in samples) + 1e-9


@given(start=POSES, goal=POSES)
def test_the_extent_is_the_tight_bounding_box(start: Pose2, goal: Pose2) -> None:
    path = plan(start, goal, RADIUS)
    x_min, x_max, y_min, y_max = path.extent()
    xs, ys, _ = np.array(list(path.sample(0.003))).T
    np.testing.assert_allclose([x_min, x_max, y_min, y_max], [xs.min(), xs.max(), ys.min(), ys.max()], atol=2e-5)


def test_an_invalid_segment_is_refused() -> None:
    for length, curvature in ((-0.1, 0.0), (math.nan, 0.0), (1.0, math.inf)):
        with pytest.raises(ValueError, match="path segment"):
            Path(Pose2(0.0, 0.0, 0.0), (Segment(length, curvature),))
    with pytest.raises(ValueError, match="radius above 0"):
        plan(Pose2(0.0, 0.0, 0.0), Pose2(1.0, 0.0, 0.0), 0.0)
    with pytest.raises(ValueError, match="finite"):
        plan(Pose2(0.0, math.nan, 0.0), Pose2(1.0, 0.0, 0.0), 0.3)


ARENA = Bounds(-2.1, 2.1, -1.5, 1.5)


def test_a_goal_outside_the_arena_is_refused_with_the_reason() -> None:
    with pytest.raises(
        ParameterError, match=r"goal: got \(2\.5, 0\), outside the arena, expected x -2\.1 to 2\.1, y -1\.5 to 1\.5 m"
    ):
        require_inside("goal", 2.5, 0.0, ARENA)
    with pytest.raises(ParameterError, match=r"too near its border.*0\.177 m inside the border"):
        require_inside("goal", 2.0, 0.0, ARENA, 0.177)
    with pytest.raises(ParameterError):
        require_inside("goal", math.nan, 0.0, ARENA)
    require_inside("goal", 2.1, -1.5, ARENA)


@pytest.mark.parametrize("place", [(math.nan, 0.0), (0.0, math.inf), (0.0, 0.0, math.nan)])
def test_a_goal_has_finite_numbers(place: tuple[float, ...]) -> None:
    with pytest.raises(ParameterError, match=r": got (nan|inf), expected a number"):
        Destination(*place)


def test_a_path_that_leaves_the_arena_is_refused_or_replaced() -> None:
    start, goal = Pose2(1.9, 0.0, 0.5), Pose2(1.9, 0.4, math.pi)
    straight_out = plan(start, goal, 0.4)
    with pytest.raises(PlanningError, match=r"leaves the arena by 0\.\d+ m"):
        require_path_inside(straight_out, ARENA)
    start, goal = Pose2(0.0, 1.3, 0.0), Pose2(-0.7, 1.1, -1.1)
    assert plan(start, goal, 0.3).extent()[3] > 1.5
    path = plan_inside(start, goal, 0.3, ARENA)
    assert_same(path.end, goal, 1e-9)
    assert path.extent()[3] <= 1.5
    with pytest.raises(PlanningError, match="outside the arena"):
        plan_inside(start, Pose2(0.0, 1.6, 0.0), 0.3, ARENA)
    facing, goal = Pose2(0.0, 1.4, 1.2), Pose2(0.0, -0.5, -math.pi / 2)
    out = plan(facing, goal, 0.3).extent()[3] - 1.5
    with pytest.raises(PlanningError, match=rf"leaves the arena by {out:.3f} m"):  # the shortest does
        plan_inside(facing, goal, 0.3, ARENA)


@given(start=st.builds(Pose2, st.floats(-2, 2), st.floats(-1.4, 1.4), ANGLE), goal=st.builds(
    Pose2, st.floats(-1.2, 1.2), st.floats(-0.6, 0.6), ANGLE))  # fmt: skip
def test_plan_inside_stays_inside_and_is_the_shortest_when_possible(start: Pose2, goal: Pose2) -> None:
    try:
        path = plan_inside(start, goal, RADIUS, ARENA)
    except PlanningError:
        return
    require_path_inside(path, ARENA)
    best = plan(start, goal, RADIUS)
    x_min, x_max, y_min, y_max = best.extent()
    if x_min >= -2.1 and x_max <= 2.1 and y_min >= -1.5 and y_max <= 1.5:
        assert path.length == pytest.approx(best.length, abs=1e-9)


def test_a_start_too_near_a_wall_can_drive_away_from_it() -> None:
    path = plan_inside(Pose2(2.05, 0.0, math.pi), Pose2(0.0, 0.0, math.pi), RADIUS, ARENA, margin=0.2)
    assert path.length == pytest.approx(2.05)


def test_facing_a_wall_it_turns_on_the_spot_no_more_than_it_must() -> None:
    start, goal = Pose2(0.0, 1.4, 1.2), Pose2(0.0, -0.5, -math.pi / 2)
    with pytest.raises(PlanningError):
        plan_inside(start, goal, RADIUS, ARENA)
    path = plan_after_turn(start, goal, RADIUS, ARENA)
    require_path_inside(path, ARENA)
    assert_same(path.end, goal, 1e-9)
    turned = wrap_to_pi(path.start.theta - start.theta)
    assert path.start[:2] == start[:2]
    for less in np.arange(-abs(turned), abs(turned), math.pi / 12)[1:].tolist():
        with pytest.raises(PlanningError):
            plan_inside(Pose2(0.0, 1.4, wrap_to_pi(1.2 + less)), goal, RADIUS, ARENA)
    free = Pose2(0.0, 0.0, 1.2)
    turned = plan_after_turn(free, goal, RADIUS, ARENA).start.theta - free.theta
    assert abs(turned) == pytest.approx(math.pi / 12), "that without a turn is plan_inside's"


def test_no_turn_helps_a_goal_that_only_a_path_through_the_wall_reaches() -> None:
    with pytest.raises(PlanningError, match=r"from \(0\.000, 0\.000\)"):
        plan_after_turn(Pose2(0.0, 0.0, 0.0), Pose2(0.0, 1.45, -math.pi / 2), RADIUS, ARENA)
    with pytest.raises(PlanningError, match="outside the arena"):
        plan_after_turn(Pose2(0.0, 0.0, 0.0), Pose2(0.0, 2.0, 0.0), RADIUS, ARENA)


@given(pose=POSES, x=COORDINATE, y=COORDINATE)
def test_a_goal_without_heading_is_reached_on_a_straight(pose: Pose2, x: float, y: float) -> None:
    heading = goal_heading(pose, x, y)
    distance = math.hypot(x - pose.x, y - pose.y)
    if distance > 1e-3:
        reached = (pose.x + distance * math.cos(heading), pose.y + distance * math.sin(heading))
        assert reached == pytest.approx((x, y), abs=1e-9)
    assert goal_pose(pose, x, y, None) == Pose2(x, y, heading)
    assert goal_pose(pose, x, y, 0.25) == Pose2(x, y, 0.25)


def test_at_the_goal_the_heading_is_kept() -> None:
    assert goal_heading(Pose2(1.0, 2.0, 0.7), 1.0, 2.0) == 0.7
