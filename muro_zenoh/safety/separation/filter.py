"""The separation filter of one robot: a desired twist in, one that keeps clear of all others and the walls out."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from muro_zenoh.geometry import STILL, Bounds, State, Twist2
from muro_zenoh.safety.separation.body import Body, SharedSnapshot
from muro_zenoh.safety.separation.certificate import Certificate, Wall
from muro_zenoh.safety.separation.guidance import Near, approach_speed, guided, rows_of, time_to, velocity_of
from muro_zenoh.safety.separation.projection import Row
from muro_zenoh.safety.separation.settings import SeparationSettings

_LOOK = 1.6
_HORIZON = float(os.environ.get('HOR','2.0'))


class Separated(NamedTuple):
    """The twist to drive: ``twist``; and why it is not the desired one, ``reason``, empty when it is."""

    twist: Twist2
    reason: str


class Separation:
    """The filter of one robot. It keeps its own state; the same inputs give the same outputs.

    Args:
        name: the robot's name.
        body: its size and limits.
        others: the bodies of the fleet by name; a robot that is not there is foreign and may be as large as the
            largest.
        arena: the floor with walls around it.
        settings: how to keep apart.
        walls: walls inside the arena, each from x, y to x, y [m, world].
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
        self._name = name
        self._arena = arena
        self._body = body
        self._settings = settings
        self._certificate = Certificate(name, body, others, arena, settings, walls)

    def step(
        self,
        now: float,
        state: State,
        desired: Twist2 | None,
        snapshot: SharedSnapshot | None,
        target: tuple[float, float] | None = None,
    ) -> Separated:
        """The twist to drive now.

        Args:
            now: the time [s].
            state: the robot's state now, with the speeds that it really drives.
            desired: what its behaviour wants; None when it holds: then the robot stands still.
            snapshot: all robots; None when there is none or it is stale.
            target: where the behaviour is heading, x, y [m, world]; None when it has no such place.
        """
        fresh = snapshot is not None and self._certificate.learn(now, snapshot)
        if desired is None:
            return Separated(STILL, "")
        if not self._settings.enabled:
            return Separated(desired, "")
        if not all(map(math.isfinite, (*state, *desired))):
            return Separated(STILL, "brakes: its own state or the desired twist is not finite")
        if not fresh:
            return Separated(STILL, "brakes: no fresh positions")
        self._certificate.begin(now, state)
        return self._guide(now, state, desired, target)

    def _guide(self, now: float, state: State, desired: Twist2, target: tuple[float, float] | None) -> Separated:
        body, certificate = self._body, self._certificate
        near = certificate.near(now, state.x, state.y, _LOOK)
        ux, uy = velocity_of(state, desired)
        rows = rows_of(state.x, state.y, near)
        blocked = self._blocked(state, ux, uy, near)
        if blocked is None and all(row.nx * ux + row.ny * uy <= row.bound for row in rows) and not certificate.blocker(desired):
            return Separated(desired, "")
        reason = f"keeps clear of {blocked or certificate.blocker(desired) or (near[0].name if near else 'the wall')}"
        speed = math.hypot(ux, uy)
        if blocked is not None:
            ux, uy = self._turned(state, ux, uy, near)
        rows += self._wall_rows(state)
        wanted = guided(state, rows, ux, uy, max(speed, 0.1), body.omega_max)
        if not certificate.blocker(wanted):
            return Separated(wanted, reason)
        for share in (0.7, 0.4, 0.0):
            for omega in (wanted.omega, 0.0, body.omega_max, -body.omega_max):
                command = Twist2(wanted.v * share, omega)
                if not certificate.blocker(command):
                    return Separated(command, reason)
        return Separated(STILL, reason)

    def _wall_rows(self, state: State) -> list[Row]:
        keep = self._body.radius + self._settings.wall_margin
        arena = self._arena
        x, y = state.x, state.y
        free = ((1.0, 0.0, arena.x_max - x), (-1.0, 0.0, x - arena.x_min), (0.0, 1.0, arena.y_max - y), (0.0, -1.0, y - arena.y_min))
        return [Row(nx, ny, approach_speed(away - keep)) for nx, ny, away in free]

    def _blocked(self, state: State, ux: float, uy: float, near: list[Near]) -> str | None:
        for other in near:
            if time_to(state.x, state.y, ux, uy, other, other.keep) < _HORIZON:
                return other.name
        return None

    def _turned(self, state: State, ux: float, uy: float, near: list[Near]) -> tuple[float, float]:
        """The preferred velocity turned clockwise by the smallest angle that is free; else the longest free."""
        best, found = -1.0, (ux, uy)
        for k in range(9):
            angle = -k * math.pi / 12.0
            c, s = math.cos(angle), math.sin(angle)
            vx, vy = c * ux - s * uy, s * ux + c * uy
            free = min((time_to(state.x, state.y, vx, vy, other, other.keep) for other in near), default=math.inf)
            if self._leaves(state, vx, vy):
                free = min(free, 0.5)
            if free >= _HORIZON:
                return vx, vy
            if free > best:
                best, found = free, (vx, vy)
        return found

    def _leaves(self, state: State, vx: float, vy: float) -> bool:
        return not self._arena.shrunk(self._body.radius + self._settings.wall_margin).holds(state.x + vx * 1.0, state.y + vy * 1.0)
