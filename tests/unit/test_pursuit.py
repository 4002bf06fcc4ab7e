"""The ring: order, gaps, speeds, one step at a time."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from muro_zenoh.control.importance import Importance
from muro_zenoh.control.pursuit import (
    PURSUIT_LAWS,
    PursuitLaw,
    pursue,
    pursuit_law,
    pursuit_speed,
)
from muro_zenoh.control.ring import RingRobot, angles_round, gaps, gaps_ahead, order_ring, spacing_error, unroll
from muro_zenoh.control.ring_arrays import array_gaps
from muro_zenoh.geometry import Circle

TWO_PI = 2.0 * math.pi
ANGLE = st.floats(-10.0, 10.0)
RINGS = st.dictionaries(st.text("abcdefgh", min_size=1, max_size=3), ANGLE, min_size=1, max_size=12)
WEIGHTED = Importance.from_function(lambda a: 2.0 + math.sin(a))


def law_named(name: str, **changes: float) -> PursuitLaw:
    return pursuit_law(name, **({"importance": WEIGHTED} if name == "importance" else {}), **changes)


def on_ring(angles: dict[str, float], circle: Circle, v: float = 0.2) -> dict[str, RingRobot]:
    return {
        name: RingRobot(
            circle.x + circle.radius * math.cos(a),
            circle.y + circle.radius * math.sin(a),
            a + circle.sigma * math.pi / 2,
            v,
            0.0,
        )
        for name, a in angles.items()
    }


@given(before=RINGS, now=RINGS, clockwise=st.booleans())
def test_gaps_are_within_a_turn_and_sum_to_one_after_any_change_of_order(
    before: dict[str, float], now: dict[str, float], clockwise: bool
) -> None:
    order = order_ring(unroll(now, clockwise), order_ring(unroll(before, clockwise), ()))
    assert sorted(order) == sorted(now)
    to_next = gaps(unroll(now, clockwise), order)
    assert set(to_next) == set(now)
    assert all(0.0 <= gap <= TWO_PI for gap in to_next.values())
    assert sum(to_next.values()) == pytest.approx(TWO_PI)


@given(
    micro=st.sets(st.integers(0, 6_283_184), min_size=1, max_size=12), turns=st.integers(-2, 2), clockwise=st.booleans()
)
def test_each_gap_is_the_angle_to_the_nearest_robot_ahead(micro: set[int], turns: int, clockwise: bool) -> None:
    sigma = -1.0 if clockwise else 1.0
    angles = {f"r{k}": m * 1e-6 + TWO_PI * turns for k, m in enumerate(micro)}
    for name, gap in gaps_ahead(angles, clockwise).items():
        ways = [(sigma * (other - angles[name])) % TWO_PI for who, other in angles.items() if who != name]
        assert gap == pytest.approx(min(ways, default=TWO_PI), abs=1e-9)


@given(angles=RINGS, turn=ANGLE)
def test_the_ring_does_not_depend_on_where_angle_zero_is(angles: dict[str, float], turn: float) -> None:
    here = gaps_ahead(angles, False)
    moved = {name: a + turn for name, a in angles.items()}
    there = gaps_ahead(moved, False)
    assert sorted(there.values()) == pytest.approx(sorted(here.values()), abs=1e-6)


def test_equal_angles_are_ordered_by_name() -> None:
    angles = {"c": 1.0, "a": 1.0, "b": 1.0}
    assert order_ring(unroll(angles, False), ()) == ("a", "b", "c")
    assert gaps(unroll(angles, False), ("a", "b", "c")) == pytest.approx({"a": 0.0, "b": 0.0, "c": TWO_PI})


def test_noise_on_two_robots_side_by_side_does_not_flip_the_gap() -> None:
    order = order_ring(unroll({"a": 0.0, "b": 0.01}, False), ())
    rng = np.random.default_rng(1)
    for _ in range(500):
        angles = {"a": rng.uniform(-0.012, 0.012), "b": rng.uniform(-0.012, 0.012)}
        order = order_ring(unroll(angles, False), order)
        assert gaps(unroll(angles, False), order)["a"] < 0.03
        assert gaps(unroll(angles, False), order)["b"] > TWO_PI - 0.03


@pytest.mark.parametrize("clockwise", [False, True])
def test_an_overtaker_swaps_only_beyond_the_hysteresis(clockwise: bool) -> None:
    sigma = -1.0 if clockwise else 1.0
    order: tuple[str, ...] = ()
    seen = []
    for ahead in (-0.2, -0.04, 0.0, 0.04, 0.049, 0.051, 0.2, 0.04, -0.04, -0.051):
        angles = {"fast": sigma * (1.0 + ahead), "slow": sigma * 1.0, "far": sigma * 4.0}
        order = order_ring(unroll(angles, clockwise), order)
        seen.append(order.index("fast") < order.index("slow"))
    assert seen == [True] * 5 + [False] * 4 + [True]


def test_close_pairs_keep_their_order_while_the_ring_turns_through_every_cut() -> None:
    order: tuple[str, ...] = ("a", "b", "c", "d", "e")
    for step in range(400):
        turn = 0.05 * step
        # b is a little behind a against the order, and the widest gap wanders as c swings.
        angles = {"a": turn + 0.03, "b": turn, "c": turn + 2.0 + math.sin(0.3 * step), "d": turn + 4.0, "e": turn + 4.6}
        order = order_ring(unroll(angles, False), order)
        ring = order[order.index("a") :] + order[: order.index("a")]
        assert ring == ("a", "b", "c", "d", "e")


def test_robots_join_and_leave_the_ring() -> None:
    order = order_ring(unroll({"a": 0.0, "b": 1.0, "c": 2.0}, False), ())
    order = order_ring(unroll({"a": 0.0, "c": 2.0}, False), order)
    assert order == ("a", "c")
    order = order_ring(unroll({"a": 0.0, "c": 2.0, "d": 1.5}, False), order)
    assert order == ("a", "d", "c")
    assert gaps(unroll({"a": 0.0, "c": 2.0, "d": 1.5}, False), order)["a"] == pytest.approx(1.5)


@pytest.mark.parametrize("name", sorted(PURSUIT_LAWS))
@pytest.mark.parametrize("clockwise", [False, True])
def test_alone_the_gap_is_a_whole_turn_and_the_speed_within_limits(name: str, clockwise: bool) -> None:
    circle = Circle(1.0, 1.0, 0.8, clockwise)
    law = law_named(name)
    step = pursue("a", on_ring({"a": 2.0}, circle), circle, (), law)
    assert (step.gap, step.gap_behind, step.count, step.order, step.eligible) == (TWO_PI, TWO_PI, 1, ("a",), True)
    assert law.v_min <= step.speed <= law.v_max
    if name in ("two_gap", "normalised"):
        assert step.speed == pytest.approx(law.cruise)


def test_the_successor_is_ahead_in_the_direction_of_travel() -> None:
    angles = {"a": 0.0, "b": 0.5, "c": 3.0}
    left = pursue("a", on_ring(angles, Circle(0.0, 0.0, 1.0)), Circle(0.0, 0.0, 1.0), (), pursuit_law())
    assert (left.gap, left.gap_behind) == pytest.approx((0.5, TWO_PI - 3.0))
    mirror = Circle(0.0, 0.0, 1.0, clockwise=True)
    right = pursue("a", on_ring(angles, mirror), mirror, (), pursuit_law())
    assert (right.gap, right.gap_behind) == pytest.approx((TWO_PI - 3.0, 0.5))


def test_old_positions_are_advanced_by_the_tangential_speed() -> None:
    circle = Circle(0.0, 0.0, 1.0)
    ring = {"a": RingRobot(1.0, 0.0, math.pi / 2, 0.2, 0.0), "b": RingRobot(0.0, 1.0, math.pi, 0.3, 0.5)}
    assert pursue("a", ring, circle, (), pursuit_law()).gap == pytest.approx(math.pi / 2 + 0.15)
    # Straight outwards there is nothing to move on.
    ring["b"] = RingRobot(0.0, 1.0, math.pi / 2, 0.3, 0.5)
    assert pursue("a", ring, circle, (), pursuit_law()).gap == pytest.approx(math.pi / 2)


def test_robots_off_the_ring_do_not_count_and_drive_at_cruise() -> None:
    circle = Circle(0.0, 0.0, 1.0)
    ring = on_ring({"a": 0.0, "b": 1.0}, circle)
    ring["c"] = RingRobot(1.6, 0.1, 0.0, 0.2, 0.0)
    ring["d"] = RingRobot(0.0, 0.0, 0.0, 0.2, 0.0)
    assert pursue("a", ring, circle, (), pursuit_law()).count == 2
    for name in ("c", "d", "unseen"):
        step = pursue(name, ring, circle, ("b", "a"), pursuit_law(cruise=0.15))
        assert (step.speed, step.eligible, step.gap, step.gap_behind) == (0.15, False, TWO_PI, TWO_PI)
        assert set(step.order) == {"a", "b"}


@given(
    name=st.sampled_from(sorted(PURSUIT_LAWS)),
    gap=st.floats(0.0, TWO_PI),
    behind=st.floats(0.0, TWO_PI),
    angle=ANGLE,
    clockwise=st.booleans(),
)
def test_speeds_stay_within_their_limits(name: str, gap: float, behind: float, angle: float, clockwise: bool) -> None:
    law = law_named(name)
    assert law.v_min <= pursuit_speed(law, gap, behind, 5, angle, 0.8, clockwise) <= law.v_max


@pytest.mark.parametrize(
    ("name", "speed"),
    [("two_gap", 0.2), ("normalised", 0.2), ("proportional", 0.3 * 0.8 * TWO_PI / 5)],
)
def test_the_steady_speed_of_five(name: str, speed: float) -> None:
    assert pursuit_speed(law_named(name), TWO_PI / 5, TWO_PI / 5, 5, 1.0, 0.8, False) == pytest.approx(speed)


@pytest.mark.parametrize("name", sorted(PURSUIT_LAWS))
@pytest.mark.parametrize("clockwise", [False, True])
def test_whole_arrays_of_rings_get_the_speeds_that_agents_compute(name: str, clockwise: bool) -> None:
    rng = np.random.default_rng(3)
    angles = rng.uniform(-7.0, 7.0, (20, 6))
    eligible = rng.random((20, 6)) < 0.7
    eligible[:, 0] = True
    law = law_named(name)
    gap, behind, count = array_gaps(angles, clockwise, eligible)
    speeds = pursuit_speed(law, gap, behind, count, angles, 0.8, clockwise)
    circle = Circle(0.0, 0.0, 0.8, clockwise)
    for row in range(20):
        ring = on_ring({f"r{k}": float(angles[row, k]) for k in range(6) if eligible[row, k]}, circle)
        for k in range(6):
            if not eligible[row, k]:
                assert gap[row, k] == behind[row, k] == TWO_PI
                continue
            step = pursue(f"r{k}", ring, circle, (), law)
            assert (gap[row, k], behind[row, k]) == pytest.approx((step.gap, step.gap_behind))
            assert count[row, 0] == step.count
            assert speeds[row, k] == pytest.approx(step.speed)
    np.testing.assert_allclose(np.where(eligible, gap, 0.0).sum(axis=1), TWO_PI)


def test_importance_has_mean_1_and_a_mass_that_is_its_integral() -> None:
    table = Importance.from_table([0.5, 2.0, -1.0], [1.0, 6.0, 3.0])
    angles = np.linspace(-8.0, 8.0, 300001)
    density = table.density(angles)
    mass = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(angles))])
    np.testing.assert_allclose(table.mass(angles) - table.mass(-8.0), mass, atol=1e-7)
    assert table.mass(1.0 + TWO_PI) - table.mass(1.0) == pytest.approx(TWO_PI)
    assert table.density(0.5) / table.density(-1.0) == pytest.approx(1.0 / 3.0, rel=0.02)
    for angle in (-3.0, 0.0, 1.234, 9.0):
        assert table.density(angle) == pytest.approx(table.density(np.array([angle]))[0])
        assert table.mass(angle) == pytest.approx(table.mass(np.array([angle]))[0])


def test_a_flat_importance_is_two_gap() -> None:
    flat = pursuit_law("importance", importance=Importance.from_table([1.0], [7.0]))
    for gap, behind in ((0.3, 1.0), (1.2, 1.1), (TWO_PI, TWO_PI)):
        assert pursuit_speed(flat, gap, behind, 4, 2.0, 0.8, True) == pytest.approx(
            pursuit_speed(pursuit_law(), gap, behind, 4, 2.0, 0.8, True)
        )


def test_a_contrast_beyond_the_speeds_is_refused_with_both_numbers() -> None:
    steep = Importance.from_function(lambda a: 1.0 if a < math.pi else 5.0)
    with pytest.raises(ValueError, match=r"contrast of 5\.00.*v_max / v_min = 4\.00"):
        pursuit_law("importance", v_min=0.1, v_max=0.4, importance=steep)
    pursuit_law("importance", v_min=0.08, v_max=0.4, importance=steep)


@pytest.mark.parametrize(
    ("angles", "weights", "what"),
    [
        ([], [], "0 for 0 angles"),
        ([0.0, 1.0], [1.0], "1 for 2 angles"),
        ([0.0, TWO_PI], [1.0, 2.0], "twice"),
        ([0.0], [0.0], "above 0"),
        ([0.0], [math.nan], "above 0"),
        ([math.inf], [1.0], "inf"),
    ],
)
def test_an_invalid_importance_table_is_refused_with_the_reason(
    angles: list[float], weights: list[float], what: str
) -> None:
    with pytest.raises(ValueError, match=what):
        Importance.from_table(angles, weights)


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"name": "fastest"}, "two_gap, normalised, proportional, importance"),
        ({"gain": -1.0}, "gain"),
        ({"cruise": 0.5}, "v_min <= cruise <= v_max"),
        ({"v_max": math.inf}, "v_max: got inf"),
    ],
)
def test_an_invalid_law_is_refused(changes: dict[str, object], what: str) -> None:
    with pytest.raises(ValueError, match=what):
        pursuit_law(**changes)  # type: ignore[arg-type]


@given(angles=RINGS)
def test_the_spacing_error_is_that_of_the_gaps_of_arrays(angles: dict[str, float]) -> None:
    gap, _, _ = array_gaps(np.array(list(angles.values())), False)
    worst = abs(gap - TWO_PI / len(angles)).max()
    assert spacing_error(angles) == pytest.approx(worst, abs=1e-9)
    assert spacing_error({name: -angle for name, angle in angles.items()}) == pytest.approx(worst, abs=1e-6)


def test_fewer_than_two_robots_have_no_spacing_error() -> None:
    assert spacing_error({}) == 0.0
    assert spacing_error({"a": 1.0}) == 0.0


def test_angles_are_seen_from_the_centre() -> None:
    seen = angles_round({"a": (2.0, 1.0), "b": (1.0, 0.5)}, Circle(1.0, 1.0, 0.8))
    assert seen == pytest.approx({"a": 0.0, "b": -math.pi / 2})
