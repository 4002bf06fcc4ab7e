"""The table of all positions, keyed by what the cameras see."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from basestation.fleet.doubts import Doubts
from muro_zenoh import channels
from muro_zenoh.config import TIMEOUTS
from muro_zenoh.geometry import Pose2, wrap_to_pi
from muro_zenoh.messages import RobotState, RobotStatus

STALE_AFTER = TIMEOUTS.pose
"""A robot not seen for longer than this is ``stale``, unless the settings have another [s]; then it stands still ..."""

LOST_AFTER = 2.0
"""... and for longer than this ``lost`` [s]. It stays where it was until it is seen again or cleared by an operator."""

SILENT_AFTER = 0.6
"""The last speeds of a robot that says nothing any more count for this time [s], on its way to the dead-man. One whose
own link outward alone is cut off may still drive after it: it is ``silent``, which makes it brake, too, and the others
keep clear of it."""

_DISTANCE = 0.25
_ANGLE = 0.6
"""An estimate agrees with the fix when it is within this of it [m], [rad], plus how far the robot moved since."""


class Motion(NamedTuple):
    """A robot's own estimate: its pose [world], its speeds [m/s, rad/s], and when the estimate was made [s]."""

    pose: Pose2
    v: float
    omega: float
    arrival: float


@dataclass(slots=True)
class _Row:
    pose: Pose2
    captured: float
    motion: Motion | None = None


class FleetTable:
    """Where every robot was last seen. Times are of one local clock [s].

    Place and age come from the newest fix; the agent's estimate adds v and omega, and only while it agrees with it.

    Args:
        stale_after: a robot not seen for longer than this is ``stale`` [s].
    """

    def __init__(self, stale_after: float = STALE_AFTER) -> None:
        self._stale_after = stale_after
        self._rows: dict[str, _Row] = {}
        self._motions: dict[str, Motion] = {}
        self._doubts = Doubts()
        self._now = -math.inf

    def fix(self, name: str, pose: Pose2, captured: float) -> None:
        """Take what a camera saw.

        Args:
            name: of the robot.
            pose: where [world].
            captured: when the picture was taken [s]; an older one than known changes nothing.
        """
        row = self._rows.get(name)
        if row is None or captured >= row.captured:
            self._rows[name] = _Row(pose, captured)
            self._doubts.saw(name, pose, captured)

    def estimate(self, name: str, motion: Motion) -> None:
        """Take a robot's own estimate; of one that no camera has seen it is not kept, whoever sends it.

        Args:
            name: of the robot.
            motion: the estimate.
        """
        if name not in self._rows:
            return
        self._motions[name] = motion
        self._doubts.said(name, motion.v, motion.omega, motion.arrival)

    def clear(self, name: str) -> bool:
        """Forget where a robot was last seen.

        Args:
            name: of the robot.

        Returns:
            Whether it was known.
        """
        self._motions.pop(name, None)
        self._doubts.forget(name)
        return self._rows.pop(name, None) is not None

    def knows(self, name: str) -> bool:
        """Whether a robot was ever seen, since it was last forgotten.

        Args:
            name: of the robot.
        """
        return name in self._rows

    def doubts(self, now: float) -> dict[str, str]:
        """The robots that are seen, but not where and not moving as they say; each with what is wrong, in words.

        Args:
            now: the time to which ages are counted [s].
        """
        self._note_time(now)
        found = {}
        for name, row in self._rows.items():
            motion = self._motions.get(name)
            if motion is None or now - max(motion.arrival, row.captured) > channels.ESTIMATE.stale_after:
                continue
            if not _agree(row, motion):
                apart = math.hypot(motion.pose.x - row.pose.x, motion.pose.y - row.pose.y)
                turned = math.degrees(abs(wrap_to_pi(motion.pose.theta - row.pose.theta)))
                found[name] = f"{name} is not where it says ({apart:.2f} m and {turned:.0f} degrees off)"
            elif doubt := self._doubts.of(name):
                found[name] = doubt
        return found

    def snapshot(self, now: float) -> tuple[RobotState, ...]:
        """All robots that were ever seen, by name.

        Args:
            now: the time to which ages are counted [s].
        """
        self._note_time(now)
        return tuple(self._state(name, row, now) for name, row in sorted(self._rows.items()))

    def _note_time(self, now: float) -> None:
        """When the clock was set back, nobody knows how old what is known is: all robots are lost until seen again."""
        if now < self._now:
            for row in self._rows.values():
                row.captured = now - 2.0 * LOST_AFTER
            self._motions.clear()
            self._doubts = Doubts()
        self._now = now

    def _state(self, name: str, row: _Row, now: float) -> RobotState:
        age = max(0.0, now - row.captured)
        motion = self._motions.get(name)
        v = omega = 0.0
        state: RobotStatus = "silent"
        if motion is not None and now - motion.arrival <= SILENT_AFTER:
            if _agree(row, motion):
                state, v, omega = "tracking", motion.v, motion.omega
            else:
                state = "disagrees"
        if age > self._stale_after:
            state = "lost" if age > LOST_AFTER else "stale"
            v = omega = 0.0
        return RobotState(name, row.pose.x, row.pose.y, row.pose.theta, v, omega, age, state)


def _agree(row: _Row, motion: Motion) -> bool:
    """Whether the estimate, taken back to the fix's time, is where the fix is."""
    since = motion.arrival - row.captured
    driven = abs(motion.v * since)
    apart = math.hypot(motion.pose.x - row.pose.x, motion.pose.y - row.pose.y)
    turned = abs(wrap_to_pi(motion.pose.theta - row.pose.theta))
    return apart <= _DISTANCE + driven and turned <= _ANGLE + abs(motion.omega * since)
