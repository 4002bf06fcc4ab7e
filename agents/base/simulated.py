"""Wheels of the simulated plant."""

from __future__ import annotations

from agents.base.wheels import WheelReading
from muro_zenoh.elementwise import Array
from muro_zenoh.simulation.plant import Plant


class SimulatedWheels:
    """One row of a :class:`~muro_zenoh.simulation.plant.Plant`.

    Args:
        plant: the plant.
        commands: (N, 2), what all wheels are told: v [m/s], omega [rad/s]; this robot's row is written.
        row: of this robot.
    """

    def __init__(self, plant: Plant, commands: Array, row: int) -> None:
        self._plant = plant
        self._command = commands[row]
        self._row = row

    def command(self, v: float, omega: float) -> None:
        """Turn so that a nominal robot would do ``v`` [m/s] and ``omega`` [rad/s]."""
        self._command[:] = v, omega

    def read(self) -> WheelReading:
        """What the encoders of nominal wheels report. The simulated floor has no walls and no edge."""
        x, y, theta = self._plant.odometry_pose[self._row].tolist()
        v, omega = self._plant.odometry_twist[self._row].tolist()
        return WheelReading(x, y, theta, v, omega)
