"""The separation filter of one robot: a desired twist in, one that keeps clear of all others and the walls out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from muro_zenoh.geometry import STILL, Bounds, State, Twist2
from muro_zenoh.safety.separation.body import Body, SharedSnapshot
from muro_zenoh.safety.separation.certificate import WALL, Certificate, Wall
from muro_zenoh.safety.separation.guidance import Near, approach_speed, guided, rows_of, velocity_of
from muro_zenoh.safety.separation.liveness import HORIZON, Patience, first_met, free_direction, roomiest
from muro_zenoh.safety.separation.planner import Planner, Segment
from muro_zenoh.safety.separation.projection import Row
from muro_zenoh.safety.separation.settings import SeparationSettings

_LOOK = 1.6
_WANTS = 0.01


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
        self._inside = arena.shrunk(body.radius + settings.wall_margin)
        keep = body.radius + settings.wall_margin
        self._planner = Planner(self._inside, [Segment(x, y, p - x, q - y, keep) for x, y, p, q in walls])
        self._plan: list[tuple[float, float]] = []
        self._plan_next = self._plan_until = -math.inf
        self._patience = Patience(sorted({name, *others}).index(name))
        self._nominal = self._body = body
        self._settings = settings
        self._certificate = Certificate(name, body, others, arena, settings, walls)

    def step(
        self,
        now: float,
        state: State,
        desired: Twist2 | None,
        snapshot: SharedSnapshot | None,
        target: tuple[float, float] | None = None,
        body: Body | None = None,
    ) -> Separated:
        """The twist to drive now.

        Args:
            now: the time [s].
            state: the robot's state now, with the speeds that it really drives.
            desired: what its behaviour wants; None when it holds: then the robot stands still.
            snapshot: all robots; None when there is none or it is stale.
            target: where the behaviour is heading, x, y [m, world]; None when it has no such place.
            body: this robot's limits as its wheels are now, with their drive errors; None for those that all robots
                know of it, by which the lines between them are drawn.
        """
        self._body = body or self._nominal
        fresh = snapshot is not None and self._certificate.learn(now, snapshot)
        if desired is None:
            return Separated(STILL, "")
        if not self._settings.enabled:
            return Separated(desired, "")
        if not all(map(math.isfinite, (*state, *desired))):
            return Separated(STILL, "brakes: its own state or the desired twist is not finite")
        if not fresh:
            return Separated(STILL, "brakes: no fresh positions")
        self._certificate.begin(now, state, self._body)
        return self._guide(now, state, desired, target)

    def _guide(self, now: float, state: State, desired: Twist2, target: tuple[float, float] | None) -> Separated:
        body, certificate, patience = self._body, self._certificate, self._patience
        x, y = state.x, state.y
        near = certificate.near(now, x, y, _LOOK)
        ux, uy = velocity_of(state, desired)
        speed = math.hypot(ux, uy)
        stood = patience.look(now, state, speed > _WANTS)
        if speed <= _WANTS:
            return self._make_room(state, desired, near)
        ux, uy = self._way(now, state, ux, uy, target, near, stood)
        rows = rows_of(x, y, near)
        when, who = first_met(x, y, ux, uy, near)
        as_wanted = (ux, uy) == velocity_of(state, desired) and not patience.retreating
        if (
            as_wanted
            and when >= HORIZON
            and all(row.nx * ux + row.ny * uy <= row.bound for row in rows)
            and not certificate.blocker(desired)
        ):
            return Separated(desired, "")
        blocker = who.name if who else certificate.blocker(desired) or (near[0].name if near else WALL)
        reason = f"keeps clear of {blocker}"
        if patience.retreating:
            ux, uy = roomiest(state, near, self._inside, 0.2)
        elif when < HORIZON:
            ux, uy = free_direction(x, y, ux, uy, near, self._inside, patience.side)
        rows += self._wall_rows(state)
        wanted = guided(state, rows, ux, uy, max(speed, 0.1), body.omega_max)
        return Separated(self._certified(wanted, now, stood), reason)

    def _certified(self, wanted: Twist2, now: float, stood: float) -> Twist2:
        """The wanted twist, or one like it that passes."""
        body, certificate = self._body, self._certificate
        if not certificate.blocker(wanted):
            return self._fidget(wanted, now, stood)
        for share in (0.7, 0.4, 0.0):
            for omega in (wanted.omega, 0.0, body.omega_max, -body.omega_max):
                command = Twist2(wanted.v * share, omega)
                if not certificate.blocker(command):
                    return self._fidget(command, now, stood)
        return STILL

    def _fidget(self, command: Twist2, now: float, stood: float) -> Twist2:
        if stood < 1.0 or abs(command.v) > 0.02 or abs(command.omega) > 0.3:
            return command
        return Twist2(0.0, 0.4 if math.fmod(now, 2.0) < 1.0 else -0.4)

    def _make_room(self, state: State, desired: Twist2, near: list[Near]) -> Separated:
        """Parked: out of the way of who waits or comes."""
        for other in near:
            dx, dy = state.x - other.x, state.y - other.y
            away = math.hypot(dx, dy)
            busy = math.hypot(other.vx, other.vy) > 0.03 or abs(other.omega) > 0.15
            if not busy or away > other.keep + 0.25:
                continue
            if dx * math.cos(other.theta) + dy * math.sin(other.theta) < 0.25 * away:
                continue
            ux, uy = roomiest(state, near, self._inside, 0.15, other)
            if (ux, uy) == (0.0, 0.0):
                continue
            rows = rows_of(state.x, state.y, near) + self._wall_rows(state)
            wanted = guided(state, rows, ux, uy, 0.2, self._body.omega_max)
            return Separated(self._certified(wanted, 0.0, 0.0), f"makes room for {other.name}")
        if self._certificate.blocker(desired):
            return Separated(STILL, "")
        return Separated(desired, "")

    def _way(
        self,
        now: float,
        state: State,
        ux: float,
        uy: float,
        target: tuple[float, float] | None,
        near: list[Near],
        stood: float,
    ) -> tuple[float, float]:
        """The desired velocity, or the one along a planned way round."""
        if target is None:
            return ux, uy
        here = state.x, state.y
        if self._planner.sees(here, target) and stood < 1.0 and now >= self._plan_until:
            return ux, uy
        if now >= self._plan_next:
            slow = [(o.x, o.y, o.keep) for o in near if o.name != WALL and math.hypot(o.vx, o.vy) < 0.05]
            self._plan = self._planner.way(here, target, slow)
            self._plan_next = now + 1.0
            if stood >= 1.0:
                self._plan_until = now + 3.0
        reachable = (p for p in reversed(self._plan) if math.dist(p, here) <= 0.5 and self._planner.sees(here, p))
        ahead = next(reachable, None)
        if ahead is None or math.dist(ahead, here) < 0.05:
            return ux, uy
        speed, away = math.hypot(ux, uy), math.dist(ahead, here)
        return speed * (ahead[0] - state.x) / away, speed * (ahead[1] - state.y) / away

    def _wall_rows(self, state: State) -> list[Row]:
        keep = self._body.radius + self._settings.wall_margin
        arena = self._arena
        x, y = state.x, state.y
        free = (
            (1.0, 0.0, arena.x_max - x),
            (-1.0, 0.0, x - arena.x_min),
            (0.0, 1.0, arena.y_max - y),
            (0.0, -1.0, y - arena.y_min),
        )
        return [Row(nx, ny, approach_speed(away - keep)) for nx, ny, away in free]
