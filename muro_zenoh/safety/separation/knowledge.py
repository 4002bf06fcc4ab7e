"""What one robot knows of the fleet: the lines of the snapshots that it received, and where the others are now."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Final, NamedTuple

from muro_zenoh.safety.separation.body import Body, RobotSeen, SharedSnapshot
from muro_zenoh.safety.separation.guidance import Near
from muro_zenoh.safety.separation.line import LEAST_NEED, Line, Point, Stretch, line_between, nearest_on
from muro_zenoh.safety.separation.path import stopping_distance
from muro_zenoh.safety.separation.reach import travel_toward
from muro_zenoh.safety.separation.settings import SeparationSettings
from muro_zenoh.walls import Wall

WALL: Final = "the wall"
_KEEPS_APART: Final = ("tracking", "silent")
"""States of a robot that obeys the lines: a silent one still drives by them until it hears that it is silent."""
_STOPS: Final = "stale"
"""The state of one that obeys those of before, and stops: it has no fresh pose."""

GAP: Final = 0.3
"""After a gap of this length in the snapshots a robot listens before it drives [s]: it may have missed those that the
others obey."""
_OLDEST_ROW: Final = 0.25
_TOGETHER: Final = 6
"""Snapshots whose lines are looked at together."""


class Obstacle(NamedTuple):
    """What does not keep apart by itself: a segment from (``x``, ``y``) by (``dx``, ``dy``) [m, world], the distance to
    ``keep`` from it [m], and its ``name``."""

    x: float
    y: float
    dx: float
    dy: float
    keep: float
    name: str


class _Received:
    """A snapshot: when it was sent [s, local clock], its stamp, epoch and rows, and the lines that were needed."""

    __slots__ = ("epoch", "lines", "mine", "rows", "sent", "stamp")

    def __init__(
        self, sent: float, stamp: float, epoch: int, mine: Stretch | None, rows: Mapping[str, RobotSeen]
    ) -> None:
        self.sent, self.stamp, self.epoch, self.mine, self.rows = sent, stamp, epoch, mine, rows
        self.lines: dict[str, Line | None] = {}


class _Mate(NamedTuple):
    """A robot of the fleet: its ``body``, the distance of the centres to ``keep`` [m], and the ``part`` of the free
    floor between it and this robot that their line leaves at least."""

    body: Body
    keep: float
    part: float


class Knowledge:
    """What one robot knows.

    Args:
        name: the robot's name.
        body: its size and limits.
        others: bodies by name.
        settings: how to keep apart.
        walls: walls inside the arena.
    """

    def __init__(
        self,
        name: str,
        body: Body,
        others: Mapping[str, Body],
        settings: SeparationSettings,
        walls: Sequence[Wall] = (),
    ) -> None:
        self._name, self._body, self._settings = name, body, settings
        self._largest = max((*others.values(), body), key=lambda known: known.radius)
        self._longest_stops = 2.0 * max(stopping_distance(known.v_max, known) for known in (*others.values(), body))
        keep = body.radius + settings.wall_margin
        self.walls = tuple(Obstacle(x, y, x_end - x, y_end - y, keep, WALL) for x, y, x_end, y_end in walls)
        self._received: deque[_Received] = deque()
        self._unseen: dict[str, RobotSeen] = {}  # where robots were that this base station has not seen yet
        self._half_margin = 0.5 * settings.margin
        self._listening_since = math.inf
        self._now = -math.inf
        self._me: RobotSeen | None = None
        own = body.radius + settings.margin
        self._mates = {
            other: _Mate(known, own + known.radius, LEAST_NEED / (2.0 * LEAST_NEED + known.v_max))
            for other, known in others.items()
        }
        self._tracked: list[tuple[RobotSeen, _Mate, float]] = []  # with the speed to expect
        self._speeds: dict[str, tuple[float, float]] = {}  # v [m/s], omega [rad/s] when they were last known
        self.obstacles: tuple[Obstacle, ...] = ()
        """Robots that do not keep apart by themselves, or may drive otherwise than the newest snapshot says."""
        self._seen: list[tuple[RobotSeen, float, float]] = []
        self._sent = -math.inf  # the newest snapshot

    def learn(self, now: float, snapshot: SharedSnapshot | None) -> str:
        """Take the newest snapshot; one that is known already changes nothing.

        Args:
            now: the time [s].
            snapshot: all robots; None when there is none.

        Returns:
            Why the robot must not drive on what it knows; empty when it may.
        """
        if now < self._now:  # the clock was set back: nobody knows how old what is known is
            self._received.clear()
        self._now = now
        if snapshot is None or not math.isfinite(snapshot.age):
            return "no fresh positions"
        if not self._has(snapshot):
            if not _is_finite(snapshot):
                return "no fresh positions"
            self._take(now - snapshot.age, snapshot)
        newest = self._received[-1].sent
        if not now - newest <= self._settings.snapshot_limit:
            return "no fresh positions"
        if self._me is not None and self._me.state == "silent":
            return "the base station does not hear from it"
        if self._me is None or self._me.state != "tracking":
            return "the cameras do not see it where it believes to be"
        if newest - self._listening_since < self._span - 1e-6:
            return "it listens before it drives"
        return ""

    @property
    def _span(self) -> float:
        """For how long before the newest snapshot another robot's may have been sent that it still obeys [s]."""
        return self._settings.snapshot_limit + self._settings.hold

    def _has(self, snapshot: SharedSnapshot) -> bool:
        stamp, epoch = snapshot.stamp, snapshot.epoch
        return (stamp, epoch) in [(each.stamp, each.epoch) for each in self._received]

    def _take(self, sent: float, snapshot: SharedSnapshot) -> None:
        received = self._received
        rows = {row.name: row for row in snapshot.robots}
        me = rows.pop(self._name, None)
        mine = None if me is None else self._stretch(me, self._body)
        taken = _Received(sent, snapshot.stamp, snapshot.epoch, mine, rows)
        if received and sent < received[-1].sent:  # overtaken on its way: one more to obey, but nothing newer
            received.insert(sum(each.sent < sent for each in received), taken)
            return
        if not received or sent - received[-1].sent > GAP:
            self._listening_since = sent
        if received and received[-1].epoch != snapshot.epoch:
            self._unseen.update(received[-1].rows)
        self._unseen = {name: row for name, row in self._unseen.items() if name not in rows}
        received.append(taken)
        oldest_row = min(max([0.0, *(row.age for row in rows.values())]), _OLDEST_ROW)
        oldest = sent - self._span - oldest_row
        while received[0].sent < oldest:
            received.popleft()
        self._me = me
        self._look(sent, rows)

    def _look(self, sent: float, rows: Mapping[str, RobotSeen]) -> None:
        """Where the others are in the newest snapshot. One that only the base station before this one has seen is there
        still: no camera has seen it since."""
        obstacles = list(self._unseen.values())
        self._sent, self._tracked, self._seen = sent, [], []
        for name, row in rows.items():
            mate = self._mates.get(name)
            if mate is not None and (row.state in _KEEPS_APART or row.state == _STOPS):
                if row.state == "tracking":
                    self._speeds[name] = row.v, row.omega
                self._tracked.append((row, mate, self._speeds.get(name, (0.0, 0.0))[0]))
            if mate is not None and row.state == "tracking":
                self._seen.append((row, mate.keep, row.v))
            else:
                obstacles.append(row)
        self.obstacles = tuple(map(self._obstacle, obstacles))
        self._seen += ((row, obstacle.keep, 0.0) for row, obstacle in zip(obstacles, self.obstacles, strict=True))

    def _stretch(self, row: RobotSeen, body: Body) -> Stretch:
        return _stretch_of(row.x, row.y, row.theta, row.v, body, body.radius + self._half_margin)

    def _obstacle(self, row: RobotSeen) -> Obstacle:
        """A robot that may have gone on after it was seen: for as long as it may drive blind, and its braking. One that
        turned may have gone on straight, or have turned further, so it is wider by how far that leads aside."""
        mate = self._mates.get(row.name)
        body = mate.body if mate is not None else self._largest
        keep = self._body.radius + self._settings.margin + body.radius
        v, omega = self._speeds.get(row.name, (0.0, 0.0))
        far = v * self._settings.hold + stopping_distance(v, body)
        turn = abs(omega) * (self._settings.hold + abs(v) / body.brake)
        aside = abs(far) * math.sin(min(0.5 * turn, 0.5 * math.pi))
        return Obstacle(row.x, row.y, far * math.cos(row.theta), far * math.sin(row.theta), keep + aside, row.name)

    def lines(self, x: float, y: float, reach: float) -> list[Line]:
        """The lines that a robot could cross.

        Those of the newest snapshot as they are. Those of older ones only as far as the other robot can still come:
        one that goes by the older snapshot drives at most until that is too old, and then brakes.

        Args:
            x: the robot's position [m, world].
            y: the same.
            reach: how far it comes at most [m].
        """
        found: list[Line] = []
        *older, newest = self._received
        span, longest_stops = self._span, self._longest_stops
        for row, mate, v in self._tracked:
            body, keep, part = mate
            free = math.hypot(row.x - x, row.y - y) - keep
            # A line leaves a robot at least this part of the free floor between the two stretches.
            if part * (free - longest_stops) > reach:
                continue
            line = self._line(newest, row.name)
            if line is not None and line[0] * x + line[1] * y + reach > line[2]:
                found.append(line)
            speed = abs(v)  # it may come backwards
            top = max(body.v_max, speed)
            if free <= reach + top * (span + row.age + body.lag) + 0.5 * top * top / body.brake:
                comes = travel_toward(speed, 0.0, body, span + row.age)
                if free <= reach + comes:
                    self._older_lines(x, y, reach, row, mate, v, comes, older, found)
        return found

    def _older_lines(
        self,
        x: float,
        y: float,
        reach: float,
        row: RobotSeen,
        mate: _Mate,
        v: float,
        comes: float,
        older: list[_Received],
        found: list[Line],
    ) -> None:
        """Add the lines of older snapshots between this robot and one with a speed ``v`` [m/s], that comes no further
        than ``comes`` [m]."""
        name, body, keep = row.name, mate.body, mate.keep
        there_x, there_y = row.x, row.y
        c, s = math.cos(row.theta), math.sin(row.theta)
        # Beside a line a robot that comes straight on has this for itself; less when it comes from elsewhere.
        away_x, away_y, least = there_x - x, there_y - y, keep + comes + reach
        beyond = self._span - self._sent + row.age
        for start in range(0, len(older), _TOGETHER):
            group = older[start : start + _TOGETHER]
            crossed: list[Line] = []
            ahead, matters = -1.0, False
            for received in group:
                line = received.lines.get(name) or self._line(received, name)
                if line is not None:
                    nx, ny, bound, _ = line
                    if nx * x + ny * y + reach > bound:
                        crossed.append(line)
                        toward = -nx * c - ny * s
                        if toward > ahead:
                            ahead = toward
                        if nx * away_x + ny * away_y < least:
                            matters = True
            if not matters:
                continue
            # How far it comes toward me by the time when the last of these snapshots is too old, and it has braked.
            drives = group[-1].sent + beyond
            come = travel_toward(v, math.acos(min(1.0, ahead)), body, drives)
            for line in crossed:
                nx, ny, bound, _ = line
                there = nx * there_x + ny * there_y - keep - come
                if there <= bound:
                    found.append(line)
                elif nx * x + ny * y + reach > there:
                    found.append(Line(nx, ny, there, name))

    def _line(self, received: _Received, name: str) -> Line | None:
        """The line of a snapshot between this robot and another; None when that did not keep apart by itself then."""
        lines = received.lines
        if name in lines:
            return lines[name]
        row, mate = received.rows.get(name), self._mates.get(name)
        line = None
        if row is not None and mate is not None and row.state in _KEEPS_APART and received.mine is not None:
            line = line_between(received.mine, self._stretch(row, mate.body), name)
        lines[name] = line
        return line

    def near(self, now: float, x: float, y: float, within: float) -> list[Near]:
        """The neighbours and walls near a position, moved on to now; the nearest first.

        Args:
            now: the time [s].
            x: the position [m, world].
            y: the same.
            within: how near [m].
        """
        if not self._received:
            return []
        found = []
        age = now - self._sent
        for row, keep, v in self._seen:
            old = age + row.age
            if math.hypot(row.x - x, row.y - y) > within + abs(v * old):
                continue
            vx, vy = v * math.cos(row.theta), v * math.sin(row.theta)
            px, py = row.x + vx * old, row.y + vy * old
            away = math.hypot(px - x, py - y)
            if away < within:
                found.append((away - keep, Near(px, py, vx, vy, keep, row.name, row.theta, row.omega)))
        for wall in self.walls:
            px, py = nearest_on(wall.x, wall.y, wall.dx, wall.dy, x, y)
            away = math.hypot(px - x, py - y)
            if away < within:
                found.append((away - wall.keep, Near(px, py, 0.0, 0.0, wall.keep, WALL)))
        found.sort(key=lambda one: one[0])
        return [one for _, one in found]


@lru_cache(maxsize=512)
def _stretch_of(x: float, y: float, theta: float, v: float, body: Body, keep: float) -> Stretch:
    """Kept, because in a fleet in one process all robots ask for the same stretches."""
    far = stopping_distance(v, body)
    c, s = math.cos(theta), math.sin(theta)
    return Stretch(x, y, x + far * c, y + far * s, v * c, v * s, keep)


def clearance(obstacle: Obstacle, points: Sequence[Point]) -> float:
    """The least distance of a path's points from an obstacle [m].

    Args:
        obstacle: the obstacle.
        points: the path [m, world].
    """
    least = math.inf
    for x, y in points:
        px, py = nearest_on(obstacle.x, obstacle.y, obstacle.dx, obstacle.dy, x, y)
        least = min(least, math.hypot(px - x, py - y))
    return least


def _is_finite(snapshot: SharedSnapshot) -> bool:
    total = snapshot.age + snapshot.stamp
    for row in snapshot.robots:
        total += row.x + row.y + row.theta + row.v + row.omega + row.age
    return math.isfinite(total)
