"""A coarse way round walls and standing robots: the cheapest path on a grid, looked for rarely."""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from muro_zenoh.geometry import Bounds
from muro_zenoh.safety.separation.line import Point, nearest_on

CELL: Final = 0.1
"""Size of a cell [m]."""
_DETOUR: Final = 0.6
"""How much further a robot goes to avoid driving against a standing one [m]."""
_DIAGONAL: Final = math.sqrt(2.0)


class Segment(NamedTuple):
    """A wall from (``x``, ``y``) by (``dx``, ``dy``) that a robot's centre keeps ``keep`` away from [m, world]."""

    x: float
    y: float
    dx: float
    dy: float
    keep: float


class Planner:
    """The grid of one robot.

    Args:
        inside: where its centre may be [m, world].
        walls: walls inside.
    """

    def __init__(self, inside: Bounds, walls: Sequence[Segment]) -> None:
        self._inside = inside
        self._walls = walls
        self._columns = max(1, math.floor(inside.width / CELL) + 1)
        self._rows = max(1, math.floor(inside.height / CELL) + 1)
        self._free = bytearray(b"\1" * (self._columns * self._rows))
        if walls:
            for k in range(len(self._free)):
                x, y = self._place(k)
                self._free[k] = all(_away(wall, x, y) >= wall.keep for wall in walls)

    def sees(self, start: Point, end: Point) -> bool:
        """Whether no wall is between two positions.

        Args:
            start: one [m, world].
            end: the other.
        """
        if not self._walls:
            return True
        pieces = max(1, math.ceil(math.dist(start, end) / (0.5 * CELL)))
        for k in range(1, pieces):
            x, y = (a + (b - a) * k / pieces for a, b in zip(start, end, strict=True))
            if any(_away(wall, x, y) < wall.keep for wall in self._walls):
                return False
        return True

    def way(self, start: Point, end: Point, slow: Sequence[tuple[float, float, float]]) -> list[Point]:
        """The cheapest path from one position to another.

        Args:
            start: where from [m, world].
            end: where to.
            slow: standing robots: x, y and the distance to keep [m]; they cost and never forbid.

        Returns:
            Positions from start to end; empty when walls leave no way.
        """
        first, last = self._cell(start), self._cell(end)
        if first < 0 or last < 0:
            return []
        costly = self._costs(slow)
        columns = self._columns
        goal_x, goal_y = last % columns, last // columns
        spent = {first: 0.0}
        before: dict[int, int] = {}
        queue = [(0.0, first)]
        done = set()
        while queue:
            _, cell = heapq.heappop(queue)
            if cell == last:
                break
            if cell in done:
                continue
            done.add(cell)
            column, row = cell % columns, cell // columns
            for i, j, step in _STEPS:
                c, r = column + i, row + j
                if not (0 <= c < columns and 0 <= r < self._rows):
                    continue
                other = r * columns + c
                if not self._free[other] or other in done:
                    continue
                cost = spent[cell] + step * (1.0 + costly.get(other, 0.0))
                if cost < spent.get(other, math.inf):
                    spent[other], before[other] = cost, cell
                    far, near = abs(c - goal_x), abs(r - goal_y)
                    if far < near:
                        far, near = near, far
                    heapq.heappush(queue, (cost + (far + (_DIAGONAL - 1.0) * near) * CELL, other))
        if last != first and last not in before:
            return []
        path = [end]
        cell = last
        while cell in before:
            cell = before[cell]
            path.append(self._place(cell))
        path[-1] = start
        return path[::-1]

    def _costs(self, slow: Sequence[tuple[float, float, float]]) -> dict[int, float]:
        costs: dict[int, float] = {}
        for x, y, keep in slow:
            size = math.ceil(keep / CELL)
            middle = round((x - self._inside.x_min) / CELL), round((y - self._inside.y_min) / CELL)
            for c in range(max(0, middle[0] - size), min(self._columns, middle[0] + size + 1)):
                for r in range(max(0, middle[1] - size), min(self._rows, middle[1] + size + 1)):
                    px, py = self._inside.x_min + c * CELL, self._inside.y_min + r * CELL
                    if math.hypot(px - x, py - y) < keep:
                        k = r * self._columns + c
                        costs[k] = costs.get(k, 0.0) + _DETOUR / (2.0 * keep) * 4.0
        return costs

    def _place(self, cell: int) -> Point:
        row, column = divmod(cell, self._columns)
        return self._inside.x_min + column * CELL, self._inside.y_min + row * CELL

    def _cell(self, place: Point) -> int:
        """The nearest free cell; -1 when none is near."""
        column = round((place[0] - self._inside.x_min) / CELL)
        row = round((place[1] - self._inside.y_min) / CELL)
        best, found = math.inf, -1
        for c in range(max(0, column - 2), min(self._columns, column + 3)):
            for r in range(max(0, row - 2), min(self._rows, row + 3)):
                k = r * self._columns + c
                if self._free[k]:
                    away = math.dist(self._place(k), place)
                    if away < best:
                        best, found = away, k
        return found


_STEPS: Final = tuple((i, j, CELL * math.hypot(i, j)) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j)


def _away(wall: Segment, x: float, y: float) -> float:
    px, py = nearest_on(wall.x, wall.y, wall.dx, wall.dy, x, y)
    return math.hypot(px - x, py - y)
