"""The interface of the wheels to a base."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from muro_zenoh.config import RobotSettings
from muro_zenoh.runtime.clock import Clock


class WheelReading(NamedTuple):
    """A reading of the wheels and the body.

    ``x`` [m], ``y`` [m], ``theta`` [rad]: the encoders' pose, in a frame of its own. ``v`` [m/s], ``omega`` [rad/s]:
    their twist. ``battery`` in [0, 1]. ``charging``, ``bumper``, ``cliff``, ``wheel_drop``: the sensors' states.
    """

    x: float
    y: float
    theta: float
    v: float
    omega: float
    battery: float = 1.0
    charging: bool = False
    bumper: bool = False
    cliff: bool = False
    wheel_drop: bool = False

    @property
    def hazard(self) -> str:
        """The hazard that forbids driving; empty when there is none."""
        if self.bumper:
            return "bumper"
        if self.cliff:
            return "cliff"
        return "wheel_drop" if self.wheel_drop else ""


class Wheels(Protocol):
    """The wheels of one robot. No method blocks."""

    def command(self, v: float, omega: float) -> None:
        """Drive at ``v`` [m/s] and ``omega`` [rad/s]; (0, 0) stops at once, without a ramp."""
        ...

    def read(self) -> WheelReading:
        """The current reading."""
        ...


class MakeWheels(Protocol):
    """The type of a driver's ``make_wheels``: it opens the wheels of one robot, and may raise when there are none.

    ``robot``: its settings. ``clock``: the process's clock, for wheels that need the time.
    """

    def __call__(self, robot: RobotSettings, clock: Clock) -> Wheels: ...
