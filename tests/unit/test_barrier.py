"""The classical barrier: its condition against the formula, its programme against daqp."""

from __future__ import annotations

import math

import daqp
import numpy as np
import pytest

from muro_zenoh.errors import ParameterError
from muro_zenoh.geometry import Bounds, State, Twist2
from muro_zenoh.safety.barrier import Barrier
from muro_zenoh.safety.separation import Body
from muro_zenoh.safety.separation.projection import Row, nearest_velocity

ARENA = Bounds(-2.1, 2.1, -1.5, 1.5)
BODY = Body()
LAW = Barrier(ahead=0.1, gain=500.0)


def still(x: float, y: float, theta: float) -> State:
    return State(x, y, theta, 0.0, 0.0)


def h_of(first: State, second: State) -> float:
    a, b = LAW.point(first), LAW.point(second)
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 - (2 * BODY.radius + 2 * LAW.ahead) ** 2


def moved(state: State, twist: Twist2, dt: float) -> State:
    return State(
        state.x + dt * twist.v * math.cos(state.theta),
        state.y + dt * twist.v * math.sin(state.theta),
        state.theta + dt * twist.omega,
        0.0,
        0.0,
    )


def test_two_robots_on_their_limits_satisfy_the_common_condition_with_equality() -> None:
    """Both take their half: together -dh/dt is gain h^3, by finite differences on the points themselves."""
    rng = np.random.default_rng(1)
    for _ in range(50):
        first, second = still(0.0, 0.0, rng.uniform(-3, 3)), still(*rng.uniform(0.5, 0.8, 2), rng.uniform(-3, 3))
        twists = []
        for me, other in ((first, second), (second, first)):
            row = LAW.rows(me, BODY, [(other, BODY.radius)], ARENA)[0]
            twists.append(LAW.twist_for(me, row.nx * row.bound, row.ny * row.bound))
        dt = 1e-6
        after = h_of(moved(first, twists[0], dt), moved(second, twists[1], dt))
        before = h_of(first, second)
        assert (after - before) / dt == pytest.approx(-LAW.gain * before**3, rel=1e-3, abs=1e-4)


def test_far_from_everything_the_desired_twist_passes() -> None:
    wanted = Twist2(0.3, 0.2)
    assert LAW.twist(still(0.0, 0.0, 1.0), wanted, BODY, [(still(1.9, 0.0, 0.0), 0.177)], ARENA) == pytest.approx(
        wanted
    )


def test_it_stops_for_a_robot_in_its_way_and_for_a_wall() -> None:
    at_robot = LAW.twist(still(0.0, 0.0, 0.0), Twist2(0.4, 0.0), BODY, [(still(0.56, 0.0, math.pi), 0.177)], ARENA)
    assert at_robot.v < 0.01
    at_wall = LAW.twist(still(2.1 - 0.177 - 0.1, 0.0, 0.0), Twist2(0.4, 0.0), BODY, [], ARENA)
    assert abs(at_wall.v) < 1e-9


def test_robots_that_are_too_close_part() -> None:
    twist = LAW.twist(still(0.0, 0.0, 0.0), Twist2(0.4, 0.0), BODY, [(still(0.4, 0.0, math.pi), 0.177)], ARENA)
    assert twist.v < 0.0


def test_a_gain_must_be_positive() -> None:
    with pytest.raises(ParameterError, match="gain"):
        Barrier(gain=0.0)


def test_the_exact_programme_agrees_with_daqp() -> None:
    rng = np.random.default_rng(2)
    infeasible = 0
    for _ in range(3000):
        count = int(rng.integers(1, 12))
        angles = rng.uniform(-math.pi, math.pi, count)
        rows = [
            Row(math.cos(a), math.sin(a), bound)
            for a, bound in zip(angles.tolist(), rng.normal(0.3, 0.4, count).tolist(), strict=True)
        ]
        wanted = rng.normal(0.0, 0.6, 2)
        ours = nearest_velocity(rows, *wanted.tolist(), v_max=50.0)
        table = np.array(rows)
        theirs, _, flag, _ = daqp.solve(
            np.eye(2), -wanted, np.ascontiguousarray(table[:, :2]), np.ascontiguousarray(table[:, 2])
        )
        violation = max(row.nx * ours[0] + row.ny * ours[1] - row.bound for row in rows)
        if flag == 1:
            assert ours == pytest.approx(tuple(theirs), abs=1e-5)
            assert violation < 1e-6
        else:
            infeasible += 1
            assert violation > 0.0
    assert 100 < infeasible < 2500  # both answers occur
