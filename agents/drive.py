"""From the twist that a behaviour wants to the command: limits, separation, calibration.

The limits come first and belong to this robot's wheels as they are: the separation filter passes a path, and what
changed the command after it would drive another one. What is left for after it is the calibration, which is exact.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from muro_zenoh.behaviours.interface import Snapshot
from muro_zenoh.config import RobotSettings
from muro_zenoh.estimation.pose_filter import PoseEstimate
from muro_zenoh.geometry import STILL, State, Twist2
from muro_zenoh.safety.limits import calibrate_and_limit, limit
from muro_zenoh.safety.separation import Separation

OFF = "the separation filter is off"

_MOST_REASONS = 256
"""Reasons that are counted at most: a stranger with ever new names must not fill the memory."""


class Drive:
    """The last stretch of one robot's control loop.

    Args:
        robot: its settings.
        separation: keeps it clear of the others; None where it is off.

    Attributes:
        changes: number of commands that the separation filter changed since the start, by reason.
        note: why the robot drives otherwise than its behaviour wants: the newest reason; the health report clears it.
    """

    def __init__(self, robot: RobotSettings, separation: Separation | None) -> None:
        self.changes: Counter[str] = Counter()
        self.note = ""
        self._robot = robot
        self._body = robot.body
        self._separation = separation

    @property
    def needs_positions(self) -> bool:
        """Whether it drives only while it knows where all robots are."""
        return self._separation is not None

    def take_note(self) -> str:
        """The note, which is cleared; where the filter is off, that."""
        note, self.note = self.note, ""
        return note if self._separation is not None else OFF

    def learn(self, now: float, snapshots: Iterable[Snapshot]) -> None:
        """Take snapshots that are not the newest any more: others keep apart by them.

        Args:
            now: the time [s].
            snapshots: all robots, at one time each.
        """
        if self._separation is not None:
            for snapshot in snapshots:
                self._separation.learn(now, snapshot)

    def command(
        self,
        now: float,
        estimate: PoseEstimate,
        desired: Twist2 | None,
        snapshot: Snapshot | None,
        target: tuple[float, float] | None,
    ) -> Twist2:
        """The command now.

        Args:
            now: the time [s].
            estimate: where the robot is now, how fast, and its drive scales.
            desired: the desired twist of the body [m/s, rad/s]; None when it must not move: the command is then zero,
                whatever the filter would like.
            snapshot: all robots; None when there is none or it is stale.
            target: where the behaviour is heading, x, y [m, world]; None when it has no such place.
        """
        # The wheels do scale times what they are commanded: so are the limits of what this robot does.
        s_v, s_omega, body = estimate.s_v, estimate.s_omega, self._body
        body = body.scaled(s_v, s_omega)
        if desired is not None:
            desired = limit(desired, v_max=body.v_max, omega_max=body.omega_max)
        twist = desired
        if self._separation is not None:
            state = State(estimate.x, estimate.y, estimate.theta, estimate.v, estimate.omega)
            twist, reason = self._separation.step(now, state, desired, snapshot, target, body)
            if reason:
                self.note = reason
                if reason in self.changes or len(self.changes) < _MOST_REASONS:
                    self.changes[reason] += 1
        if desired is None or twist is None:
            return STILL
        return calibrate_and_limit(
            twist,
            cal_v=1.0 / s_v,
            cal_omega=1.0 / s_omega,
            v_max=self._robot.v_max,
            omega_max=self._robot.omega_max,
        )
