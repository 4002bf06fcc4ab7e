"""The robots themselves: unicycles on wheels that lag, err and slip.

What the simulator's room is made of, and the lock-step rollout's. Bodies pass through each other; touching is counted.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from muro_zenoh.elementwise import ARRAYS, Array
from muro_zenoh.estimation.wheel_model import WheelLimits, step_wheels
from muro_zenoh.simulation.starts import random_starts

__all__ = ["Plant", "random_starts"]


class Plant:
    """N unicycles, one array entry each, in the world frame [m, rad, s].

    The nominal wheels follow the command (:func:`~muro_zenoh.estimation.wheel_model.step_wheels`). The robot does
    s_v times their forward and s_omega times their turning speed, and slips besides; its encoders see neither.

    Args:
        starts: poses (N, 3): x, y [m], theta [rad].
        rng: draws the hidden drive errors, then the slip.
        limits: the wheels, of all robots or one per robot.
        radius: of the bodies [m], of all robots or (N,).
        drive_error: s_v and s_omega are uniform in 1 -+ this, and hidden from everyone but the score sheet.
        slip: standard deviation of distance [m/sqrt(m)], of the angle turned [rad/sqrt(rad)] and of the heading over a
            distance [rad/sqrt(m)].
        count_contacts: whether to look at every pair of robots in every step; False for independent trials.

    Raises:
        ValueError: for shapes that do not fit, or a drive error outside [0, 1).
    """

    def __init__(
        self,
        starts: Array,
        rng: np.random.Generator,
        *,
        limits: WheelLimits | Sequence[WheelLimits] | None = None,
        radius: float | Array = 0.177,
        drive_error: float = 0.2,
        slip: float = 0.005,
        count_contacts: bool = True,
    ) -> None:
        starts = np.asarray(starts, dtype=np.float64)
        if starts.ndim != 2 or starts.shape[1] != 3:
            raise ValueError(f"starts of shape {starts.shape}: expected (N, 3)")
        if not 0.0 <= drive_error < 1.0:
            raise ValueError(f"drive_error {drive_error}: expected a fraction in [0, 1)")
        n = len(starts)
        self._rng = rng
        self._limits = _stack(limits, n)
        self._slip = slip
        self._state = np.ascontiguousarray(starts.T)
        self._state[2] = ARRAYS.wrap(self._state[2])
        self._odometry = np.zeros((3, n))
        self.s_v: Array = rng.uniform(1.0 - drive_error, 1.0 + drive_error, n)
        """Hidden drive error of the forward speed (N,)."""
        self.s_omega: Array = rng.uniform(1.0 - drive_error, 1.0 + drive_error, n)
        """Hidden drive error of the turning speed (N,)."""
        self.wheel_v: Array = np.zeros(n)
        """Forward speed of the nominal wheels (N,) [m/s]: the encoders' twist."""
        self.wheel_omega: Array = np.zeros(n)
        """Turning speed of the nominal wheels (N,) [rad/s]: the encoders' twist."""
        self.time: float = 0.0
        """Simulated time since the start [s]."""
        self.contacts: int = 0
        """Episodes so far of two centres closer than the sum of the radii."""
        self.min_separation: float = float("inf")
        """Least distance so far between two centres [m]; infinite for one robot."""
        self._pairs = np.triu_indices(n if count_contacts else 0, k=1)
        radii = np.broadcast_to(np.asarray(radius, dtype=np.float64), (n,))
        self._touch = radii[self._pairs[0]] + radii[self._pairs[1]]
        self._touching = np.zeros(len(self._touch), dtype=bool)
        self._look()

    def __len__(self) -> int:
        return len(self.s_v)

    @property
    def pose(self) -> Array:
        """True poses (N, 3): x, y [m, world], theta [rad, (-pi, pi]]. A view of the state."""
        return self._state.T

    @property
    def twist(self) -> Array:
        """True speeds (N, 2): v [m/s], omega [rad/s], slip left out."""
        return np.stack((self.s_v * self.wheel_v, self.s_omega * self.wheel_omega), axis=1)

    @property
    def odometry_pose(self) -> Array:
        """What encoders of nominal wheels add up to since the start (N, 3), in the frame of the first pose. A view."""
        return self._odometry.T

    @property
    def odometry_twist(self) -> Array:
        """What encoders of nominal wheels report now (N, 2): v [m/s], omega [rad/s]."""
        return np.stack((self.wheel_v, self.wheel_omega), axis=1)

    def step(self, commands: Array, dt: float) -> None:
        """Drive for ``dt`` under commands held meanwhile.

        Args:
            commands: (N, 2): v [m/s], omega [rad/s] for the nominal wheels.
            dt: how long [s]; the speeds are taken as linear within it, so at most about 0.05 s.
        """
        v0, omega0 = self.wheel_v, self.wheel_omega
        v, omega = step_wheels(v0, omega0, commands[:, 0], commands[:, 1], self._limits, dt)
        self.wheel_v, self.wheel_omega = v, omega
        self.time += dt
        way, turn = (0.5 * dt) * (v0 + v), (0.5 * dt) * (omega0 + omega)
        _advance(self._odometry, way, turn)
        way, turn = self.s_v * way, self.s_omega * turn
        if self._slip > 0.0:
            noise = self._rng.standard_normal((2, len(self)))
            path, spin = abs(way), abs(turn)
            way = way + self._slip * np.sqrt(path) * noise[0]
            turn = turn + self._slip * np.sqrt(path + spin) * noise[1]
        _advance(self._state, way, turn)
        self._look()

    def place(self, robot: int, x: float, y: float, theta: float) -> None:
        """Put one robot elsewhere, as a hand would: its encoders notice nothing.

        Args:
            robot: index.
            x: where [m, world].
            y: where [m, world].
            theta: heading [rad].
        """
        self._state[:, robot] = x, y, ARRAYS.wrap(np.float64(theta))

    def _look(self) -> None:
        """Distances of all pairs: contacts begun in this step, and the least so far."""
        first, second = self._pairs
        if not len(first):
            return
        x, y = self._state[0], self._state[1]
        distance = np.hypot(x[first] - x[second], y[first] - y[second])
        touching = distance < self._touch
        self.contacts += int(np.count_nonzero(touching & ~self._touching))
        self._touching = touching
        self.min_separation = min(self.min_separation, float(distance.min()))


def _advance(state: Array, way: Array, turn: Array) -> None:
    """Carry poses (3, N) along arcs of length ``way`` [m] that turn by ``turn`` [rad], in place."""
    half = 0.5 * turn
    hh = half * half
    chord = way * (1.0 - hh * (1.0 / 6.0 - hh * (1.0 / 120.0 - hh / 5040.0)))
    mid = state[2] + half
    state[0] += chord * np.cos(mid)
    state[1] += chord * np.sin(mid)
    state[2] = ARRAYS.wrap(mid + half)


def _stack(limits: WheelLimits | Sequence[WheelLimits] | None, n: int) -> WheelLimits:
    """One WheelLimits for all robots: the one given, or arrays with an entry per robot."""
    if limits is None:
        return WheelLimits()
    if isinstance(limits, WheelLimits):
        return limits
    if len(limits) != n:
        raise ValueError(f"{len(limits)} wheel limits for {n} robots: expected one, or one per robot")
    return WheelLimits(*(np.array(column, dtype=np.float64) for column in zip(*limits, strict=True)))
