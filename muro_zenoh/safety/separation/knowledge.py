"""What one robot knows of the fleet: the lines of the snapshots that it received, and where the others are now."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from muro_zenoh.safety.separation.body import Body, Row, SharedSnapshot
from muro_zenoh.safety.separation.guidance import Near
from muro_zenoh.safety.separation.line import Line, Point, Stretch, line_between, nearest_on
from muro_zenoh.safety.separation.path import stopping_distance
from muro_zenoh.safety.separation.reach import travel_toward
from muro_zenoh.safety.separation.settings import SeparationSettings

Wall = tuple[float, float, float, float]
"""A wall inside the arena, from x, y to x, y [m, world]."""

WALL: Final = "the wall"
GAP: Final = 0.3
"""After a gap of this length in the snapshots a robot listens before it drives [s]: it may have missed those that the
others obey."""
_OLDEST_ROW: Final = 0.25


class Obstacle(NamedTuple):
    """What does not keep apart by itself: a segment from (``x``, ``y``) by (``dx``, ``dy``) [m, world], the distance to
    ``keep`` from it [m], and its ``name``."""

    x: float
    y: float
    dx: float
    dy: float
    keep: float
    name: str


class _Received(NamedTuple):
    """A snapshot: when it was sent [s, local clock], its stamp and epoch, its lines."""

    sent: float
    stamp: float
    epoch: int
    lines: tuple[Line, ...]


class _Mate(NamedTuple):
    """A robot of the fleet in the newest snapshot: its row, body, time of its fix [s, local clock], and the distance of
    the centres to keep [m]."""

    row: Row
    body: Body
    captured: float
    keep: float


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
        self._others = dict(others)
        self._largest = max((*others.values(), body), key=lambda known: known.radius)
        keep = body.radius + settings.wall_margin
        self.walls = tuple(Obstacle(x, y, x_end - x, y_end - y, keep, WALL) for x, y, x_end, y_end in walls)
        self._received: deque[_Received] = deque()
        self._listening_since = math.inf
        self._me: Row | None = None
        self._mates: dict[str, _Mate] = {}
        self._speeds: dict[str, float] = {}
        self.obstacles: tuple[Obstacle, ...] = ()
        """Robots that do not keep apart by themselves, in the newest snapshot."""
        self._seen: list[tuple[Row, float, bool]] = []

    def learn(self, now: float, snapshot: SharedSnapshot | None) -> str:
        """Take the newest snapshot; one that is known already changes nothing.

        Args:
            now: the time [s].
            snapshot: all robots; None when there is none.

        Returns:
            Why the robot must not drive on what it knows; empty when it may.
        """
        if snapshot is not None and _is_finite(snapshot):
            self._take(now - snapshot.age, snapshot)
        else:
            return "no fresh positions"
        newest = self._received[-1].sent
        if not now - newest <= self._settings.snapshot_limit:
            return "no fresh positions"
        if self._me is None or self._me.state != "tracking":
            return "the cameras do not see it where it believes to be"
        if newest - self._listening_since < self._span - 1e-6:
            return "it listens before it drives"
        return ""

    @property
    def _span(self) -> float:
        """For how long before the newest snapshot another robot's may have been sent that it still obeys [s]."""
        return self._settings.snapshot_limit + self._settings.hold

    def _take(self, sent: float, snapshot: SharedSnapshot) -> None:
        received = self._received
        for each in reversed(received):
            if each.stamp == snapshot.stamp and each.epoch == snapshot.epoch:
                return
        rows = {row.name: row for row in snapshot.robots}
        me = rows.pop(self._name, None)
        lines: list[Line] = []
        if me is not None:
            mine = self._stretch(me, self._body)
            for name, row in rows.items():
                body = self._others.get(name)
                if body is not None and row.state == "tracking":
                    lines.append(line_between(mine, self._stretch(row, body), name))
        taken = _Received(sent, snapshot.stamp, snapshot.epoch, tuple(lines))
        if received and sent < received[-1].sent:  # overtaken on its way: one more to obey, but nothing newer
            received.insert(sum(each.sent < sent for each in received), taken)
            return
        if not received or sent - received[-1].sent > GAP:
            self._listening_since = sent
        received.append(taken)
        oldest_row = max((min(row.age, _OLDEST_ROW) for row in rows.values()), default=0.0)
        while received[0].sent < sent - self._span - oldest_row:
            received.popleft()
        self._me = me
        self._look(sent, rows)

    def _look(self, sent: float, rows: Mapping[str, Row]) -> None:
        """Where the others are in the newest snapshot."""
        obstacles: list[Obstacle] = []
        self._mates, self._seen = {}, []
        for name, row in rows.items():
            body = self._others.get(name)
            keep = self._body.radius + (body or self._largest).radius + self._settings.margin
            drives = body is not None and row.state == "tracking"
            if body is not None and drives:
                self._speeds[name] = row.v
                self._mates[name] = _Mate(row, body, sent - row.age, keep)
            else:
                obstacles.append(self._obstacle(row, body or self._largest, keep))
            self._seen.append((row, keep, drives))
        self.obstacles = tuple(obstacles)

    def _stretch(self, row: Row, body: Body) -> Stretch:
        far = stopping_distance(row.v, body)
        c, s = math.cos(row.theta), math.sin(row.theta)
        keep = body.radius + 0.5 * self._settings.margin
        return Stretch(row.x, row.y, row.x + far * c, row.y + far * s, row.v * c, row.v * s, keep)

    def _obstacle(self, row: Row, body: Body, keep: float) -> Obstacle:
        """A robot that may have gone on after it was seen: for as long as it may drive blind, and its braking."""
        v = self._speeds.get(row.name, 0.0)
        far = v * self._settings.hold + stopping_distance(v, body)
        return Obstacle(row.x, row.y, far * math.cos(row.theta), far * math.sin(row.theta), keep, row.name)

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
        newest = len(self._received) - 1
        for k, received in enumerate(self._received):
            for line in received.lines:
                nx, ny, bound, name = line
                if nx * x + ny * y + reach <= bound:
                    continue
                mate = self._mates.get(name) if k < newest else None
                if mate is not None:
                    row = mate.row
                    drives = received.sent + self._span - mate.captured
                    turn = math.acos(max(-1.0, min(1.0, -nx * math.cos(row.theta) - ny * math.sin(row.theta))))
                    there = nx * row.x + ny * row.y - mate.keep
                    if there > bound:
                        bound = max(bound, there - travel_toward(row.v, turn, mate.body, drives))
                        if nx * x + ny * y + reach <= bound:
                            continue
                        line = Line(nx, ny, bound, name)
                found.append(line)
        return found

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
        age = now - self._received[-1].sent
        for row, keep, moving in self._seen:
            vx, vy = (row.v * math.cos(row.theta), row.v * math.sin(row.theta)) if moving else (0.0, 0.0)
            old = age + row.age
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
    return math.isfinite(snapshot.age + snapshot.stamp) and all(
        math.isfinite(row.x + row.y + row.theta + row.v + row.omega + row.age) for row in snapshot.robots
    )
