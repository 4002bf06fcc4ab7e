"""Which sightings are believed: none outside the arena, and none that is farther than a robot can have driven."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from muro_zenoh.geometry import Bounds, Pose2, wrap_to_pi

_FASTER = 1.5
"""A robot may be faster than its settings say by this factor: wheels are not exact ..."""
_SLACK = 0.05
"""... and two cameras may see it this far apart [m] ..."""
_TURN_SLACK = 0.35
"""... and turned by this [rad]."""
_CARRIED = 1.0
"""A robot that was seen elsewhere for this time, and nowhere else, was carried there [s]."""
_FORGOTTEN = 0.5
"""A row of sightings elsewhere that is interrupted for this time begins anew [s]."""


@dataclass(frozen=True, slots=True)
class Reach:
    """How far a robot can get.

    Attributes:
        radius: of its body [m].
        v_max: its greatest speed [m/s].
        omega_max: its greatest turning rate [rad/s].
    """

    radius: float
    v_max: float
    omega_max: float


@dataclass(slots=True)
class _Elsewhere:
    """A row of sightings in another place: of which camera, where and when the last one was, and when the first."""

    camera: str
    pose: Pose2
    captured: float
    begin: float


class Belief:
    """Judges each sighting by what was believed before.

    A robot that is seen where it cannot have driven is not believed to be there: it may be the reflection of its tag,
    or another robot with the same print. Only when it is seen there for a second and nowhere else was it carried.

    Args:
        arena: the floor.
        robots: how far each can get, by name.
    """

    def __init__(self, arena: Bounds, robots: Mapping[str, Reach]) -> None:
        self._arena = arena
        self._robots = robots
        self._believed: dict[str, tuple[Pose2, float]] = {}
        self._elsewhere: dict[str, _Elsewhere] = {}

    def doubt(self, name: str, camera: str, pose: Pose2, captured: float) -> str:
        """Why a sighting is not believed; empty for one that is.

        Args:
            name: of the robot.
            camera: that sees it.
            pose: where it sees it [world].
            captured: when [s].
        """
        reach = self._robots[name]
        if not self.in_arena(name, pose):
            return f"camera {camera} sees {name} at {pose.x:.2f}, {pose.y:.2f} m, outside the arena"
        known = self._believed.get(name)
        if known is not None:
            before, t = known
            if not _can_reach(before, pose, captured - t, reach) and not self._was_carried(
                name, camera, pose, captured, t
            ):
                far, span = math.dist(before[:2], pose[:2]), abs(captured - t)
                return f"camera {camera} sees {name} {far:.2f} m from where it was {span:.2f} s before"
        if known is None or captured >= known[1]:
            self._believed[name] = pose, captured
        row = self._elsewhere.get(name)
        if row is not None and row.camera == camera:
            del self._elsewhere[name]
        return ""

    def in_arena(self, name: str, pose: Pose2) -> bool:
        """Whether a robot can be at a place at all.

        Args:
            name: of the robot.
            pose: where it is seen [world].
        """
        return self._arena.holds(pose.x, pose.y, self._robots[name].radius)

    def forget(self, name: str) -> None:
        """Believe the next sighting of a robot, wherever it is.

        Args:
            name: of the robot.
        """
        self._believed.pop(name, None)
        self._elsewhere.pop(name, None)

    def _was_carried(self, name: str, camera: str, pose: Pose2, captured: float, believed: float) -> bool:
        row = self._elsewhere.get(name)
        if (
            row is None
            or believed > row.begin  # seen in its old place meanwhile
            or captured - row.captured > _FORGOTTEN
            or not _can_reach(row.pose, pose, captured - row.captured, self._robots[name])
        ):
            if row is None or row.camera == camera or captured - row.captured > _FORGOTTEN:
                self._elsewhere[name] = _Elsewhere(camera, pose, captured, captured)
            return False
        row.pose, row.captured = pose, captured
        return captured - row.begin >= _CARRIED


def _can_reach(before: Pose2, pose: Pose2, span: float, reach: Reach) -> bool:
    time = _FASTER * abs(span)
    return (
        math.dist(before[:2], pose[:2]) <= _SLACK + reach.v_max * time
        and abs(wrap_to_pi(pose.theta - before.theta)) <= _TURN_SLACK + reach.omega_max * time
    )
