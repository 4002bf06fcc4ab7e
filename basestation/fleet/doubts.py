"""Which robots are not what they say: the cameras see them elsewhere, or moving otherwise, than they report.

Such a robot is carried by somebody, lies about its estimate, or has lost itself. It is named to operators. One that is
far from where it says is an obstacle to the others, too: :mod:`basestation.fleet.table`.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

from muro_zenoh.geometry import Pose2, wrap_to_pi

WINDOW: Final = 0.4
"""Its movement is compared over this time [s]."""

DISTANCE: Final = 0.12
"""It may move otherwise than it says by this within the window [m]: an uncalibrated drive at 0.5 m/s gives 0.04 m."""

TURN: Final = 0.5
"""The same of its heading [rad]."""

_DISTANCE_STILL: Final = 0.05
_TURN_STILL: Final = 0.2
"""The same of a robot that says that it stands [m], [rad]: nobody carries one so slowly that it is not noticed."""

_SHARE: Final = 0.7
"""One that drives may be off by this part of its way more, up to the limits above."""

_GAP: Final = 0.15
"""Estimates further apart than this say nothing of what was between them [s]."""


@dataclass(slots=True)
class _Seen:
    """What was seen of one robot, and what it said, within the window: times [s]."""

    poses: deque[tuple[float, Pose2]] = field(default_factory=deque)
    speeds: deque[tuple[float, float, float]] = field(default_factory=deque)


class Doubts:
    """Compares what robots say of their movement with what the cameras see. Times are of one local clock [s]."""

    def __init__(self) -> None:
        self._robots: dict[str, _Seen] = {}

    def saw(self, name: str, pose: Pose2, captured: float) -> None:
        """Take what a camera saw.

        Args:
            name: of the robot.
            pose: where [world].
            captured: when the picture was taken [s].
        """
        poses = self._robots.setdefault(name, _Seen()).poses
        if not poses or captured > poses[-1][0]:
            poses.append((captured, pose))
            while len(poses) > 2 and poses[1][0] <= captured - WINDOW:
                poses.popleft()

    def said(self, name: str, v: float, omega: float, when: float) -> None:
        """Take what a robot said of its speeds.

        Args:
            name: of the robot.
            v: its speed [m/s].
            omega: its turning rate [rad/s].
            when: when it was so [s].
        """
        speeds = self._robots.setdefault(name, _Seen()).speeds
        if not speeds or when > speeds[-1][0]:
            speeds.append((when, v, omega))
            while len(speeds) > 2 and speeds[1][0] <= when - 2.0 * WINDOW:
                speeds.popleft()

    def forget(self, name: str) -> None:
        """Forget a robot.

        Args:
            name: of the robot.
        """
        self._robots.pop(name, None)

    def of(self, name: str) -> str:
        """Why a robot does not move as it says; empty when it does, or when too little is known.

        Args:
            name: of the robot.
        """
        seen = self._robots.get(name)
        if seen is None or len(seen.poses) < 2:
            return ""
        (begin, start), (end, pose) = seen.poses[0], seen.poses[-1]
        if not 0.5 * WINDOW <= end - begin <= 2.0 * WINDOW:
            return ""
        path = _path(seen.speeds, start, begin, end)
        if path is None:
            return ""
        there, driven, turned = path
        off, askew = math.hypot(pose.x - there.x, pose.y - there.y), abs(wrap_to_pi(pose.theta - there.theta))
        if off > min(DISTANCE, _DISTANCE_STILL + _SHARE * driven) or askew > min(TURN, _TURN_STILL + _SHARE * turned):
            return f"{name} does not move as it says ({off:.2f} m off within {end - begin:.1f} s)"
        return ""


def _path(
    speeds: deque[tuple[float, float, float]], start: Pose2, begin: float, end: float
) -> tuple[Pose2, float, float] | None:
    """Where a robot would be if it moved as it says, how far it drove [m] and turned [rad]; None when it has said
    nothing for a part of the time."""
    x, y, theta = start
    now, driven, turned = begin, 0.0, 0.0
    if not speeds or speeds[0][0] > begin + _GAP or speeds[-1][0] < end - _GAP:
        return None
    for (when, v, omega), (until, _, _) in pairwise((*speeds, (end, 0.0, 0.0))):
        if until - when > 2.0 * _GAP:
            return None
        step = (until if until < end else end) - now
        if step <= 0.0:
            continue
        middle = theta + 0.5 * omega * step
        x, y, theta = x + v * step * math.cos(middle), y + v * step * math.sin(middle), theta + omega * step
        now, driven, turned = now + step, driven + abs(v) * step, turned + abs(omega) * step
    return Pose2(x, y, wrap_to_pi(theta)), driven, turned
