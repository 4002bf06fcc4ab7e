"""From what each camera sees to one fix per robot."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from basestation.localization.agreement import Agreement
from basestation.localization.belief import Belief, Reach
from basestation.localization.sightings import Sighting, Sightings
from basestation.localization.tracks import Track
from muro_zenoh.geometry import Bounds, Pose2, wrap_to_pi

_TOGETHER = 0.2
"""A sighting of another camera is used for this time [s]."""
_PERIOD = 0.05
"""The period of a camera of which only one frame was seen [s]."""
_OVERDUE = 1.6
"""A camera that leads is late when it has not seen the robot for so many of its periods."""
_QUICKER = 0.02
"""A camera whose frames arrive so much earlier takes the lead [s]."""
_BETTER = 0.3
"""A camera in whose picture a robot is so much farther inside takes the lead, of 1."""
_ACCELERATION = 0.2
"""What a robot does between two frames, unseen: typical, not the most [m/s^2]. A camera whose frames are older weighs
less by it; were that much, the fix would change with the age of the other camera's frame."""
_FAINT = 0.02
"""Least weight of a tag at the picture's edge: it counts for nothing beside a whole one."""
_CALIBRATION = 0.002
"""Standard deviation of a calibration's error [m]: without it the camera with the newest picture would outweigh the
others, and a robot would jump by the difference of their errors where another one takes the lead."""


class Fix(NamedTuple):
    """Where a robot is.

    Attributes:
        name: of the robot.
        pose: of its base frame [world].
        covariance: nine floats, row-major, of x [m], y [m], theta [rad].
        cameras: that saw it; first the one whose frame it is.
    """

    name: str
    pose: Pose2
    covariance: tuple[float, ...]
    cameras: tuple[str, ...]


class _Share(NamedTuple):
    camera: str
    pose: Pose2
    covariance: tuple[float, ...]
    weight: float


class Fusion:
    """Takes the sightings of all cameras as they come.

    Of the cameras that see a robot one leads, and its frames give the fixes; what the others see is moved on to the
    same time and weighs in. A camera's weight falls to nothing towards the edge of its picture, so that a robot that
    enters or leaves it does not jump.

    Args:
        arena: the floor.
        robots: how far each robot can get, by name.

    Attributes:
        doubts: by names of camera and robot, why the newest sighting that was not believed was not, and when its frame
            was captured [s].
        disbelieved: number of sightings that were not believed.
    """

    def __init__(self, arena: Bounds, robots: Mapping[str, Reach]) -> None:
        self.doubts: dict[tuple[str, str], tuple[str, float]] = {}
        self.disbelieved = 0
        self._belief = Belief(arena, robots)
        self._agreement = Agreement()
        self._now = -math.inf
        self._tracks: dict[str, dict[str, Track]] = {}
        self._leader: dict[str, str] = {}
        self._given: dict[str, float] = {}
        self._newest: dict[str, float] = {}
        self._period: dict[str, float] = {}
        self._delay: dict[str, float] = {}

    @property
    def moved(self) -> Mapping[str, str]:
        """Why a camera is trusted less, by its name."""
        return {camera: found.reason for camera, found in self._agreement.moved.items()}

    def take(self, seen: Sightings, now: float) -> list[Fix]:
        """The fixes that a frame gives.

        Args:
            seen: what a camera sees in a good frame; of one camera in the order of capture.
            now: when it has arrived [s].
        """
        camera, t = seen.camera, seen.captured
        if now < self._now:  # the clock was set back: what was given before must not keep out what is seen since
            for name in list(self._tracks):
                self.forget(name)
        self._now = now
        self._pace(camera, t, now)
        believed, elsewhere = [], []
        for sighting in seen.robots:
            if self._believe(sighting, camera, t):
                believed.append(sighting)
            elif self._belief.in_arena(sighting.name, sighting.pose):
                elsewhere.append(sighting)
        steps, long_steps = [], []
        for sighting in (*believed, *elsewhere):
            expected = self._expected(camera, sighting.name, t)
            if expected is not None:
                steps.append((sighting.pose.x - expected.x, sighting.pose.y - expected.y))
            track = self._tracks.get(sighting.name, {}).get(camera)
            foreseen = track.foreseen(t) if track is not None else None
            if foreseen is not None:
                long_steps.append((sighting.pose.x - foreseen.x, sighting.pose.y - foreseen.y))
        moved = self._agreement.jumped(camera, steps, t)
        self._agreement.drifted(camera, long_steps, t)
        fixes = []
        for sighting in believed:
            tracks = self._tracks.setdefault(sighting.name, {})
            if camera in tracks:
                tracks[camera].add(sighting, t, keep_speed=moved)
            else:
                tracks[camera] = Track(sighting, t)
            if self._leads(camera, sighting.name, t):
                fixes.append(self._fuse(camera, sighting.name, t))
        for sighting in elsewhere:
            self._compare_disbelieved(sighting, camera, t)
        self._agreement.see_floor(camera, seen.floor_off, t)
        self._agreement.judge(t)
        return fixes

    def forget(self, name: str) -> None:
        """Forget a robot.

        Args:
            name: of the robot.
        """
        self._belief.forget(name)
        self._tracks.pop(name, None)
        self._leader.pop(name, None)
        self._given.pop(name, None)

    def _pace(self, camera: str, t: float, now: float) -> None:
        """Measure a camera's period and delay."""
        self._delay[camera] = self._delay.get(camera, now - t) + 0.1 * (now - t - self._delay.get(camera, now - t))
        before = self._newest.get(camera)
        if before is not None and 0.0 < t - before < 1.0:
            old = self._period.get(camera, t - before)
            self._period[camera] = old + 0.1 * (t - before - old)
        self._newest[camera] = t

    def _believe(self, sighting: Sighting, camera: str, t: float) -> bool:
        name, moved = sighting.name, self._agreement.moved
        doubt = self._belief.doubt(name, camera, sighting.pose, t)
        if doubt and camera not in moved and self._leader.get(name) in moved:
            # Only the camera that was moved has seen it lately: what it says must not keep the good one out.
            self._belief.forget(name)
            self._tracks.pop(name, None)
            self._leader.pop(name)
            doubt = self._belief.doubt(name, camera, sighting.pose, t)
        if doubt:
            self.disbelieved += 1
            self.doubts[camera, sighting.name] = f"{doubt}: not believed", t
        return not doubt

    def _compare_disbelieved(self, sighting: Sighting, camera: str, t: float) -> None:
        """A camera that was moved far is not believed where another one sees its robots: that is how it is known."""
        for other, track in self._tracks.get(sighting.name, {}).items():
            there = track.at(t) if other != camera and abs(t - track.captured) <= _TOGETHER else None
            if there is not None:
                self._agreement.compare(camera, other, sighting.pose, there, t, robot=sighting.name, disbelieved=camera)

    def _expected(self, camera: str, name: str, t: float) -> Pose2 | None:
        """Where a camera would see a robot that goes on as before."""
        track = self._tracks.get(name, {}).get(camera)
        return track.at(t) if track is not None and 0.0 < t - track.captured < 2.5 * self._period_of(camera) else None

    def _leads(self, camera: str, name: str, t: float) -> bool:
        """Whether a camera's frames give the robot's fixes: the leader's do, until it does not see the robot, or
        another one sees it farther from its picture's edge, or well and earlier."""
        leader = self._leader.get(name)
        if leader is not None and leader != camera:
            track, own = self._tracks[name].get(leader), self._tracks[name][camera]
            if track is not None and t - track.captured < _OVERDUE * self._period_of(leader):
                better = own.sighting.inside > track.sighting.inside + _BETTER
                quicker = self._delay[camera] < self._delay[leader] - _QUICKER and own.sighting.inside > 0.5
                if not (better or quicker):
                    return False
        if t <= self._given.get(name, -math.inf):
            return False  # the leader's newest one is later
        self._leader[name] = camera
        self._given[name] = t
        return True

    def _fuse(self, camera: str, name: str, t: float) -> Fix:
        tracks = self._tracks[name]
        own = tracks[camera]
        shares = [_Share(camera, own.sighting.pose, own.sighting.covariance, self._weight(camera, own.sighting, 0.0))]
        for other, track in tracks.items():
            if other == camera or abs(t - track.captured) > _TOGETHER:
                continue
            moved_on = track.at(t) or _carried(track, own.speed, t)
            if moved_on is None:
                continue
            self._agreement.compare(camera, other, own.sighting.pose, moved_on, t, robot=name)
            spread = 0.5 * _ACCELERATION * (t - track.captured) ** 2
            shares.append(
                _Share(other, moved_on, track.sighting.covariance, self._weight(other, track.sighting, spread))
            )
        return Fix(name, *self._mean(shares), tuple(share.camera for share in shares))

    def _weight(self, camera: str, sighting: Sighting, spread: float) -> float:
        moved = self._agreement.moved.get(camera)
        distrust = moved.metres if moved is not None else 0.0
        noise = 0.5 * (sighting.covariance[0] + sighting.covariance[4])
        variance = noise + _CALIBRATION**2 + spread * spread + distrust * distrust
        return max(sighting.inside, _FAINT) / variance

    def _mean(self, shares: list[_Share]) -> tuple[Pose2, tuple[float, ...]]:
        total = sum(share.weight for share in shares)
        first = shares[0].pose
        x = y = turn = 0.0
        covariance = [0.0] * 9
        for camera, pose, spread, weight in shares:
            part = weight / total
            x, y = x + part * pose.x, y + part * pose.y
            turn += part * wrap_to_pi(pose.theta - first.theta)
            square = part * part
            covariance = [known + square * entry for known, entry in zip(covariance, spread, strict=True)]
            moved = self._agreement.moved.get(camera)
            if moved is not None:  # what it is off by is no noise of the corners
                covariance[0] += square * moved.metres**2
                covariance[4] += square * moved.metres**2
                covariance[8] += square * moved.radians**2
        return Pose2(x, y, wrap_to_pi(first.theta + turn)), tuple(covariance)

    def _period_of(self, camera: str) -> float:
        return self._period.get(camera, _PERIOD)


def _carried(track: Track, speed: tuple[float, float, float] | None, t: float) -> Pose2 | None:
    """A single sighting of one camera, moved on with the speed that another one has measured."""
    if speed is None:
        return None
    vx, vy, omega = speed
    ahead = t - track.captured
    x, y, theta = track.sighting.pose
    return Pose2(x + ahead * vx, y + ahead * vy, wrap_to_pi(theta + ahead * omega))
