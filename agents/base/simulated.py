"""Wheels of the simulated plant: a whole room of them in the simulator, or one pair on a floor of its own."""

from __future__ import annotations

import numpy as np

from agents.base.wheels import WheelReading
from muro_zenoh.config import RobotSettings
from muro_zenoh.elementwise import Array
from muro_zenoh.runtime.clock import Clock
from muro_zenoh.simulation.plant import Plant

STEP = 0.01
"""The plant moves in steps of this [s]."""

_MOST = 0.5
"""What the plant lags behind the clock by more than this is lost [s]: after a freeze nobody drives on blindly."""


class Floor:
    """A plant that keeps up with a clock: each look at it moves it on to now first.

    Args:
        plant: the robots.
        clock: what it keeps up with.

    Attributes:
        commands: (N, 2), what the wheels are commanded: v [m/s], omega [rad/s].
        lost: time that was skipped, because this process was frozen [s].
    """

    def __init__(self, plant: Plant, clock: Clock) -> None:
        self.commands: Array = np.zeros((len(plant), 2))
        self.lost = 0.0
        self._plant = plant
        self._clock = clock
        self._time = clock.now()
        self._readings: list[WheelReading] = []  # of the plant as it is; empty when it has moved since

    @property
    def plant(self) -> Plant:
        """The robots as they were at the last :meth:`catch_up`."""
        return self._plant

    @property
    def behind(self) -> float:
        """How long ago the plant was as it is [s]; after :meth:`catch_up` less than one step, for it moves in steps."""
        return self._clock.now() - self._time

    def catch_up(self) -> float:
        """Move the plant on to now; the time of its state [s since 1970], less than one step ago."""
        behind = self._clock.now() - self._time
        if behind < STEP:
            return self._time
        if behind > _MOST:
            self.lost += behind - _MOST
            self._time += behind - _MOST
            behind = _MOST
        for _ in range(int(behind / STEP)):
            self._plant.step(self.commands, STEP)
            self._time += STEP
        self._readings = []
        return self._time

    def reading(self, row: int) -> WheelReading:
        """What the encoders of a robot's nominal wheels report now. This floor has no walls and no edge.

        Args:
            row: of the robot.
        """
        self.catch_up()
        if not self._readings:
            # Of all robots at once: who reads one, mostly reads the others next.
            rows = np.concatenate((self._plant.odometry_pose, self._plant.odometry_twist), axis=1)
            self._readings = [WheelReading(*numbers) for numbers in rows.tolist()]
        return self._readings[row]


class SimulatedWheels:
    """The wheels of one robot on a :class:`Floor`.

    Args:
        floor: the floor.
        row: of this robot.
    """

    def __init__(self, floor: Floor, row: int) -> None:
        self._floor = floor
        self._row = row

    def command(self, v: float, omega: float) -> None:
        """Turn so that a nominal robot would do ``v`` [m/s] and ``omega`` [rad/s]."""
        self._floor.catch_up()  # until now the old command held
        self._floor.commands[self._row] = v, omega

    def read(self) -> WheelReading:
        """What the encoders of nominal wheels report."""
        return self._floor.reading(self._row)


def make_wheels(robot: RobotSettings, clock: Clock) -> SimulatedWheels:
    """A nominal robot on a floor of its own, which no camera sees: to try a link and the dead-man.

    Args:
        robot: what its wheels can do.
        clock: what the floor keeps up with.
    """
    plant = Plant(np.zeros((1, 3)), np.random.default_rng(0), limits=robot.wheels, drive_error=0.0, slip=0.0)
    return SimulatedWheels(Floor(plant, clock), 0)
