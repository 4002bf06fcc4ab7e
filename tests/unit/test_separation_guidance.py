"""Guidance: rows and projection."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from muro_zenoh.geometry import State
from muro_zenoh.safety.separation.guidance import Near, approach_speed, rows_of, twist_for
from muro_zenoh.safety.separation.projection import Row, nearest_velocity

angle = st.floats(-math.pi, math.pi)


def test_the_row_of_a_neighbour_half_a_metre_away() -> None:
    (row,) = rows_of(0.0, 0.0, [Near(0.5, 0.0, 0.0, 0.0, 0.4, "r2")])
    # -0.5 * 0.2 + sqrt(0.01 + 0.5 * 0.1)
    assert row == pytest.approx((1.0, 0.0, -0.1 + math.sqrt(0.06)))


def test_behind_one_that_drives_off_a_robot_may_be_faster_by_its_speed() -> None:
    (row,) = rows_of(0.0, 0.0, [Near(0.5, 0.0, 0.2, 0.1, 0.4, "r2")])
    assert row.bound == pytest.approx(approach_speed(0.1) + 0.2)


def test_what_lacks_separates_slowly() -> None:
    assert approach_speed(0.0) == 0.0
    assert approach_speed(-0.03) == -0.03
    assert approach_speed(-1.0) == -0.1


@pytest.mark.parametrize(
    ("heading", "turns"), [(0.0, 0.0), (0.5 * math.pi, -1.0), (-0.5 * math.pi, 1.0), (math.pi, 0.0)]
)
def test_a_robot_never_drives_backwards_but_turns(heading: float, turns: float) -> None:
    twist = twist_for(State(0.0, 0.0, heading, 0.0, 0.0), 0.2, 0.0, 1.5)
    assert twist.v >= 0.0
    assert twist.omega * turns >= 0.0
    assert twist.v > 0.1 or abs(twist.omega) > 1.0


@given(st.lists(st.tuples(angle, st.floats(-0.1, 0.5)), max_size=8), angle, st.floats(0.0, 0.5))
def test_the_projection_is_the_nearest_that_is_allowed(
    given_rows: list[tuple[float, float]], direction: float, speed: float
) -> None:
    rows = [Row(math.cos(a), math.sin(a), bound) for a, bound in given_rows]
    vx, vy = speed * math.cos(direction), speed * math.sin(direction)
    x, y = nearest_velocity(rows, vx, vy, 0.5)
    assert math.hypot(x, y) <= 0.5 + 1e-6

    def violation(px: float, py: float) -> float:
        return max((row.nx * px + row.ny * py - row.bound for row in rows), default=-1.0)

    others = [
        (r * math.cos(t), r * math.sin(t)) for r in (0.0, 0.1, 0.25, 0.4, 0.5) for t in (0.5 * k for k in range(13))
    ]
    allowed = [point for point in others if violation(*point) <= 0.0]
    if allowed:
        assert violation(x, y) <= 1e-6
        assert math.dist((x, y), (vx, vy)) <= min(math.dist(point, (vx, vy)) for point in allowed) + 1e-6
    else:
        assert violation(x, y) <= min(violation(*point) for point in others) + 1e-6
