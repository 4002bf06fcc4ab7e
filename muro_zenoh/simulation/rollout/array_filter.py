"""The agent's filter for thousands of robots in lock step: the same EKF, on arrays, with fixes that come in order."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from muro_zenoh.elementwise import Array
from muro_zenoh.estimation import ekf
from muro_zenoh.estimation.ekf import Covariance, FilterSettings, Fix, Mean
from muro_zenoh.estimation.wheel_model import WheelLimits, step_wheels

_LOOK_AHEAD_STEP = 0.05


class ArrayFilter:
    """N filters side by side. All fixes are captured together and arrive together, in order.

    Kidnapping has no place here, and no restart.

    Args:
        first: the fixes to start from, arrays (N,).
        settings: what the filters believe.
        wheels: lag and limits, for looking ahead.
    """

    def __init__(self, first: Fix, settings: FilterSettings, wheels: WheelLimits) -> None:
        self._settings = settings
        self._wheels = wheels
        self.mean, self.cov = ekf.start(first, settings)
        self._since: deque[tuple[Array, Array, float]] = deque()
        n = len(first.x)
        self._v, self._omega = np.zeros(n), np.zeros(n)

    def drove(self, v: Array, omega: Array, dt: float) -> None:
        """Take in the wheels' speeds after another ``dt``.

        Args:
            v: forward speed of the nominal wheels (N,) [m/s].
            omega: turning speed of the nominal wheels (N,) [rad/s].
            dt: since the last call, or since the first fix [s].
        """
        self._since.append((0.5 * (self._v + v), 0.5 * (self._omega + omega), dt))
        self._v, self._omega = v, omega

    def fix(self, fix: Fix, since_last: float) -> Array:
        """Take in the fixes captured ``since_last`` after the ones before.

        Args:
            fix: the measured poses, arrays (N,).
            since_last: from capture to capture [s]; must end where a call of :meth:`drove` ended.

        Returns:
            Squared Mahalanobis distances (N,); those beyond the gate were not used.
        """
        stretch = ekf.begin(self.mean)
        left = since_last
        while left > 1e-9:
            v, omega, dt = self._since.popleft()
            stretch = ekf.drive(stretch, self.mean, v, omega, dt, self._settings)
            left -= dt
        mean, cov = ekf.predict(self.mean, self.cov, stretch, self._settings)
        used_mean, used_cov, nis = ekf.correct(
            mean, cov, fix, stretch.time_v > 0.0, stretch.time_w > 0.0, self._settings
        )
        taken: Array = np.asarray(nis)
        passed = taken <= self._settings.gate
        if passed.all():
            self.mean, self.cov = used_mean, used_cov
        else:
            self.mean = Mean(*(np.where(passed, a, b) for a, b in zip(used_mean, mean, strict=True)))
            self.cov = Covariance(*(np.where(passed, a, b) for a, b in zip(used_cov, cov, strict=True)))
        return taken

    def ahead(self, v_cmd: Array, omega_cmd: Array, horizon: float) -> tuple[Array, Array, Array, Array, Array]:
        """Pose and true speeds ``horizon`` from now, under the command in force.

        Args:
            v_cmd: commanded forward speed (N,) [m/s].
            omega_cmd: commanded turning speed (N,) [rad/s].
            horizon: how far ahead [s].

        Returns:
            x, y [m, world], theta [rad], v [m/s], omega [rad/s], each (N,).
        """
        mean = self.mean
        x, y, theta = mean.x, mean.y, mean.theta
        for v, omega, dt in self._since:
            x, y, theta = ekf.carry(x, y, theta, mean.s_v * v, mean.s_omega * omega, dt)
        v0, omega0 = self._v, self._omega
        steps = math.ceil(horizon / _LOOK_AHEAD_STEP - 1e-9)
        for _ in range(steps):
            dt = horizon / steps
            v, omega = step_wheels(v0, omega0, v_cmd, omega_cmd, self._wheels, dt)
            x, y, theta = ekf.carry(
                x, y, theta, mean.s_v * (0.5 * (v0 + v)), mean.s_omega * (0.5 * (omega0 + omega)), dt
            )
            v0, omega0 = v, omega
        return x, y, theta, mean.s_v * v0, mean.s_omega * omega0
