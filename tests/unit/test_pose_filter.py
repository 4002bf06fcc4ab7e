"""The agent's filter in a room of one robot: late fixes, out of order, wrong, or after a hand has carried it off."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from muro_zenoh.estimation.filter_settings import FilterSettings
from muro_zenoh.estimation.pose_filter import FixResult, PoseFilter
from muro_zenoh.estimation.wheel_model import WheelLimits
from muro_zenoh.simulation.plant import Plant

R = (4e-6, 0.0, 0.0, 0.0, 4e-6, 0.0, 0.0, 0.0, 7.6e-5)
Command = Callable[[float], tuple[float, float]]


def circling(t: float) -> tuple[float, float]:
    return 0.2, 0.3


def standing(t: float) -> tuple[float, float]:
    return 0.0, 0.0


class Room:
    """One robot at 100 Hz, odometry at 50 Hz, fixes at 20 Hz that arrive after ``delay`` (by fix number)."""

    def __init__(
        self,
        seed: int,
        *,
        odometry: bool = True,
        delay: Callable[[int], float] = lambda k: 0.08,
        settings: FilterSettings | None = None,
        drive_error: float = 0.2,
    ) -> None:
        self.rng = np.random.default_rng(seed)
        self.plant = Plant(np.array([[1.0, 1.0, 0.5]]), self.rng, drive_error=drive_error)
        self.filter = PoseFilter(settings or FilterSettings())
        self.odometry, self.delay = odometry, delay
        self.unseen = False
        self.outlier: Callable[[int], bool] = lambda k: False
        self.underway: list[tuple[float, float, np.ndarray]] = []
        self.results: list[tuple[float, FixResult]] = []
        self.tick = 0

    @property
    def now(self) -> float:
        return self.tick * 0.01

    def run(self, seconds: float, command: Command) -> None:
        for _ in range(round(seconds / 0.01)):
            t = self.now
            v, omega = command(t)
            if self.tick % 5 == 0:
                self.filter.command(t, v, omega)
                if not self.unseen:
                    self.capture(self.tick // 5)
            if self.odometry and self.tick % 2 == 0:
                self.filter.twist(t, *self.plant.odometry_twist[0])
            for arrival, captured, z in sorted(self.underway, key=lambda row: row[0]):
                if arrival <= t + 1e-9:
                    self.results.append((t, self.filter.fix(captured, *z, R)))
            self.underway = [row for row in self.underway if row[0] > t + 1e-9]
            self.plant.step(np.array([[v, omega]]), 0.01)
            self.tick += 1

    def capture(self, k: int) -> None:
        z = self.plant.pose[0] + self.rng.normal(size=3) * np.sqrt([R[0], R[4], R[8]])
        if self.outlier(k):
            z = z + np.array([0.3, -0.2, 0.5]) * self.rng.choice([-1.0, 1.0], 3)
        self.underway.append((self.now + self.delay(k), self.now, z))

    def errors(self) -> tuple[float, float]:
        estimate = self.filter.at(self.now)
        assert estimate is not None
        x, y, theta = self.plant.pose[0]
        return math.hypot(estimate.x - x, estimate.y - y), abs(math.remainder(estimate.theta - theta, math.tau))


@pytest.mark.parametrize("odometry", [True, False])
@pytest.mark.parametrize("seed", range(5))
def test_finds_pose_and_drive_scales(seed: int, odometry: bool) -> None:
    room = Room(seed, odometry=odometry)
    room.run(3.0, circling)
    estimate = room.filter.at(room.now)
    assert estimate is not None
    assert estimate.s_v == pytest.approx(room.plant.s_v[0], rel=0.05)
    room.run(2.0, circling)
    estimate = room.filter.at(room.now)
    assert estimate is not None
    assert estimate.s_omega == pytest.approx(room.plant.s_omega[0], rel=0.08)
    assert abs(estimate.s_v - room.plant.s_v[0]) < 4.0 * estimate.sigma_v
    assert abs(estimate.s_omega - room.plant.s_omega[0]) < 4.0 * estimate.sigma_omega
    place, heading = room.errors()
    assert place < 0.006
    assert heading < 0.03
    assert estimate.v == pytest.approx(room.plant.twist[0, 0], rel=0.05)


def test_delay_costs_next_to_nothing() -> None:
    """80 ms at 0.2 m/s are 16 mm: a filter that took late fixes for fresh ones would be that wrong."""
    late, prompt = Room(1), Room(1, delay=lambda k: 0.0)
    for room in (late, prompt):
        room.run(4.0, circling)
    assert late.errors()[0] < 0.005
    assert prompt.errors()[0] < 0.005


def test_order_of_arrival_does_not_matter() -> None:
    """Every other fix is 70 ms later than the one captured after it."""
    swapped = Room(2, delay=lambda k: 0.15 if k % 2 else 0.08)
    ordered = Room(2, delay=lambda k: 0.15)
    for room in (swapped, ordered):
        room.run(2.0, circling)
        assert all(result.accepted for _, result in room.results)
    # the swapped room has heard the fixes of the last 150 ms that the ordered one has not: compare at an older time
    a, b = swapped.filter.at(1.801), ordered.filter.at(1.801)
    assert a is not None
    assert b is not None
    assert (a.x, a.y, a.theta) == pytest.approx((b.x, b.y, b.theta), abs=1e-9)
    assert a.covariance9 == pytest.approx(b.covariance9, rel=1e-6)


def test_a_fix_older_than_all_that_is_kept_is_refused() -> None:
    room = Room(3)
    room.run(3.0, circling)
    assert room.filter.fix(0.5, 1.0, 1.0, 0.0, R).reason == "too old"


def test_a_covariance_that_is_none_is_refused() -> None:
    room = PoseFilter(FilterSettings())
    singular = (1e-6, 1e-6, 0.0, 1e-6, 1e-6, 0.0, 0.0, 0.0, 1e-4)
    assert room.fix(0.0, 1.0, 1.0, 0.0, singular).reason == "bad covariance"
    assert room.at(0.0) is None


@pytest.mark.parametrize(
    "covariance",
    [
        (1e-300, 0.0, 0.0, 0.0, 1e-300, 0.0, 0.0, 0.0, 1e-4),
        (1e-13, 0.0, 0.0, 0.0, 1e-6, 0.0, 0.0, 0.0, 1e-4),
        (1e-6, 0.0, 0.0, 0.0, 1e7, 0.0, 0.0, 0.0, 1e-4),
        (1e-6, 0.0, 0.0, 0.0, 1e-6, 0.0, 0.0, 0.0, 1e12),
        (1e2, 1e2 - 1e-9, 0.0, 1e2 - 1e-9, 1e2, 0.0, 0.0, 0.0, 1e-4),  # definite, by rounding only
        (1e-6, 0.0, 0.0, 0.0, 1e-6, 1e-5 - 1e-13, 0.0, 1e-5 - 1e-13, 1e-4),
    ],
)
def test_a_covariance_that_cannot_be_calculated_with_is_refused(covariance: tuple[float, ...]) -> None:
    # Its sum with the filter's own may be singular in floats, and the division by its determinant ends the agent.
    room = PoseFilter(FilterSettings())
    assert room.fix(0.0, 1.0, 1.0, 0.0, covariance).reason == "bad covariance"


def test_outliers_are_gated() -> None:
    room = Room(4)
    room.run(1.0, circling)
    room.outlier = lambda k: k % 4 == 0
    room.run(4.0, circling)
    gated = [result for _, result in room.results if not result.accepted]
    assert 18 <= len(gated) <= 22
    assert all(result.reason == "gated" and result.nis > 100.0 for result in gated)
    assert room.errors()[0] < 0.006
    estimate = room.filter.at(room.now)
    assert estimate is not None
    assert estimate.s_v == pytest.approx(room.plant.s_v[0], rel=0.05)


@pytest.mark.parametrize("command", [circling, standing])
def test_a_kidnapped_robot_is_found_within_two_seconds(command: Command) -> None:
    room = Room(5)
    room.run(3.0, command)
    before = room.filter.at(room.now)
    room.plant.place(0, 2.5, 0.4, -2.0)
    carried = room.now
    room.run(2.0, command)
    restarts = [t for t, result in room.results if result.restarted]
    assert len(restarts) == 1
    assert restarts[0] - carried < 0.5
    place, heading = room.errors()
    assert place < 0.008
    assert heading < 0.03
    after = room.filter.at(room.now)
    assert before is not None
    assert after is not None
    assert after.s_v == pytest.approx(before.s_v, abs=0.05)


def test_a_kidnapped_robot_is_found_by_two_cameras_out_of_step() -> None:
    room = Room(13, delay=lambda k: 0.15 if k % 2 else 0.08)
    room.run(3.0, circling)
    room.plant.place(0, 2.5, 0.4, -2.0)
    room.run(1.0, circling)
    assert sum(result.restarted for _, result in room.results) == 1
    assert room.errors()[0] < 0.008


def test_a_fix_from_the_future_is_refused() -> None:
    """Taken in, it would make every true fix too old."""
    room = Room(14)
    room.run(1.0, circling)
    assert room.filter.fix(1e9, 1.0, 1.0, 0.0, R).reason == "from the future"
    room.run(1.0, circling)
    assert room.errors()[0] < 0.008


def test_fixes_after_a_long_silence_are_believed_in_a_row() -> None:
    room = Room(15)
    room.run(1.0, circling)
    reasons = [room.filter.fix(60.0 + 0.05 * k, 3.0, 1.0, 0.3, R).reason for k in range(6)]
    assert reasons == ["from the future"] * 4 + ["restarted", "used"]


def test_fixes_that_disagree_with_each_other_never_restart() -> None:
    room = Room(6)
    room.run(1.0, circling)
    rng = np.random.default_rng(0)
    for k in range(40):
        x, y = rng.uniform(2.0, 4.0, 2)
        assert room.filter.fix(1.0 + 0.05 * k, x, y, rng.uniform(-3.0, 3.0), R).accepted is False


def test_scales_are_frozen_at_rest() -> None:
    room = Room(7)
    room.run(3.0, circling)
    room.run(1.5, standing)  # the wheels run down
    before = room.filter.at(room.now)
    room.run(10.0, standing)
    after = room.filter.at(room.now)
    assert before is not None
    assert after is not None
    assert (after.s_v, after.s_omega) == (before.s_v, before.s_omega)
    assert (after.sigma_v, after.sigma_omega) == (before.sigma_v, before.sigma_omega)
    assert after.v == pytest.approx(0.0, abs=1e-3)


def test_scales_that_change_are_followed() -> None:
    """Wheels that wear, a floor that changes: a filter that is ever surer of its scales would keep the old ones."""
    room = Room(21, drive_error=0.1)
    room.run(40.0, circling)
    room.plant.s_v[0] *= 0.95
    room.plant.s_omega[0] *= 1.05
    room.run(30.0, circling)
    estimate = room.filter.at(room.now)
    assert estimate is not None
    assert estimate.s_v == pytest.approx(room.plant.s_v[0], abs=0.015)
    assert estimate.s_omega == pytest.approx(room.plant.s_omega[0], abs=0.015)


def test_straight_on_leaves_the_turning_scale_alone() -> None:
    room = Room(8)
    room.run(3.0, lambda t: (0.2, 0.0))
    estimate = room.filter.at(room.now)
    assert estimate is not None
    assert estimate.s_omega == 1.0
    assert estimate.sigma_omega == pytest.approx(0.15)
    assert estimate.s_v == pytest.approx(room.plant.s_v[0], rel=0.05)


def test_looks_ahead_through_the_wheels() -> None:
    room = Room(9, drive_error=0.0)
    room.run(3.0, circling)
    room.filter.command(room.now, 0.0, 0.0)
    room.filter.twist(room.now, *room.plant.odometry_twist[0])
    ahead = room.filter.at(room.now + 0.2)
    for _ in range(20):
        room.plant.step(np.zeros((1, 2)), 0.01)
    assert ahead is not None
    assert ahead.v == pytest.approx(room.plant.twist[0, 0], abs=0.005)
    assert math.hypot(ahead.x - room.plant.pose[0, 0], ahead.y - room.plant.pose[0, 1]) < 0.004


def test_a_silent_odometry_is_carried_on_by_the_commands() -> None:
    room = Room(10)
    room.run(2.0, circling)
    room.odometry = False
    room.run(3.0, lambda t: (0.1 + 0.1 * math.sin(3.0 * t), 0.3))
    assert room.errors()[0] < 0.008
    room.odometry = True
    room.run(1.0, circling)
    assert room.errors()[0] < 0.006


def test_commands_that_cease_mean_the_dead_man() -> None:
    room = Room(11, odometry=False)
    room.run(2.0, circling)
    t = room.now
    late = room.filter.at(t + 1.5)
    assert late is not None
    assert late.v == pytest.approx(0.0, abs=1e-3)


def test_a_robot_unseen_for_long_is_dead_reckoned() -> None:
    room = Room(16)
    room.run(6.0, circling)
    room.unseen = True
    for _ in range(400):  # an agent asks all the while
        room.run(0.02, circling)
        room.filter.at(room.now)
    place, heading = room.errors()
    estimate = room.filter.at(room.now)
    assert estimate is not None
    assert estimate.t_fix == pytest.approx(6.0, abs=0.1)
    assert place < 0.15  # 1.6 m and more than a third of a circle, with drive errors of up to 20 %
    assert heading < 0.15
    sigma = math.sqrt(estimate.covariance9[0] + estimate.covariance9[4])
    assert 0.01 < sigma < 0.2
    assert place < 4.0 * sigma
    assert len(room.filter._track._knots) < 130
    room.unseen = False
    room.run(1.0, circling)
    assert not any(result.restarted for _, result in room.results)
    assert room.errors()[0] < 0.008


def test_memory_is_bounded() -> None:
    room = Room(12)
    room.run(20.0, circling)
    sizes = [len(room.filter._anchors), len(room.filter._track._knots), len(room.filter._track._commands)]
    room.run(20.0, circling)
    assert max(sizes) < 200
    for k in range(4000):  # a burst that never ends at one time
        room.filter.twist(room.now + 1e-6 * k, 0.2, 0.3)
        room.filter.command(room.now, 0.2, 0.3)
    assert len(room.filter._track._knots) <= 512
    assert len(room.filter._track._commands) <= 65


times = st.floats(0.0, 3.0)
speeds = st.floats(-2.0, 2.0)
calls = st.one_of(
    st.tuples(st.just("twist"), times, speeds, speeds),
    st.tuples(st.just("command"), times, speeds, speeds),
    st.tuples(st.just("fix"), times, st.floats(-0.2, 0.2), st.floats(-7.0, 7.0)),
    st.tuples(st.just("at"), times, st.just(0.0), st.just(0.0)),
)


@given(data=st.lists(calls, max_size=40))
def test_bears_any_order_of_calls(data: list[tuple[str, float, float, float]]) -> None:
    """Whatever comes, whenever: no exception, finite numbers, and a covariance that is one."""
    robot = PoseFilter(FilterSettings(restart_fixes=2))
    for what, t, a, b in data:
        if what == "fix":
            robot.fix(t, a, -a, b, R)
        elif what == "at":
            estimate = robot.at(t)
            if estimate is not None:
                flat = [*estimate[:5], *estimate.covariance9, *estimate[6:]]
                assert np.isfinite(flat).all()
                assert np.linalg.eigvalsh(np.reshape(estimate.covariance9, (3, 3))).min() > 0.0
                assert -math.pi < estimate.theta <= math.pi
                assert 0.5 <= estimate.s_v <= 1.5
                assert 0.5 <= estimate.s_omega <= 1.5
                assert estimate.t_fix <= t
        else:
            getattr(robot, what)(t, a, b)


def test_invalid_settings_are_refused() -> None:
    with pytest.raises(ValueError, match=r"scale_max: got 0\.9, expected a number above 1"):
        FilterSettings(scale_max=0.9)
    with pytest.raises(ValueError, match="scale_gate"):
        FilterSettings(scale_gate=30.0)
    with pytest.raises(ValueError, match="restart_fixes: got 1, expected a whole number at least 2"):
        FilterSettings(restart_fixes=1)


def test_limits_are_the_robots_own() -> None:
    slow = PoseFilter(FilterSettings(), WheelLimits(a_max=0.1))
    slow.fix(0.0, 0.0, 0.0, 0.0, R)
    slow.command(0.0, 1.0, 0.0)
    ahead = slow.at(0.25)
    assert ahead is not None
    assert ahead.v == pytest.approx(0.025, abs=1e-6)
