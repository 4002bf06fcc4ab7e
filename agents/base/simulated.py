"""Wheels of the simulated plant."""

from __future__ import annotations

import numpy as np

from agents.base.wheels import WheelReading
from muro_zenoh.elementwise import Array
from muro_zenoh.runtime.clock import Clock
from muro_zenoh.simulation.plant import Plant

STEP = 0.01
"""The plant moves in steps of this [s] ..."""

_MOST = 0.5
"""... and what it lags behind the clock by more than this is lost [s]: after a freeze nobody drives on blindly."""


class Floor:
    """A plant that keeps up with a clock: whoever looks at it, sees it as it is now.

    Args:
        plant: the robots.
        clock: what it keeps up with.

    Attributes:
        commands: (N, 2), what the wheels are told: v [m/s], omega [rad/s].
        lost: time that the plant never lived, because this process was frozen [s].
    """

    def __init__(self, plant: Plant, clock: Clock) -> None:
        self.commands: Array = np.zeros((len(plant), 2))
        self.lost = 0.0
        self._plant = plant
        self._clock = clock
        self._time = clock.now()

    @property
    def plant(self) -> Plant:
        """The robots as they were when somebody last caught up."""
        return self._plant

    def catch_up(self) -> float:
        """Move the plant on to now; the time of its state [s since 1970], less than one step ago."""
        behind = self._clock.now() - self._time
        if behind > _MOST:
            self.lost += behind - _MOST
            self._time += behind - _MOST
            behind = _MOST
        for _ in range(int(behind / STEP)):
            self._plant.step(self.commands, STEP)
            self._time += STEP
        return self._time


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
        """What the encoders of nominal wheels report. The simulated floor has no walls and no edge."""
        self._floor.catch_up()
        plant = self._floor.plant
        x, y, theta = plant.odometry_pose[self._row].tolist()
        v, omega = plant.odometry_twist[self._row].tolist()
        return WheelReading(x, y, theta, v, omega)
