"""What a base needs of the wheels."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from muro_zenoh.config import RobotSettings
from muro_zenoh.runtime.clock import Clock


class WheelReading(NamedTuple):
    """What the wheels and the body report.

    ``x`` [m], ``y`` [m], ``theta`` [rad]: the encoders' pose, in a frame of its own. ``v`` [m/s], ``omega`` [rad/s]:
    their twist. ``battery`` in [0, 1]. ``charging``, ``bumper``, ``cliff``, ``wheel_drop``: as they say.
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
        """What forbids the wheels to turn; empty when nothing does."""
        for name in ("bumper", "cliff", "wheel_drop"):
            if getattr(self, name):
                return name
        return ""


class Wheels(Protocol):
    """The wheels of one robot. None of these blocks."""

    def command(self, v: float, omega: float) -> None:
        """Turn so that the robot would do ``v`` [m/s] and ``omega`` [rad/s]; (0, 0) stops at once, never ramped."""
        ...

    def read(self) -> WheelReading:
        """What they report now."""
        ...


class MakeWheels(Protocol):
    """What a driver's file calls ``make_wheels``: it finds the wheels of one robot, and may raise when there are none.

    ``robot``: its settings. ``clock``: the process's, for wheels that look at the time.
    """

    def __call__(self, robot: RobotSettings, clock: Clock) -> Wheels: ...
