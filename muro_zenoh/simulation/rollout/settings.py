"""Settings of a lock-step loop: period, cameras, wheels and limits."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from muro_zenoh.estimation.filter_settings import FilterSettings
from muro_zenoh.estimation.wheel_model import WheelLimits

REAL_WHEELS = WheelLimits()
"""Wheels with the lag and the limits of a TurtleBot."""

IDEAL_WHEELS = WheelLimits(lag=0.0, a_max=1e9, alpha_max=1e9, brake=1e9)
"""Wheels that follow the command immediately."""


@dataclass(frozen=True, slots=True)
class LoopSettings:
    """One robot's loop, from camera to wheel.

    Args:
        period: of the camera and of the law [s]; the law runs when a fix arrives, and the command is held.
        delay: from a picture's capture to the fix's arrival [s].
        fix_sigma: standard deviation of a fix's x and y [m].
        fix_sigma_theta: standard deviation of a fix's heading [rad].
        estimated: whether the law sees the filter's estimate; otherwise it sees the truth, without delay.
        drive_error: the hidden drive errors are uniform in 1 -+ this.
        slip: of the plant, see :class:`~muro_zenoh.simulation.plant.Plant`.
        wheels: lag and acceleration limits.
        v_max: maximum forward speed of a command [m/s].
        omega_max: maximum turning rate of a command [rad/s].
        filter: the filter's settings.
    """

    period: float = 0.05
    delay: float = 0.08
    fix_sigma: float = 0.002
    fix_sigma_theta: float = math.radians(0.5)
    estimated: bool = True
    drive_error: float = 0.2
    slip: float = 0.005
    wheels: WheelLimits = REAL_WHEELS
    v_max: float = 0.5
    omega_max: float = 1.0
    filter: FilterSettings = field(default_factory=FilterSettings)

    def __post_init__(self) -> None:
        if not 0.0 < self.period <= 0.1:
            raise ValueError(f"period {self.period} s of the loop: expected more than 0 and at most 0.1")
        if not 0.0 <= self.delay <= 1.0:
            raise ValueError(f"delay {self.delay} s of the fixes: expected 0 to 1")


NOISY = LoopSettings()
"""The loop of a laboratory: 20 Hz fixes of 2 mm and 0.5 degrees, 80 ms late, 20 % drive error, 0.1 s wheels, EKF."""

CLEAN = LoopSettings(period=0.02, delay=0.0, estimated=False, drive_error=0.0, slip=0.0, wheels=IDEAL_WHEELS)
"""An ideal loop: the truth at 50 Hz, and wheels that follow the command immediately."""
