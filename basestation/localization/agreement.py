"""Whether the cameras still are where they were calibrated: by what two of them see of the same robot."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from statistics import median
from typing import NamedTuple

from muro_zenoh.geometry import Pose2, wrap_to_pi

_WINDOW = 1.5
"""Cameras are compared over this time [s] ..."""
_LEAST = 12
"""... and at least so many sightings."""
_APART = 0.006
"""Two cameras that see the robots this far apart disagree [m]; calibrated ones are within 1 to 3 mm."""
_TURNED = math.radians(1.0)
"""The same for the headings [rad]: the median of twelve of them is uncertain by a tenth of a degree, and more where
their errors go together."""
_LEAST_ON_FLOOR = 4
"""Tags on the floor count from so many sightings on: they are seen in whole pictures only, twice a second."""
_JUMP = 0.005
"""All robots of a camera jump by this from one frame to the next: the camera moved [m]. Their brakes allow 2.5 mm."""
_JUMP_ALONE = 0.008
"""The same for a camera that sees a single robot [m]."""
_SPREAD = 0.008
"""At least three robots of a camera are off by this, all the same way, from where they were heading a quarter of a
second before: the camera moved slowly [m]."""
_LEAST_SPREAD = 3
_BEFORE = 2.0
"""A jump counts when it was at most this long before the cameras were last seen to agree [s]: that is found from what
both have seen for a while, and so it is late."""
_EXPLAINED = 0.5
"""A jump is why two cameras disagree when it differs from that by at most this part of it."""
_FAR = 0.6
"""Farther off than this is no camera that was moved, but another print or a reflection [m]: 11 degrees at 3 m."""
_LEAST_ERROR = (0.01, math.radians(0.3))
"""Standard deviation of what a camera sees that was moved, at least [m, rad]."""


class Moved(NamedTuple):
    """A camera that was moved.

    Attributes:
        reason: how that is known, for the operator.
        metres: standard deviation of the places that it sees [m].
        radians: that of the headings [rad].
    """

    reason: str
    metres: float
    radians: float


class _Apart(NamedTuple):
    """What two cameras see of a robot: the time, the second's sighting less the first's, and whose place was not
    believed, because it was too far from the other's; empty for none."""

    t: float
    x: float
    y: float
    theta: float
    robot: str
    disbelieved: str


class Agreement:
    """Finds out which camera was moved.

    One that sees the tags on the floor away from their places was. Of two cameras that disagree about the robots that
    both see, the one was whose robots all jumped at once; when neither's did, it may be either.

    Attributes:
        moved: the cameras that are trusted less, by name.
    """

    def __init__(self) -> None:
        self.moved: dict[str, Moved] = {}
        self._apart: dict[tuple[str, str], deque[_Apart]] = {}
        self._floor: dict[str, deque[tuple[float, float, float]]] = {}
        self._jumped: dict[str, tuple[float, float, float]] = {}
        self._drifted: dict[str, deque[tuple[float, float, float]]] = {}
        self._agreed: dict[tuple[str, str], float] = {}
        self._since: dict[tuple[str, str], float] = {}
        self._just_jumped: set[str] = set()

    def compare(
        self, first: str, second: str, a: Pose2, b: Pose2, t: float, *, robot: str = "", disbelieved: str = ""
    ) -> None:
        """Take what two cameras see of one robot at one time.

        Args:
            first: name of a camera.
            second: name of another one.
            a: where the first sees the robot [world].
            b: where the second does.
            t: when [s].
            robot: its name.
            disbelieved: which of the cameras is not believed, because the other one sees the robot elsewhere; one that
                is far off may see another print, or a reflection.
        """
        if disbelieved and math.dist(a[:2], b[:2]) > _FAR:
            return
        if first > second:
            first, second, a, b = second, first, b, a
        row = self._apart.setdefault((first, second), deque(maxlen=400))
        row.append(_Apart(t, b.x - a.x, b.y - a.y, wrap_to_pi(b.theta - a.theta), robot, disbelieved))

    def see_floor(self, camera: str, off: Sequence[tuple[float, float]], t: float) -> None:
        """Take where a camera sees the tags on the floor.

        Args:
            camera: its name.
            off: how far each is from its place (x, y) [m].
            t: when [s].
        """
        if off:
            self._floor.setdefault(camera, deque(maxlen=400)).extend((t, x, y) for x, y in off)

    def jumped(self, camera: str, steps: Sequence[tuple[float, float]], t: float) -> bool:
        """Whether all robots of a camera have jumped at once: then it was the camera that moved.

        Two frames running are no jump: the robots really have other speeds now.

        Args:
            camera: its name.
            steps: of each robot from where its speed took it to where it was seen [m].
            t: when [s].
        """
        again = camera in self._just_jumped
        self._just_jumped.discard(camera)
        steps = [step for step in steps if math.hypot(*step) <= _FAR]
        if again or not steps:
            return False
        way = _common(steps, _JUMP_ALONE if len(steps) == 1 else _JUMP)
        if way is None:
            return False
        self._jumped[camera] = t, *way
        self._just_jumped.add(camera)
        return True

    def drifted(self, camera: str, steps: Sequence[tuple[float, float]], t: float) -> None:
        """Take whether all robots of a camera went off the same way: then it was the camera that moved, if slowly.

        Robots that all brake together do so too, but then another camera sees it as well.

        Args:
            camera: its name.
            steps: of each robot from where its speed of a quarter of a second before took it to where it was seen [m].
            t: when [s].
        """
        steps = [step for step in steps if math.hypot(*step) <= _FAR]
        way = _common(steps, _SPREAD) if len(steps) >= _LEAST_SPREAD else None
        if way is not None:
            self._drifted.setdefault(camera, deque(maxlen=64)).append((t, *way))

    def judge(self, now: float) -> None:
        """Decide anew which cameras were moved.

        Args:
            now: the time [s].
        """
        moved: dict[str, Moved] = {}
        seen: set[str] = set()
        for camera, tags in self._floor.items():
            while tags and tags[0][0] < now - _WINDOW:
                tags.popleft()
            if len(tags) < _LEAST_ON_FLOOR:
                continue
            seen.add(camera)
            off_by = sorted(math.hypot(x, y) for _, x, y in tags)
            # More than half of them: a tag that was kicked away is no camera that was moved, even if it is one of two.
            far = off_by[(len(off_by) - 1) // 2]
            if far >= _APART:
                moved[camera] = _moved(f"camera {camera} sees the floor tags {1e3 * far:.0f} mm off their places", far)
        on_floor = set(moved)
        for (first, second), row in self._apart.items():
            while row and row[0].t < now - _WINDOW:
                row.popleft()
            if len(row) < _LEAST:
                continue
            x, y, theta = median(e.x for e in row), median(e.y for e in row), median(e.theta for e in row)
            far = math.hypot(x, y)
            if far < _APART and abs(theta) < _TURNED:
                seen |= {first, second}
                self._agreed[first, second] = now
                self._since.pop((first, second), None)
                continue
            jumped = self._who_jumped(first, second, (x, y), self._since.get((first, second), now))
            odd = {entry.robot for entry in row if entry.disbelieved}
            if len(odd) == 1 and 2 * sum(bool(entry.disbelieved) for entry in row) > len(row) and not jumped:
                continue  # a second print of one robot's tag is no camera that was moved
            seen |= {first, second}
            self._since.setdefault((first, second), now)
            if on_floor & {first, second}:
                continue  # it is known which one it was
            off = f"{1e3 * far:.0f} mm and {math.degrees(abs(theta)):.1f} degrees"
            for camera in jumped or (first, second):
                other = second if camera == first else first
                moved[camera] = _moved(f"camera {camera} is {off} off camera {other}", far, abs(theta))
        # Without robots in the overlap nothing is known: what was found stays.
        self.moved = {**{name: found for name, found in self.moved.items() if name not in seen}, **moved}

    def _who_jumped(self, first: str, second: str, apart: tuple[float, float], until: float) -> tuple[str, ...]:
        """Which of two cameras that disagree has jumped since they agreed, or as far as is known.

        Of two that have, and of those that moved slowly, the one that went as far as they are apart: robots that all
        turn or brake the same way look much like a camera that moves.
        """
        since = self._agreed.get((first, second), -math.inf) - _BEFORE

        def explains(camera: str, jump: tuple[float, float, float]) -> bool:
            t, dx, dy = jump
            sign = -1.0 if camera == first else 1.0
            return since <= t <= until and math.dist((sign * dx, sign * dy), apart) <= _EXPLAINED * math.hypot(*apart)

        both = (first, second)
        jumped = [camera for camera in both if camera in self._jumped and since <= self._jumped[camera][0] <= until]
        if jumped:
            explained = [camera for camera in jumped if explains(camera, self._jumped[camera])]
            return tuple(jumped if len(jumped) == 1 else explained)
        return tuple(camera for camera in both if any(explains(camera, way) for way in self._drifted.get(camera, ())))


def _common(steps: Sequence[tuple[float, float]], least: float) -> tuple[float, float] | None:
    """The way that all robots went, when it is the same one and at least so long [m]."""
    dx, dy = median(step[0] for step in steps), median(step[1] for step in steps)
    off = [math.hypot(x - dx, y - dy) for x, y in steps]
    return (dx, dy) if math.hypot(dx, dy) >= least and median(off) <= 0.5 * math.hypot(dx, dy) else None


def _moved(how: str, metres: float, radians: float = 0.0) -> Moved:
    least_metres, least_radians = _LEAST_ERROR
    reason = f"{how}: was it moved? Calibrate it anew"
    return Moved(reason, max(metres, least_metres), max(radians, least_radians))
