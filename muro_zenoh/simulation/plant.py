"""Simulated robots: unicycles whose wheels have lag, scale errors and slip.

Used by the simulator process and by the lock-step rollout. Bodies pass through each other and through walls; contacts
are counted.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from muro_zenoh.arcs import chord
from muro_zenoh.arrays import ARRAYS
from muro_zenoh.elementwise import Array
from muro_zenoh.estimation.limited_lag import follow_array
from muro_zenoh.estimation.wheel_model import WheelLimits
from muro_zenoh.simulation.noise import GaussianRows
from muro_zenoh.walls import Wall

_TOUCHES = 1e-6
"""A body touches a wall that is nearer than its edge by this [m]: one may be put down beside it."""


class Plant:
    """N unicycles, one array entry each, in the world frame [m, rad, s].

    The nominal wheels follow the command (:mod:`muro_zenoh.estimation.wheel_model`). The robot does
    s_v times their forward and s_omega times their turning speed, and slips, too; its encoders see neither.

    Args:
        starts: poses (N, 3): x, y [m], theta [rad].
        rng: draws the hidden drive errors, then the slip.
        limits: the wheels, of all robots or one per robot.
        radius: of the bodies [m], of all robots or (N,).
        drive_error: s_v and s_omega are uniform in 1 -+ this, and hidden from all but the score sheet.
        slip: standard deviation of distance [m/sqrt(m)], of the angle turned [rad/sqrt(rad)] and of the heading over a
            distance [rad/sqrt(m)].
        count_contacts: whether to check every pair of robots in every step; False for independent trials.
        add_odometry: whether to integrate the encoders' poses; their twists are always available.
        walls: the walls with which contacts are counted.

    Raises:
        ValueError: inconsistent shapes, or a drive error outside [0, 1).
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
        add_odometry: bool = True,
        walls: Sequence[Wall] = (),
    ) -> None:
        starts = np.asarray(starts, dtype=np.float64)
        if starts.ndim != 2 or starts.shape[1] != 3:
            raise ValueError(f"starts of shape {starts.shape}: expected (N, 3)")
        if not 0.0 <= drive_error < 1.0:
            raise ValueError(f"drive_error {drive_error}: expected a fraction in [0, 1)")
        n = len(starts)
        kinds = _kinds(limits, n)
        # (2, 1) for one kind of robot, (2, N) for many
        self._grow: Array = np.array([(kind.a_max, kind.alpha_max) for kind in kinds]).T
        self._fall: Array = np.array([(kind.brake, kind.alpha_brake) for kind in kinds]).T
        self._lag: Array = np.array([kind.lag for kind in kinds])
        self._slip = slip
        # Rows: x y theta of the truth, then of the encoders' integrated pose; advanced together.
        bodies = 2 if add_odometry else 1
        self._state: Array = np.zeros((3, bodies, n))
        self._state[:, 0] = starts.T
        self._state[2, 0] = ARRAYS.wrap(self._state[2, 0])
        self._speeds: Array = np.zeros((2, n))
        self._scales: Array = np.ones((2, bodies, n))
        self._scales[:, 0] = rng.uniform(1.0 - drive_error, 1.0 + drive_error, (2, n))
        self._noise = GaussianRows(rng, n)
        self.time: float = 0.0
        """Simulated time since the start [s]."""
        self.contacts: int = 0
        """Number of episodes so far in which two centres were closer than the sum of the radii."""
        self.wall_contacts: int = 0
        """Number of episodes so far in which a body reached over a wall."""
        self.min_separation: float = float("inf")
        """Minimum distance so far between two centres [m]; infinite for one robot."""
        self._pairs = np.triu_indices(n if count_contacts else 0, k=1)
        radii = np.broadcast_to(np.asarray(radius, dtype=np.float64), (n,))
        self._touch = radii[self._pairs[0]] + radii[self._pairs[1]]
        self._touching = np.zeros(len(self._touch), dtype=bool)
        self._walls = walls
        self._radii = radii
        self._at_wall = np.zeros((len(walls), n), dtype=bool)
        self._look()

    def __len__(self) -> int:
        return len(self.s_v)

    @property
    def s_v(self) -> Array:
        """Hidden drive errors of the forward speed (N,)."""
        s_v: Array = self._scales[0, 0]
        return s_v

    @property
    def s_omega(self) -> Array:
        """Hidden drive errors of the turning speed (N,)."""
        s_omega: Array = self._scales[1, 0]
        return s_omega

    @property
    def pose(self) -> Array:
        """True poses (N, 3): x, y [m, world], theta [rad, (-pi, pi]]. A view of the state."""
        return self._state[:, 0].T

    @property
    def twist(self) -> Array:
        """True speeds (N, 2): v [m/s], omega [rad/s], without slip."""
        return (self._scales[:, 0] * self._speeds).T

    @property
    def odometry_pose(self) -> Array:
        """Integrated pose of nominal wheels' encoders since the start (N, 3), in the frame of the first pose. A view.

        Raises:
            ValueError: when ``add_odometry`` was False.
        """
        if self._state.shape[1] == 1:
            raise ValueError("the encoders' poses are not integrated in this plant: add_odometry was False")
        return self._state[:, 1].T

    @property
    def odometry_twist(self) -> Array:
        """Twist from nominal wheels' encoders now (N, 2): v [m/s], omega [rad/s]."""
        return self._speeds.T

    def step(self, commands: Array, dt: float) -> None:
        """Advance by ``dt`` under constant commands.

        Args:
            commands: (N, 2): v [m/s], omega [rad/s] for the nominal wheels.
            dt: the step [s], at most about 0.05 s: the speeds are taken as linear within it.
        """
        speeds = follow_array(self._speeds, commands.T, self._grow, self._fall, self._lag, dt)
        nominal = (0.5 * dt) * (self._speeds + speeds)
        self._speeds = speeds
        self.time += dt
        moved = self._scales * nominal[:, None]
        if self._slip > 0.0:
            spread = np.abs(moved[:, 0])
            spread[1] += spread[0]
            moved[:, 0] += self._slip * np.sqrt(spread) * self._noise.take(2)
        _advance(self._state, moved[0], moved[1])
        self._look()

    def place(self, robot: int, x: float, y: float, theta: float) -> None:
        """Move one robot to another pose, as if by hand: its encoders do not register it.

        Args:
            robot: its index.
            x: position [m, world].
            y: position [m, world].
            theta: heading [rad].
        """
        self._state[:, 0, robot] = x, y, ARRAYS.wrap(np.float64(theta))

    def jam(self, robot: int) -> None:
        """Bring one robot's wheels to rest at once.

        Args:
            robot: its index.
        """
        self._speeds[:, robot] = 0.0

    def _look(self) -> None:
        """Update contacts and minimum distance from all pairs, and contacts with walls."""
        first, second = self._pairs
        x, y = self._state[0, 0], self._state[1, 0]
        for k, wall in enumerate(self._walls):
            reaches = wall.distance(x, y) < self._radii - _TOUCHES
            self.wall_contacts += int(np.count_nonzero(reaches & ~self._at_wall[k]))
            self._at_wall[k] = reaches
        if not len(first):
            return
        distance = np.hypot(x[first] - x[second], y[first] - y[second])
        touching = distance < self._touch
        self.contacts += int(np.count_nonzero(touching & ~self._touching))
        self._touching = touching
        self.min_separation = min(self.min_separation, float(distance.min()))


def _advance(state: Array, length: Array, turn: Array) -> None:
    """Move poses (3, ...) along arcs of ``length`` [m] that turn by ``turn`` [rad], in place."""
    reach, cos, sin = chord(state[2], length, 0.5 * turn)
    state[0] += reach * cos
    state[1] += reach * sin
    state[2] = ARRAYS.wrap(state[2] + turn)


def _kinds(limits: WheelLimits | Sequence[WheelLimits] | None, n: int) -> Sequence[WheelLimits]:
    """The wheels of one kind of robot, or of each of many."""
    if limits is None:
        return [WheelLimits()]
    if isinstance(limits, WheelLimits):
        return [limits]
    if len(limits) != n:
        raise ValueError(f"{len(limits)} wheel limits for {n} robots: expected one, or one per robot")
    return limits
