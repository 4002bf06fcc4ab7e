"""What one camera has seen of one robot lately, and where the robot is a moment later."""

from __future__ import annotations

import math
from collections import deque

from basestation.localization.sightings import Sighting
from muro_zenoh.geometry import Pose2, wrap_to_pi

_OLD = 0.3
"""A speed is measured between two sightings that are at most this far apart [s]."""
_BEFORE = 0.22
"""A camera that moves slowly is known by where the robots were heading this time before [s]."""


class Track:
    """One camera's sightings of one robot.

    Attributes:
        sighting: the newest one.
        captured: when its frame was captured [s].
        speed: velocity [m/s, world] and turning rate [rad/s] between the two newest ones; None after a single one.
    """

    __slots__ = ("_before", "_span", "captured", "sighting", "speed")

    def __init__(self, sighting: Sighting, captured: float) -> None:
        self.sighting = sighting
        self.captured = captured
        self.speed: tuple[float, float, float] | None = None
        self._span = 0.0
        self._before: deque[tuple[Pose2, float, tuple[float, float, float], float]] = deque(maxlen=16)

    def add(self, sighting: Sighting, captured: float, *, keep_speed: bool = False) -> None:
        """Take the next sighting.

        Args:
            sighting: the robot in a later frame.
            captured: when [s].
            keep_speed: whether the step from the last one is no motion of the robot, because the camera moved.
        """
        span = captured - self.captured
        if span > _OLD:
            self.speed = None
            self._before.clear()
        elif span > 0.0 and not keep_speed:
            (x0, y0, theta0), (x, y, theta) = self.sighting.pose, sighting.pose
            self.speed = ((x - x0) / span, (y - y0) / span, wrap_to_pi(theta - theta0) / span)
            self._span = span
        self.sighting, self.captured = sighting, captured
        if self.speed is not None:
            self._before.append((sighting.pose, captured, self.speed, self._span))

    def at(self, t: float) -> Pose2 | None:
        """Where the robot is at another time, with the same speed and turning rate; None while they are unknown.

        Args:
            t: time, shortly after (or before) the newest sighting [s].
        """
        if self.speed is None:
            return None
        return _ahead(self.sighting.pose, t - self.captured, self.speed, self._span)

    def foreseen(self, t: float) -> Pose2 | None:
        """Where the robot would be by how it drove about a quarter of a second before; None when that is not known.

        Args:
            t: time [s].
        """
        while len(self._before) > 1 and self._before[1][1] <= t - _BEFORE:
            self._before.popleft()
        if not self._before or not 0.5 * _BEFORE <= t - self._before[0][1] <= 1.5 * _BEFORE:
            return None
        pose, captured, speed, span = self._before[0]
        return _ahead(pose, t - captured, speed, span)


def _ahead(pose: Pose2, ahead: float, speed: tuple[float, float, float], span: float) -> Pose2:
    vx, vy, omega = speed
    # The measured velocity is the mean of the last step, half a step ago.
    turn = 0.5 * omega * (ahead + span)
    c, s = math.cos(turn), math.sin(turn)
    x, y, theta = pose
    return Pose2(x + ahead * (c * vx - s * vy), y + ahead * (s * vx + c * vy), wrap_to_pi(theta + ahead * omega))
