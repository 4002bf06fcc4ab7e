"""The health reports of processes, accumulated over a run and over restarts. No bus."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TypeVar

from muro_zenoh.messages import Health

T = TypeVar("T")


_MAX_MEASUREMENTS = 1_000_000
"""Number of measurements kept: of thirty robots with a camera at 20 Hz the last half hour."""


def keep_newest(items: list[T], most: int) -> None:
    """Drop the oldest items when a list has grown to twice its limit.

    Args:
        items: the list.
        most: how many items to keep.
    """
    if len(items) >= 2 * most:
        del items[:-most]


@dataclass(slots=True)
class FixCount:
    """The fixes that one agent has reported since scenario time began.

    Attributes:
        epoch: epoch of the newest report.
        last_fixes: number of fixes in it [-].
        first_stamp: when counting began [s].
        last_stamp: stamp of the newest report; 0 before the second one [s].
        fixes: fixes counted since ``first_stamp`` [-].
    """

    epoch: int
    last_fixes: float
    first_stamp: float
    last_stamp: float = 0.0
    fixes: float = 0.0

    def add(self, health: Health) -> None:
        """Add the difference to the previous report; a restarted process counts from zero.

        Args:
            health: the report.
        """
        fixes = health.numbers.get("fixes", 0.0)
        if health.epoch != self.epoch:
            self.epoch, self.last_fixes = health.epoch, 0.0
        self.fixes += max(0.0, fixes - self.last_fixes)
        self.last_fixes, self.last_stamp = fixes, health.stamp

    @property
    def rate(self) -> float | None:
        """Fixes per second [Hz]; None before the second report."""
        if self.last_stamp <= self.first_stamp:
            return None
        return self.fixes / (self.last_stamp - self.first_stamp)


class AgentReports:
    """The reports of the agents since scenario time began.

    Attributes:
        pose_age: for each pose, the time from capture to the estimate that used it [s].
        pose_to_command: for each pose, the time from its arrival to the command that used it [s].
    """

    def __init__(self) -> None:
        self.pose_age: list[float] = []
        self.pose_to_command: list[float] = []
        self._fixes: dict[str, FixCount] = {}
        self._first_epochs: dict[str, int] = {}
        self._began = 0.0

    def begin(self, now: float, epochs: dict[str, int]) -> None:
        """Begin scenario time.

        Args:
            now: the time [s].
            epochs: epochs of the processes that have reported already, by name.
        """
        self._began, self._first_epochs = now, epochs

    def add(self, name: str, health: Health) -> None:
        """Add a report.

        Args:
            name: of the process.
            health: the report.
        """
        count = self._fixes.get(name)
        if count is None:
            first_epoch = self._first_epochs.get(name, health.epoch)
            if first_epoch == health.epoch:
                # It covers time before the beginning, so it only marks where counting begins.
                self._fixes[name] = FixCount(health.epoch, health.numbers.get("fixes", 0.0), health.stamp)
                return
            # The process was restarted after the beginning: the whole report counts.
            count = self._fixes[name] = FixCount(first_epoch, 0.0, self._began)
        count.add(health)
        for key, collected in (("pose_age_s", self.pose_age), ("pose_to_command_s", self.pose_to_command)):
            collected += health.samples.get(key, ())
            keep_newest(collected, _MAX_MEASUREMENTS)

    def fix_rate(self, name: str) -> float | None:
        """Reported accepted fixes per second of scenario time [Hz].

        Args:
            name: of the robot.
        """
        count = self._fixes.get(name)
        return count.rate if count is not None else None


@dataclass(slots=True)
class SimulatorReports:
    """The reports of the simulator, over all its restarts; each restart begins its counts at zero.

    Attributes:
        min_separation: smallest distance between two robots' centres [m]; None before the first report of one.
        scales: the hidden drive errors, by ``scale_v_<robot>`` and ``scale_omega_<robot>``.
    """

    min_separation: float | None = None
    scales: dict[str, float] = field(default_factory=dict)
    _epoch: int | None = None
    _before: Counter[str] = field(default_factory=Counter)
    _now: Counter[str] = field(default_factory=Counter)

    @property
    def collisions(self) -> int | None:
        """Episodes of two robots touching; None before the first report."""
        return self._counted("collisions")

    @property
    def wall_contacts(self) -> int | None:
        """Episodes of a robot touching a wall; None before the first report."""
        return self._counted("wall_contacts")

    def _counted(self, key: str) -> int | None:
        return self._before[key] + self._now[key] if self._epoch is not None else None

    def add(self, health: Health) -> None:
        """Add a report.

        Args:
            health: the report.
        """
        if health.epoch != self._epoch:
            self._epoch, self._before = health.epoch, self._before + self._now
        self._now = Counter({key: int(health.numbers.get(key, 0.0)) for key in ("collisions", "wall_contacts")})
        separation = health.numbers.get("min_separation_m")
        if separation is not None:
            before = self.min_separation
            self.min_separation = separation if before is None else min(before, separation)
        self.scales = {key: value for key, value in health.numbers.items() if key.startswith("scale_")}
