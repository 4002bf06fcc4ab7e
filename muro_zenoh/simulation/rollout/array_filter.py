"""The agent's filter for thousands of robots in lock step: the same EKF, on arrays, with fixes in order."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np

from muro_zenoh.arcs import carry
from muro_zenoh.elementwise import Array
from muro_zenoh.estimation import ekf
from muro_zenoh.estimation.ekf import Covariance, Fix, Mean
from muro_zenoh.estimation.filter_settings import FilterSettings
from muro_zenoh.estimation.limited_lag import follow_array
from muro_zenoh.estimation.wheel_model import WheelLimits
from muro_zenoh.estimation.wheel_track import LONGEST_ARC


class ArrayFilter:
    """N filters in parallel. All fixes are captured together and arrive together, in order.

    It handles neither kidnapped robots nor restarts.

    Args:
        first: the fixes to start from, arrays (N,).
        settings: the filter's settings.
        wheels: lag and limits, for the prediction.
    """

    def __init__(self, first: Fix, settings: FilterSettings, wheels: WheelLimits) -> None:
        self._settings = settings
        self._grow: Array = np.array((wheels.a_max, wheels.alpha_max)).reshape(2, -1)
        self._fall: Array = np.array((wheels.brake, wheels.alpha_brake)).reshape(2, -1)
        self._lag = wheels.lag
        self.mean, self.cov = ekf.start(first, settings)
        self._since: deque[tuple[Array, float]] = deque()
        self._speeds: Array = np.zeros((2, len(first.x)))

    def drove(self, speeds: Array, dt: float) -> None:
        """Add the wheels' speeds after another ``dt``.

        Args:
            speeds: of the nominal wheels (2, N): v [m/s], omega [rad/s].
            dt: time since the last call, or since the first fix [s].
        """
        self._since.append((0.5 * (self._speeds + speeds), dt))
        self._speeds = speeds

    def fix(self, fix: Fix, since_last: float) -> Array:
        """Update with fixes captured ``since_last`` after the previous ones.

        Args:
            fix: the measured poses, arrays (N,).
            since_last: time between the captures [s]; it must end where a call of :meth:`drove` ended.

        Returns:
            Squared Mahalanobis distances (N,); those beyond the gate were not used.
        """
        stretch = ekf.begin(self.mean)
        pieces: list[tuple[Array, float]] = []
        left = since_last
        while left > 1e-9:
            pieces.append(self._since.popleft())
            left -= pieces[-1][1]
        for (v, omega), dt in _gather(pieces):
            stretch = ekf.drive(stretch, self.mean, v, omega, dt, self._settings)
        mean, cov = ekf.predict(self.mean, self.cov, stretch, self._settings)
        used_mean, used_cov, nis = ekf.correct(mean, cov, fix, stretch.moved_v, stretch.moved_w, self._settings)
        taken: Array = np.asarray(nis)
        passed = taken <= self._settings.gate
        if passed.all():
            self.mean, self.cov = used_mean, used_cov
        else:
            self.mean = Mean(*(np.where(passed, a, b) for a, b in zip(used_mean, mean, strict=True)))
            self.cov = Covariance(*(np.where(passed, a, b) for a, b in zip(used_cov, cov, strict=True)))
        return taken

    def ahead(self, command: Array, horizon: float) -> tuple[Array, Array, Array, Array, Array]:
        """Predicted pose and true speeds ``horizon`` from now, under the current command.

        Args:
            command: the current command (2, N): v [m/s], omega [rad/s].
            horizon: how far ahead [s]; the speeds are taken as linear within it.

        Returns:
            x, y [m, world], theta [rad], v [m/s], omega [rad/s], each (N,).
        """
        mean = self.mean
        scales = np.stack((mean.s_v, mean.s_omega))
        x, y, theta = mean.x, mean.y, mean.theta
        for speeds, dt in _gather(self._since):
            v, omega = scales * speeds
            x, y, theta = carry(x, y, theta, v, omega, dt)
        then = self._speeds
        if horizon > 0.0:
            then = follow_array(self._speeds, command, self._grow, self._fall, self._lag, horizon)
            v, omega = scales * (0.5 * (self._speeds + then))
            x, y, theta = carry(x, y, theta, v, omega, horizon)
        v, omega = scales * then
        return x, y, theta, v, omega


def _gather(pieces: Iterable[tuple[Array, float]]) -> list[tuple[Array, float]]:
    """Pieces merged into arcs of at most about 50 ms, as the agent's wheel track does."""
    arcs: list[tuple[Array, float]] = []
    for speeds, dt in pieces:
        if arcs and arcs[-1][1] + dt <= LONGEST_ARC:
            before, span = arcs[-1]
            whole = span + dt
            arcs[-1] = before * (span / whole) + speeds * (dt / whole), whole
        else:
            arcs.append((speeds, dt))
    return arcs
