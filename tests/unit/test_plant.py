"""The plant against what unicycles do, and the starts against what they promise."""

from __future__ import annotations

import math

import numpy as np
import pytest

from agents.base.simulated import make_plant
from muro_zenoh.config import parse_scenario
from muro_zenoh.errors import PlanningError
from muro_zenoh.estimation.wheel_model import WheelLimits
from muro_zenoh.geometry import Bounds
from muro_zenoh.safety.separation import SeparationSettings
from muro_zenoh.simulation.plant import Plant
from muro_zenoh.simulation.starts import random_starts
from muro_zenoh.walls import Wall

ARENA = Bounds(0.0, 4.2, 0.0, 3.0)
IDEAL = WheelLimits(lag=0.0, a_max=1e9, alpha_max=1e9, brake=1e9)


def plant(starts: list[tuple[float, float, float]], **options: object) -> Plant:
    return Plant(np.array(starts), np.random.default_rng(0), **options)  # type: ignore[arg-type]


def drive(robots: Plant, v: float, omega: float, seconds: float, dt: float = 0.01) -> None:
    commands = np.tile([v, omega], (len(robots), 1))
    for _ in range(round(seconds / dt)):
        robots.step(commands, dt)


def test_drives_the_circle_that_was_commanded() -> None:
    robot = plant([(0.0, -0.5, 0.0)], limits=IDEAL, drive_error=0.0, slip=0.0)
    robot.step(np.array([[0.25, 0.5]]), 1e-6)  # the wheels are up to speed
    for _ in range(round(math.tau / 0.5 / 0.02)):
        robot.step(np.array([[0.25, 0.5]]), 0.02)
        assert math.hypot(*robot.pose[0, :2]) == pytest.approx(0.5, abs=1e-6)
    assert robot.twist[0] == pytest.approx((0.25, 0.5))


def test_encoders_see_neither_drive_errors_nor_slip() -> None:
    robots = plant([(0.0, 0.0, 0.0)] * 200, slip=0.01, count_contacts=False)
    drive(robots, 0.3, 0.0, 4.0)
    assert np.ptp(robots.odometry_pose[:, 0]) == 0.0
    assert np.ptp(robots.odometry_twist[:, 0]) == 0.0
    assert robots.s_v.min() < 0.82
    assert robots.s_v.max() > 1.18
    assert ((robots.s_v >= 0.8) & (robots.s_v <= 1.2) & (robots.s_omega >= 0.8) & (robots.s_omega <= 1.2)).all()
    np.testing.assert_allclose(robots.twist[:, 0], robots.s_v * robots.odometry_twist[0, 0])
    ratio = np.hypot(*robots.pose[:, :2].T) / robots.odometry_pose[:, 0]
    np.testing.assert_allclose(ratio, robots.s_v, atol=0.05)


def test_slip_grows_with_the_root_of_the_distance_whatever_the_step() -> None:
    for dt in (0.01, 0.04):
        robots = plant([(0.0, 0.0, 0.0)] * 2000, slip=0.01, drive_error=0.0, limits=IDEAL, count_contacts=False)
        drive(robots, 0.25, 0.0, 4.0, dt)
        assert np.std(robots.pose[:, 2]) == pytest.approx(0.01, rel=0.08)
        assert np.std(robots.pose[:, 0]) == pytest.approx(0.01, rel=0.08)


def test_the_step_hardly_matters() -> None:
    ends = []
    for dt in (0.002, 0.02):
        robot = plant([(1.0, 1.0, 0.3)], slip=0.0)
        drive(robot, 0.3, 0.8, 1.0, dt)
        drive(robot, 0.0, -0.5, 1.0, dt)
        ends.append(robot.pose[0].copy())
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-3)


def test_contacts_are_episodes_and_bodies_pass_through() -> None:
    robots = plant([(0.0, 0.0, 0.0), (1.0, 0.0, math.pi)], radius=0.15, drive_error=0.0, slip=0.0)
    assert (robots.contacts, robots.min_separation) == (0, 1.0)
    drive(robots, 0.4, 0.0, 3.0)
    assert robots.contacts == 1
    assert robots.min_separation < 0.01
    assert robots.pose[0, 0] > robots.pose[1, 0]
    drive(robots, -0.4, 0.0, 3.0)
    assert robots.contacts == 2


def test_each_robot_has_limits_and_a_radius_of_its_own() -> None:
    robots = plant(
        [(0.0, 0.0, 0.0), (0.35, 0.0, 0.0)], limits=[WheelLimits(a_max=0.1), WheelLimits()], radius=np.array([0.1, 0.3])
    )
    assert robots.contacts == 1  # 0.35 m apart, bodies of 0.4 m together
    robots.step(np.array([[1.0, 0.0], [1.0, 0.0]]), 0.1)
    assert robots.odometry_twist[:, 0] == pytest.approx((0.01, 0.05))
    with pytest.raises(ValueError, match="1 wheel limits for 2 robots"):
        plant([(0.0, 0.0, 0.0)] * 2, limits=[WheelLimits()])


def test_moving_a_robot_by_hand_does_not_change_its_encoders() -> None:
    robot = plant([(0.0, 0.0, 0.0)])
    drive(robot, 0.2, 0.0, 1.0)
    before = robot.odometry_pose.copy()
    robot.place(0, 2.0, 1.0, 4.0)
    assert robot.pose[0] == pytest.approx((2.0, 1.0, 4.0 - math.tau))
    np.testing.assert_array_equal(robot.odometry_pose, before)


def test_the_same_seed_gives_the_same_motion() -> None:
    ends = []
    for _ in range(2):
        rng = np.random.default_rng(5)
        robots = Plant(random_starts(rng, 6, ARENA, 0.177), rng)
        drive(robots, 0.2, 0.3, 2.0)
        ends.append(robots.pose.copy())
    np.testing.assert_array_equal(ends[0], ends[1])


def test_refuses_invalid_arguments() -> None:
    with pytest.raises(ValueError, match=r"shape \(3,\)"):
        Plant(np.zeros(3), np.random.default_rng(0))
    with pytest.raises(ValueError, match=r"drive_error 1\.5"):
        plant([(0.0, 0.0, 0.0)], drive_error=1.5)


@pytest.mark.parametrize("seed", range(20))
def test_starts_touch_neither_each_other_nor_the_walls(seed: int) -> None:
    radius = 0.177
    starts = random_starts(np.random.default_rng(seed), 20, ARENA, radius)
    x, y, theta = starts.T
    assert (x >= radius).all()
    assert (x <= 4.2 - radius).all()
    assert (y >= radius).all()
    assert (y <= 3.0 - radius).all()
    assert (abs(theta) <= math.pi).all()
    apart = np.hypot(x[:, None] - x, y[:, None] - y)[np.triu_indices(20, 1)]
    assert apart.min() >= 2 * radius + SeparationSettings().margin


@pytest.mark.parametrize("seed", range(10))
def test_starts_keep_clear_of_the_walls_inside_the_arena(seed: int) -> None:
    walls = (Wall(2.0, 0.0, 2.0, 1.0), Wall(2.0, 1.8, 2.0, 3.0), Wall(0.5, 1.5, 1.5, 1.5))
    starts = random_starts(np.random.default_rng(seed), 12, ARENA, 0.177, 0.05, walls)
    assert min(wall.distance(x, y) for wall in walls for x, y, _ in starts.tolist()) >= 0.177 + 0.05
    table = {"robots": 6, "wall": [{"start": [0.0, -1.5], "end": [0.0, 1.5]}]}
    scenario = parse_scenario(table, "lab.toml", name="lab")
    assert np.abs(make_plant(scenario, np.random.default_rng(seed)).pose[:, 0]).min() >= 0.177 + 0.046


def test_walls_leave_less_room_for_starts() -> None:
    comb = [Wall(0.35 * k, 0.0, 0.35 * k, 3.0) for k in range(1, 12)]
    with pytest.raises(PlanningError, match=r"2 robots .* without touching with 11 walls in it; 0 were placed"):
        random_starts(np.random.default_rng(0), 2, ARENA, 0.177, walls=comb)


def test_contacts_with_walls_are_counted_by_episodes() -> None:
    robot = plant([(0.5, 0.0, 0.0)], walls=[Wall(1.0, -1.0, 1.0, 1.0), Wall(0.0, 5.0, 1.0, 5.0)])
    counts = []
    for v in (0.2, 0.2, -0.2, -0.2, 0.2):  # by 0.4 m each
        drive(robot, v, 0.0, 2.0)
        counts.append(robot.wall_contacts)
    assert counts == [1, 1, 2, 2, 3], "it has passed through, and back"
    assert plant([(0.823, 0.0, 0.0)], walls=[Wall(1.0, -1.0, 1.0, 1.0)]).wall_contacts == 0, "it was put down beside it"


def test_the_walls_of_a_scenario_are_those_inside_the_arena_and_around_it() -> None:
    starts = {"r1": [-1.9, 1.0, 0.0], "r2": [-0.4, 0.0, 0.0]}
    table = {"robots": 2, "wall": [{"start": [0.0, -1.0], "end": [0.0, 1.0]}], "starts": starts}
    robots = make_plant(parse_scenario(table, "lab.toml", name="lab"), np.random.default_rng(0))
    for command, count in ((0.0, 0), (0.3, 1), (-0.5, 2)):  # r2 drives into the wall; then r1 out of the arena
        drive(robots, command, 0.0, 2.0)
        assert robots.wall_contacts == count


def test_impossible_starts_are_refused_with_both_numbers() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(PlanningError, match=r"200 robots .*12\.60 m\^2"):
        random_starts(rng, 200, ARENA, 0.177)
    with pytest.raises(PlanningError, match=r"70 robots .* \d+ were placed"):
        random_starts(rng, 70, ARENA, 0.177)
    with pytest.raises(PlanningError, match=r"0\.3 x 3 m holds no robot that needs 0\.446 m"):
        random_starts(rng, 1, Bounds(0.0, 0.3, 0.0, 3.0), 0.177)
