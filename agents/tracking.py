"""What is known of where one robot is: fixes and odometry into the pose filter, refusing what cannot be true."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterable

from muro_zenoh import channels
from muro_zenoh.config import RobotSettings
from muro_zenoh.estimation.filter_settings import FilterSettings
from muro_zenoh.estimation.pose_filter import PoseFilter
from muro_zenoh.messages import PoseFix

log = logging.getLogger(__name__)

_FASTEST = 4.0
"""Odometry faster than this multiple of the robot's limits is invalid."""


class Tracking:
    """The pose filter of one robot, and what it may be given. All times are from one local clock [s].

    Args:
        robot: its settings.
        command_timeout: when its base gives up a command [s].

    Attributes:
        filter: the pose filter.
        fixes: number of accepted fixes since the start.
        refused: number of fixes and odometry messages that were refused since the start, by reason.
        pose_ages: for each accepted fix, the time from capture to the estimate that used it [s]; the health report
            clears it.
    """

    def __init__(self, robot: RobotSettings, command_timeout: float) -> None:
        self._settings = FilterSettings(odometry_timeout=channels.ODOMETRY.stale_after, command_timeout=command_timeout)
        self.filter = PoseFilter(self._settings, robot.wheels)
        self.fixes = 0
        self.refused: Counter[str] = Counter()
        self.pose_ages: list[float] = []
        self._robot = robot

    def forget(self) -> None:
        """Begin anew, with an empty filter."""
        self.filter = PoseFilter(self._settings, self._robot.wheels)

    def take(
        self, now: float, fixes: Iterable[tuple[float, PoseFix]], odometry: Iterable[tuple[float, float, float]]
    ) -> None:
        """Take what was measured.

        Args:
            now: the time.
            fixes: new fixes, each with its time of capture.
            odometry: new rows t [s], v [m/s], omega [rad/s], in order.
        """
        for t, v, omega in odometry:
            if self._is_possible(now, t, v, omega):
                self.filter.twist(t, v, omega)
            else:
                self.refused["odometry"] += 1
        for captured, fix in fixes:
            self._fix(now, captured, fix)

    def _fix(self, now: float, captured: float, fix: PoseFix) -> None:
        if not now - self._settings.history <= captured <= now:
            self.refused["fix untimely"] += 1
            return
        result = self.filter.fix(captured, fix.x, fix.y, fix.theta, fix.covariance)
        if result.accepted:
            self.fixes += 1
            self.pose_ages.append(now - captured)
        else:
            self.refused[f"fix {result.reason}"] += 1
        if result.restarted:
            log.warning("the fixes disagree with the track: restarting the filter at (%.2f, %.2f)", fix.x, fix.y)

    def _is_possible(self, now: float, t: float, v: float, omega: float) -> bool:
        """Whether odometry has a recent time and speeds that these wheels could have."""
        return (
            now - self._settings.history <= t <= now
            and abs(v) <= _FASTEST * self._robot.v_max
            and abs(omega) <= _FASTEST * self._robot.omega_max
        )
