"""The lock-step loop: plant, cameras, filter and limits of N robots, advanced together, without bus or clock."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np

from muro_zenoh.elementwise import Array
from muro_zenoh.estimation.ekf import Fix
from muro_zenoh.geometry import State
from muro_zenoh.simulation.noise import GaussianRows
from muro_zenoh.simulation.plant import Plant
from muro_zenoh.simulation.rollout.array_filter import ArrayFilter
from muro_zenoh.simulation.rollout.settings import LoopSettings

_LARGER_THAN_ANY = 3_900_000  # floats; just below the 32 MiB up to which glibc adapts


Policy = Callable[[float, State], tuple[Any, Any]]
"""``policy(t, ahead) -> (v, omega)``: the desired speeds, arrays (N,) [m/s], [rad/s], before calibration; ``ahead``:
the predicted states, arrays (N,), when a command given now takes effect at the wheels."""


class Fleet:
    """N robots in one loop; they may belong to independent trials.

    The same starts, settings and generator give the same bits, on one machine with one numpy.

    Args:
        starts: poses (N, 3): x, y [m, world], theta [rad].
        settings: the loop.
        rng: for drive errors, slip and the noise of the fixes.
    """

    def __init__(self, starts: Array, settings: LoopSettings, rng: np.random.Generator) -> None:
        _keep_freed_memory()
        self.settings = settings
        self._noise = GaussianRows(rng, len(starts))
        self.plant = Plant(
            starts,
            rng,
            limits=settings.wheels,
            drive_error=settings.drive_error,
            slip=settings.slip,
            count_contacts=False,
            add_odometry=False,
        )
        n = len(self.plant)
        self._command: Array = np.zeros((2, n))
        self.filter: ArrayFilter | None = None
        """The filters, from the first fix on; None before, and in a loop without estimation."""
        self.newest_fix: Fix | None = None
        """The newest fixes that have arrived, arrays (N,); None in a loop without estimation."""
        self._underway: deque[tuple[float, Fix]] = deque()
        self._variances = settings.fix_sigma**2, settings.fix_sigma_theta**2
        # The capture is offset within the period such that the fix arrives exactly when the law runs.
        self._capture = settings.period - math.fmod(settings.delay, settings.period)
        self._steps = 0
        self._last_capture = 0.0
        if settings.estimated:
            # The robots are stationary and seen before the first command.
            self.newest_fix = self._photograph()
            self.filter = ArrayFilter(self.newest_fix, settings.filter, settings.wheels)

    @property
    def command(self) -> Array:
        """The current command (N, 2): v [m/s], omega [rad/s]. A view."""
        return self._command.T

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._steps * self.settings.period

    @property
    def fix_age(self) -> float:
        """Time since the capture of :attr:`newest_fix` [s]."""
        return self.time - self._last_capture

    def step(self, policy: Policy, watch: Callable[[float, Array], None] | None = None) -> None:
        """Advance one period: the due fix, the law, calibration and limits, then the plant.

        Args:
            policy: the law.
            watch: called with the time and the true poses (N, 3) after every step of the plant.
        """
        settings = self.settings
        t = self.time
        self._receive(t)
        v, omega = policy(t, self.ahead())
        if self.filter is not None:
            v, omega = v / self.filter.mean.s_v, omega / self.filter.mean.s_omega
        np.minimum(np.maximum(v, -settings.v_max), settings.v_max, out=self._command[0])
        np.minimum(np.maximum(omega, -settings.omega_max), settings.omega_max, out=self._command[1])
        if self.filter is None:
            self._move(settings.period, watch)
        else:
            self._move(self._capture, watch)
            self._underway.append((t + self._capture, self._photograph()))
            if settings.period - self._capture > 1e-9:
                self._move(settings.period - self._capture, watch)
        self._steps += 1

    def ahead(self) -> State:
        """The predicted states, arrays (N,), when a command given now takes effect: the filter's own prediction over
        the wheels' lag; the current truth in a loop without estimation."""
        return self._seen(self.settings.wheels.lag)

    def state(self) -> State:
        """The estimated states now, arrays (N,); the truth in a loop without estimation."""
        return self._seen(0.0)

    def _seen(self, horizon: float) -> State:
        if self.filter is None:
            x, y, theta = self.plant.pose.T
            return State(x, y, theta, *self.plant.twist.T)
        return State(*self.filter.ahead(self._command, horizon))

    def _receive(self, t: float) -> None:
        """Hand the filter the fixes that have arrived by ``t``."""
        while self.filter is not None and self._underway and self._underway[0][0] + self.settings.delay <= t + 1e-9:
            captured, fix = self._underway.popleft()
            self.filter.fix(fix, captured - self._last_capture)
            self._last_capture = captured
            self.newest_fix = fix

    def _move(self, dt: float, watch: Callable[[float, Array], None] | None) -> None:
        self.plant.step(self._command.T, dt)
        if self.filter is not None:
            self.filter.drove(self.plant.odometry_twist.T, dt)
        if watch is not None:
            watch(self.plant.time, self.plant.pose)

    def _photograph(self) -> Fix:
        x, y, theta = self.plant.pose.T
        noise = self._noise.take(3)
        sigma, sigma_theta = self.settings.fix_sigma, self.settings.fix_sigma_theta
        place, heading = self._variances
        return Fix(
            x + sigma * noise[0], y + sigma * noise[1], theta + sigma_theta * noise[2],
            place, 0.0, 0.0, place, 0.0, heading,
        )  # fmt: skip


def _keep_freed_memory() -> None:
    """Make glibc keep memory that numpy's temporaries free.

    By default it returns blocks of this size and faults them in again at every operation: 2.5 times the time with ten
    thousand robots. It keeps them once it has freed a larger one.
    """
    np.empty(_LARGER_THAN_ANY)
