"""The simulated floor: a plant that keeps up with the clock."""

from __future__ import annotations

import math

import numpy as np
import pytest

from agents.base.simulated import STEP, Floor, SimulatedWheels
from muro_zenoh.elementwise import Array
from muro_zenoh.simulation.plant import Plant
from tests.support.clock import ManualClock


def floor(robots: int = 1) -> tuple[Floor, ManualClock]:
    clock = ManualClock()
    plant = Plant(np.zeros((robots, 3)), np.random.default_rng(0), drive_error=0.0, slip=0.0, count_contacts=False)
    return Floor(plant, clock), clock


def test_the_plant_follows_the_clock() -> None:
    there, clock = floor()
    for _ in range(7):
        clock.advance(0.013)
        stamp = there.catch_up()
        assert clock.now() - STEP < stamp <= clock.now() + 1e-9
    assert there.plant.time == pytest.approx(0.09, abs=STEP)


def test_a_second_reading_at_the_same_time_moves_nothing() -> None:
    there, clock = floor()
    clock.advance(0.1)
    there.catch_up()
    before = there.plant.time
    there.catch_up()
    assert there.plant.time == before


def test_a_command_applies_from_its_time() -> None:
    there, clock = floor()
    wheels = SimulatedWheels(there, 0)
    clock.advance(0.3)  # nobody looked meanwhile, and the robot was stationary
    wheels.command(0.2, 0.0)
    assert wheels.read().x == pytest.approx(0.0, abs=1e-4)  # a step more or less, by the clock's rounding
    clock.advance(0.4)
    wheels.command(0.0, 0.0)
    x = wheels.read().x
    assert 0.03 < x < 0.08  # 0.2 m/s for 0.4 s, less the acceleration at 0.5 m/s^2


def test_the_plant_is_independent_of_how_often_it_is_read() -> None:
    ways = []
    for pieces in (1, 40):
        there, clock = floor()
        wheels = SimulatedWheels(there, 0)
        wheels.command(0.2, 0.7)
        for _ in range(pieces):
            clock.advance(0.4 / pieces)
            there.catch_up()
        clock.advance(0.005)  # no rounding decides about a step
        reading = wheels.read()
        ways.append((reading.x, reading.y, reading.theta, reading.v))
    assert ways[0] == pytest.approx(ways[1])


def test_after_a_suspension_the_time_is_skipped() -> None:
    there, clock = floor()
    wheels = SimulatedWheels(there, 0)
    wheels.command(0.2, 0.0)
    clock.advance(0.5)
    before = wheels.read()
    clock.advance(60.0)
    after = wheels.read()
    assert after.x - before.x < 0.2 * 0.5 + 1e-6
    assert there.lost == pytest.approx(59.5, abs=STEP)
    assert clock.now() - STEP < there.catch_up() <= clock.now() + 1e-9


@pytest.mark.parametrize("frozen", [0.4, 0.5, 5.0])
def test_a_command_is_not_driven_beyond_its_time_by_a_process_that_was_frozen(frozen: float) -> None:
    there, clock = floor(robots=2)
    there = Floor(there.plant, clock, watchdog=0.3)
    wheels = [SimulatedWheels(there, row) for row in range(2)]
    clock.advance(1.0)
    wheels[0].command(0.5, 0.0)
    for _ in range(13):  # for 0.26 s of driving, read at 50 Hz
        clock.advance(0.02)
        there.catch_up()
    wheels[1].command(0.5, 0.0)
    clock.advance(frozen)
    there.catch_up()
    assert there.commands.tolist() == [[0.0, 0.0], [0.0, 0.0]]
    if frozen < 0.5:
        assert wheels[0].read().v < wheels[1].read().v  # each for its own time


def test_each_robot_has_its_own_wheels() -> None:
    there, clock = floor(robots=3)
    wheels = [SimulatedWheels(there, row) for row in range(3)]
    wheels[1].command(0.2, 0.0)
    wheels[2].command(0.0, 1.0)
    for _ in range(20):
        clock.advance(0.1)
        there.catch_up()
    readings = [w.read() for w in wheels]
    assert readings[0][:5] == (0.0, 0.0, 0.0, 0.0, 0.0)
    assert readings[1].v == pytest.approx(0.2, abs=1e-3)
    assert readings[1].x > 0.2
    assert readings[1].theta == 0.0
    assert readings[2].omega == pytest.approx(1.0, abs=1e-2)
    assert (readings[2].x, readings[2].y) == (0.0, 0.0)


def test_a_stop_brakes_no_harder_than_the_wheels_can() -> None:
    there, clock = floor()
    wheels = SimulatedWheels(there, 0)
    wheels.command(0.5, 0.0)
    for _ in range(30):
        clock.advance(0.1)
        there.catch_up()
    assert wheels.read().v == pytest.approx(0.5, abs=1e-3)
    began = wheels.read().x
    wheels.command(0.0, 0.0)
    speeds = [0.5]
    for _ in range(100):
        clock.advance(STEP)
        speeds.append(wheels.read().v)
    falls = -np.diff(speeds) / STEP
    assert falls.max() <= 1.0 + 0.2  # the clock's rounding may put two steps into one look
    assert speeds[-1] < 1e-3
    assert wheels.read().x - began < 0.5**2 / 2.0 + 0.5 * 0.15  # braking at 1 m/s^2, after the wheels' lag


def test_no_hazard_is_on_the_simulated_floor() -> None:
    there, _ = floor()
    reading = SimulatedWheels(there, 0).read()
    assert reading.hazard == ""
    assert math.isfinite(reading.battery)


def test_reading_many_robots_moves_the_plant_once() -> None:
    there, clock = floor(robots=30)
    wheels = [SimulatedWheels(there, row) for row in range(30)]
    steps = 0
    move = there.plant.step

    def counting(commands: Array, dt: float) -> None:
        nonlocal steps
        steps += 1
        move(commands, dt)

    there.plant.step = counting  # type: ignore[method-assign]
    for w in wheels:
        w.command(0.3, 0.0)
    clock.advance(2.5 * STEP)
    readings = [w.read() for w in wheels]
    assert steps == 2
    assert {reading.v for reading in readings} == {readings[0].v}
    assert readings[0].v > 0.0
    clock.advance(STEP)
    assert wheels[0].read().v > readings[0].v  # what was read is not kept when the plant moves on
