"""The certificate: whether a command, held until the dead-man acts and then braked, stays on this robot's side."""

from __future__ import annotations

import math
from typing import Final

from muro_zenoh.geometry import STILL, Bounds, State, Twist2
from muro_zenoh.safety.separation.body import Body
from muro_zenoh.safety.separation.knowledge import WALL, Knowledge, Obstacle, clearance
from muro_zenoh.safety.separation.line import Line
from muro_zenoh.safety.separation.path import braking_path, stopping_distance
from muro_zenoh.safety.separation.settings import SeparationSettings

_PERIOD: Final = 0.05
"""After this time the robot decides anew, and may brake [s]."""
_GRACE: Final = 1e-6


class Certificate:
    """What one robot obeys at one moment.

    Args:
        state: the robot's state.
        body: its size and limits.
        inside: where its centre may be.
        known: what it knows of the others.
        settings: how to keep apart.
        fastest: no command that is asked for is faster [m/s].
    """

    def __init__(
        self, state: State, body: Body, inside: Bounds, known: Knowledge, settings: SeparationSettings, fastest: float
    ) -> None:
        self._state, self._body, self._hold = state, body, settings.hold
        x, y = state.x, state.y
        rest = braking_path(state, STILL, 0.0, body)
        top = max(abs(state.v), fastest)
        reach = top * settings.hold + stopping_distance(top, body)
        lines = known.lines(x, y, reach)
        if x + reach > inside.x_max:
            lines.append(Line(1.0, 0.0, inside.x_max, WALL))
        if x - reach < inside.x_min:
            lines.append(Line(-1.0, 0.0, -inside.x_min, WALL))
        if y + reach > inside.y_max:
            lines.append(Line(0.0, 1.0, inside.y_max, WALL))
        if y - reach < inside.y_min:
            lines.append(Line(0.0, -1.0, -inside.y_min, WALL))
        # A violation that braking cannot avoid is kept, never deepened.
        braking = max([math.dist(rest[0], point) for point in rest])
        self._lines: list[tuple[float, float, float, str, float]] = []
        """Each with the distance from the robot to it [m]."""
        for nx, ny, bound, other in lines:
            here = nx * x + ny * y
            if bound - here < braking:
                for px, py in rest:
                    if nx * px + ny * py > bound:
                        bound = nx * px + ny * py
            bound += _GRACE
            self._lines.append((nx, ny, bound, other, bound - here))
        self._nearest = min([line[-1] for line in self._lines], default=math.inf)
        self._obstacles: list[tuple[Obstacle, float]] = [
            (obstacle, min(obstacle.keep, clearance(obstacle, rest)) - _GRACE)
            for obstacle in (*known.obstacles, *known.walls)
            if clearance(obstacle, rest[:1]) < obstacle.keep + reach
        ]

    def blocker(self, command: Twist2) -> str:
        """Whom or what a command does not keep clear of; empty when it keeps clear of all.

        Args:
            command: the command, held until the dead-man acts.
        """
        if not self._lines and not self._obstacles:
            return ""
        top = max(abs(self._state.v), abs(command.v))
        braking = stopping_distance(top, self._body)
        # The robot may brake at its next decision, too; what is between the two lies between these paths.
        for held in (self._hold, _PERIOD):
            if not self._obstacles and top * held + braking < self._nearest:
                continue
            points = braking_path(self._state, command, held, self._body)
            here, ahead = points[0], points[1:]
            far = max([math.dist(here, point) for point in ahead]) + _GRACE
            for nx, ny, bound, other, away in self._lines:  # where the robot is, it is on its side of all of them
                if away < far:
                    for x, y in ahead:
                        if nx * x + ny * y > bound:
                            return other
            for obstacle, allowed in self._obstacles:
                if clearance(obstacle, points) < allowed:
                    return obstacle.name
        return ""
