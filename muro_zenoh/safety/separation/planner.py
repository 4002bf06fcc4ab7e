"""A coarse way round walls and standing robots: the cheapest path on a grid, looked for rarely."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from muro_zenoh.geometry import Bounds
from muro_zenoh.safety.separation.line import Point, nearest_on

CELL: Final = 0.1
"""Size of a cell [m]."""
SLICE: Final = 80
"""Cells that are looked at in one slice of a search."""
_DETOUR: Final = 0.6
"""How much further a robot goes to avoid driving against a standing one [m]."""
_BERTH: Final = 0.2
"""A robot would rather keep this further from a wall than it has to [m] ..."""
_TIGHT: Final = 3.0
"""... and beside the wall goes as far round as this many times the way."""
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
        columns = max(1, math.floor(inside.width / CELL) + 1)
        rows = max(1, math.floor(inside.height / CELL) + 1)
        # Row by row, with a border of cells that are not free, so that every free cell has eight neighbours.
        self._columns = columns + 2
        self._rows = rows + 2
        self._free = bytearray(self._columns * self._rows)
        self._beside_walls: dict[int, float] = {}
        """What a step into a cell near a wall costs more, as a part of its length."""
        for row in range(1, rows + 1):
            for k in range(row * self._columns + 1, row * self._columns + 1 + columns):
                x, y = self._place(k)
                free = min((_away(wall, x, y) - wall.keep for wall in walls), default=_BERTH)
                self._free[k] = free >= 0.0
                if 0.0 <= free < _BERTH:
                    self._beside_walls[k] = _TIGHT * (1.0 - free / _BERTH)
        self._steps = tuple((j * self._columns + i, step) for i, j, step in _STEPS)

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
        """The cheapest path from one position to another, at once.

        Args:
            start: where from [m, world].
            end: where to.
            slow: standing robots: x, y and the distance to keep [m]; they cost and never forbid.

        Returns:
            Positions from start to end; empty when walls leave no way.
        """
        return next(found for found in self.search(start, end, slow) if found is not None)

    def search(
        self, start: Point, end: Point, slow: Sequence[tuple[float, float, float]]
    ) -> Iterator[list[Point] | None]:
        """:meth:`way` in slices that fit into a step of a control loop: None while it is not found yet, then the path.

        Args:
            start: where from [m, world].
            end: where to.
            slow: standing robots: x, y and the distance to keep [m].
        """
        first, last = self._cell(start), self._cell(end)
        if first < 0 or last < 0:
            yield []
            return
        costly = self._costs(slow)
        yield None
        columns, free, steps = self._columns, self._free, self._steps
        goal_y, goal_x = divmod(last, columns)
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
            here = spent[cell]
            for offset, step in steps:
                other = cell + offset
                if not free[other] or other in done:
                    continue
                cost = here + step * (1.0 + costly.get(other, 0.0))
                if cost < spent.get(other, math.inf):
                    spent[other], before[other] = cost, cell
                    row, column = divmod(other, columns)
                    far, near = abs(column - goal_x), abs(row - goal_y)
                    if far < near:
                        far, near = near, far
                    heapq.heappush(queue, (cost + (far + (_DIAGONAL - 1.0) * near) * CELL, other))
            if len(done) % SLICE == 0:
                yield None
        if last != first and last not in before:
            yield []
            return
        path = [end]
        cell = last
        while cell in before:
            cell = before[cell]
            path.append(self._place(cell))
        path[-1] = start
        yield path[::-1]

    def _costs(self, slow: Sequence[tuple[float, float, float]]) -> dict[int, float]:
        costs = self._beside_walls.copy()
        for x, y, keep in slow:
            cost = _DETOUR / (2.0 * keep) * 4.0
            for k in self._around(x, y, math.ceil(keep / CELL)):
                if math.dist(self._place(k), (x, y)) < keep:
                    costs[k] = costs.get(k, 0.0) + cost
        return costs

    def _around(self, x: float, y: float, size: int) -> Iterator[int]:
        """The cells within ``size`` columns and rows of a position."""
        column = round((x - self._inside.x_min) / CELL) + 1
        row = round((y - self._inside.y_min) / CELL) + 1
        for c in range(max(1, column - size), min(self._columns - 1, column + size + 1)):
            for r in range(max(1, row - size), min(self._rows - 1, row + size + 1)):
                yield r * self._columns + c

    def _place(self, cell: int) -> Point:
        row, column = divmod(cell, self._columns)
        return self._inside.x_min + (column - 1) * CELL, self._inside.y_min + (row - 1) * CELL

    def _cell(self, place: Point) -> int:
        """The nearest free cell; -1 when none is near."""
        best, found = math.inf, -1
        for k in self._around(*place, 2):
            if self._free[k]:
                away = math.dist(self._place(k), place)
                if away < best:
                    best, found = away, k
        return found


_STEPS: Final = tuple((i, j, CELL * math.hypot(i, j)) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j)


def _away(wall: Segment, x: float, y: float) -> float:
    px, py = nearest_on(wall.x, wall.y, wall.dx, wall.dy, x, y)
    return math.hypot(px - x, py - y)
