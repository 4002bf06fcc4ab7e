"""The certificate: whether a command, held until the dead-man acts and then braked, stays on this robot's side."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from muro_zenoh.geometry import STILL, Bounds, State, Twist2
from muro_zenoh.safety.separation.body import Body, Row, SharedSnapshot
from muro_zenoh.safety.separation.guidance import Near
from muro_zenoh.safety.separation.line import Line, Point, Stretch, line_between, nearest_on
from muro_zenoh.safety.separation.path import braking_path, stopping_distance
from muro_zenoh.safety.separation.settings import SeparationSettings

Wall = tuple[float, float, float, float]
"""A wall inside the arena, from x, y to x, y [m, world]."""

WALL: Final = "the wall"
_PERIOD: Final = 0.05
_GRACE: Final = 1e-6


class Obstacle(NamedTuple):
    """What does not keep apart by itself: a segment from (``x``, ``y``) by (``dx``, ``dy``) [m, world], the distance to
    ``keep`` from it [m], and its ``name``."""

    x: float
    y: float
    dx: float
    dy: float
    keep: float
    name: str


class _Known(NamedTuple):
    """One snapshot: when it was sent, on the local clock [s], and the lines that it gives."""

    sent: float
    stamp: float
    epoch: int
    lines: tuple[Line, ...]


class Certificate:
    """What one robot obeys: lines, obstacles and walls.

    Args:
        name: the robot's name.
        body: its size and limits.
        others: bodies by name.
        arena: the floor.
        settings: how to keep apart.
        walls: walls inside the arena.
    """

    def __init__(
        self,
        name: str,
        body: Body,
        others: Mapping[str, Body],
        arena: Bounds,
        settings: SeparationSettings,
        walls: Sequence[Wall] = (),
    ) -> None:
        self._name, self._body, self._others, self._settings = name, body, dict(others), settings
        self._largest = max((*others.values(), body), key=lambda known: known.radius)
        inside = arena.shrunk(body.radius + settings.wall_margin)
        self._arena = (
            Line(1.0, 0.0, inside.x_max, WALL),
            Line(-1.0, 0.0, -inside.x_min, WALL),
            Line(0.0, 1.0, inside.y_max, WALL),
            Line(0.0, -1.0, -inside.y_min, WALL),
        )
        keep = body.radius + settings.wall_margin
        self._walls = tuple(Obstacle(x, y, x_end - x, y_end - y, keep, WALL) for x, y, x_end, y_end in walls)
        self._driven = body
        self._snapshots: deque[_Known] = deque()
        self._obstacles: tuple[Obstacle, ...] = ()
        self._rows: list[tuple[Row, float, bool]] = []
        self._speeds: dict[str, float] = {}
        self._state = State(0.0, 0.0, 0.0, 0.0, 0.0)
        self._rest: list[Point] = []
        self._lines: list[tuple[Line, float]] = []
        self._near_obstacles: list[tuple[Obstacle, float]] = []

    def learn(self, now: float, snapshot: SharedSnapshot) -> bool:
        """Take a snapshot; one that is known already changes nothing.

        Args:
            now: the time [s].
            snapshot: all robots.

        Returns:
            Whether it can be used: all its numbers are finite.
        """
        if not all(map(_is_finite, snapshot.robots)) or not math.isfinite(snapshot.age):
            return False
        known = self._snapshots
        sent = now - snapshot.age
        while known and known[0].sent < now - self._settings.window and len(known) > 1:
            known.popleft()
        if any(each.stamp == snapshot.stamp and each.epoch == snapshot.epoch for each in known):
            return True
        rows = {row.name: row for row in snapshot.robots}
        me = rows.pop(self._name, None)
        mine = None if me is None else self._stretch(me, self._body)
        lines: list[Line] = []
        obstacles: list[Obstacle] = []
        for name, row in rows.items():
            body = self._others.get(name)
            if body is not None and mine is not None and row.state == "tracking":
                self._speeds[name] = row.v
                lines.append(line_between(mine, self._stretch(row, body), name))
            else:
                obstacles.append(self._obstacle(row, body or self._largest))
        self._obstacles = tuple(obstacles)
        keep = self._body.radius + self._settings.margin
        self._rows = [
            (row, keep + (self._others.get(name) or self._largest).radius, row.state == "tracking")
            for name, row in rows.items()
        ]
        known.append(_Known(sent, snapshot.stamp, snapshot.epoch, tuple(lines)))
        return True

    def _stretch(self, row: Row, body: Body) -> Stretch:
        far = stopping_distance(row.v, body)
        x, y = row.x + far * math.cos(row.theta), row.y + far * math.sin(row.theta)
        return Stretch(row.x, row.y, x, y, body.radius + 0.5 * self._settings.margin)

    def _obstacle(self, row: Row, body: Body) -> Obstacle:
        """A robot that may have gone on after it was seen: for as long as it may drive blind, and its braking."""
        v = self._speeds.get(row.name, 0.0)
        far = v * self._settings.hold + stopping_distance(v, body)
        keep = self._body.radius + body.radius + self._settings.margin
        return Obstacle(row.x, row.y, far * math.cos(row.theta), far * math.sin(row.theta), keep, row.name)

    def near(self, now: float, x: float, y: float, within: float) -> list[Near]:
        """The neighbours and walls near a position, moved on to now; the nearest first.

        Args:
            now: the time [s].
            x: the position [m, world].
            y: the same.
            within: how near [m].
        """
        if not self._snapshots:
            return []
        found = []
        age = now - self._snapshots[-1].sent
        for row, keep, moving in self._rows:
            vx, vy = (row.v * math.cos(row.theta), row.v * math.sin(row.theta)) if moving else (0.0, 0.0)
            old = age + row.age
            px, py = row.x + vx * old, row.y + vy * old
            away = math.hypot(px - x, py - y)
            if away < within:
                found.append((away - keep, Near(px, py, vx, vy, keep, row.name, row.theta, row.omega)))
        for wall in self._walls:
            px, py = nearest_on(wall.x, wall.y, wall.dx, wall.dy, x, y)
            away = math.hypot(px - x, py - y)
            if away < within:
                found.append((away - wall.keep, Near(px, py, 0.0, 0.0, wall.keep, WALL)))
        found.sort(key=lambda one: one[0])
        return [one for _, one in found]

    def begin(self, now: float, state: State, body: Body) -> None:
        """Look at what must be obeyed from the robot's state now.

        Args:
            now: the time [s].
            state: the robot's state.
            body: its limits as its wheels are now.
        """
        self._state, self._driven = state, body
        self._rest = rest = braking_path(state, STILL, 0.0, body)
        top = max(abs(state.v), body.v_max)
        reach = top * self._settings.hold + stopping_distance(top, body)
        x, y = state.x, state.y
        self._lines = []
        for lines in (self._arena, *(known.lines for known in self._snapshots)):
            for line in lines:
                nx, ny, bound, _ = line
                if nx * x + ny * y + reach > bound:
                    # A violation that braking cannot avoid is kept, never deepened.
                    self._lines.append((line, max(bound, *(nx * px + ny * py for px, py in rest)) + _GRACE))
        self._near_obstacles = [
            (obstacle, min(obstacle.keep, _clearance(obstacle, rest)) - _GRACE)
            for obstacle in (*self._obstacles, *self._walls)
            if _clearance(obstacle, rest[:1]) < obstacle.keep + reach
        ]

    def blocker(self, command: Twist2) -> str:
        """Whom or what a command does not keep clear of; empty when it keeps clear of all.

        Args:
            command: the command, held until the dead-man acts.
        """
        for held in (self._settings.hold, _PERIOD):
            points = braking_path(self._state, command, held, self._driven)
            for line, bound in self._lines:
                nx, ny = line.nx, line.ny
                for x, y in points:
                    if nx * x + ny * y > bound:
                        return line.other
            for obstacle, allowed in self._near_obstacles:
                if _clearance(obstacle, points) < allowed:
                    return obstacle.name
        return ""


def _clearance(obstacle: Obstacle, points: Sequence[Point]) -> float:
    """The least distance of a path's points from an obstacle [m]."""
    least = math.inf
    for x, y in points:
        px, py = nearest_on(obstacle.x, obstacle.y, obstacle.dx, obstacle.dy, x, y)
        least = min(least, math.hypot(px - x, py - y))
    return least


def _is_finite(row: Row) -> bool:
    return all(map(math.isfinite, (row.x, row.y, row.theta, row.v, row.omega, row.age)))
