"""The separation filter of one robot: a desired twist in, one that keeps clear of all others and the walls out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from muro_zenoh.geometry import STILL, Bounds, State, Twist2
from muro_zenoh.safety.separation.body import Body, SharedSnapshot
from muro_zenoh.safety.separation.certificate import Certificate
from muro_zenoh.safety.separation.courtesy import Courtesy
from muro_zenoh.safety.separation.guidance import FIDGET, UNHURRIED, Near, guided, rows_of, velocity_of, wall_rows
from muro_zenoh.safety.separation.knowledge import WALL, Knowledge
from muro_zenoh.safety.separation.line import Point
from muro_zenoh.safety.separation.liveness import (
    HORIZON,
    Patience,
    first_met,
    free_direction,
    free_speed,
    goes_along,
    roomiest,
)
from muro_zenoh.safety.separation.route import Route
from muro_zenoh.safety.separation.settings import SeparationSettings
from muro_zenoh.walls import Wall

_LOOK: Final = 1.6
"""Robots and walls nearer than this are looked at [m]."""
_WANTS: Final = 0.01
"""A robot that wants to drive slower than this is where it wants to be [m/s]."""
_SLOW: Final = 0.2
"""A robot that gets out of the way drives this fast [m/s]."""
_AHEAD_OF_WHEELS: Final = 0.55
"""A changed command asks for a turning rate at most so far from the one that is driven [rad/s]: commands that jump
further shake the wheels, and with less a crowd takes longer to dissolve. Measured on ten robots that swap places."""
_ELSEWHERE: Final = 0.3
"""A target that has moved further is another one [m]."""
_MOMENT: Final = 1.0
"""A robot that is kept from what it wants may do it in between for less than this [s]."""
_NEARLY_THERE: Final = 0.15
"""Nearer to its target a robot may stand without losing patience [m]."""


class Separated(NamedTuple):
    """The twist to drive: ``twist``; and why it is not the desired one, ``reason``, empty when it is."""

    twist: Twist2
    reason: str


class Separation:
    """The filter of one robot. It keeps its own state; the same inputs give the same outputs.

    Args:
        name: the robot's name.
        body: its size and limits.
        others: the bodies of the fleet by name, with or without its own; a robot that is not there is foreign and may
            be as large as the largest.
        arena: the floor with walls around it.
        settings: how to keep apart.
        walls: the walls inside the arena.
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
        self._nominal = self._body = body
        self._settings = settings
        keep = body.radius + settings.wall_margin
        self._inside = arena.shrunk(keep)
        self._known = Knowledge(name, body, others, settings, walls)
        self._route = Route(arena, self._inside, walls, keep)
        self._target: Point | None = None
        self._free = True
        """Whether the robot did as it wanted in the last step."""
        self._kept_at = -math.inf
        """When it last did not [s]."""
        self._courtesy = Courtesy(self._route.gates)
        self._patience = Patience(sorted({name, *others}).index(name))

    def learn(self, now: float, snapshot: SharedSnapshot) -> None:
        """Take a snapshot that came before the newest one: others keep apart by it.

        Args:
            now: the time [s].
            snapshot: all robots.
        """
        self._known.learn(now, snapshot)

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
        blind = self._known.learn(now, snapshot)
        if desired is None:
            self._begin_anew()
            return Separated(STILL, "")
        if not self._settings.enabled:
            return Separated(desired, "")
        if not all(map(math.isfinite, (*state, *desired))):
            return Separated(STILL, "brakes: its own state or the desired twist is not finite")
        if blind:
            self._begin_anew()
            return Separated(STILL, f"brakes: {blind}")
        wanted = self._within_limits(desired)
        velocity = _preferred(state, wanted, target)
        speed = math.hypot(*velocity)
        fastest = max(abs(wanted.v), speed, _SLOW)
        certificate = Certificate(state, self._body, self._inside, self._known, self._settings, fastest)
        near = self._known.near(now, state.x, state.y, _LOOK)
        if _is_elsewhere(target, self._target):
            self._begin_anew()
            self._target = target
        far = target is None or math.dist(target, (state.x, state.y)) > _NEARLY_THERE
        rests = speed <= _WANTS
        # One that cannot get any nearer to its place in a passage is parked there as well.
        parked = rests or (target is not None and not far and not self._free and self._courtesy.blocks(target))
        room = self._courtesy.look(now, state, parked, target, near, self._inside)
        if not self._free:
            self._kept_at = now
        # In a passage one that may turn as it wants for a moment does not get on either.
        kept = not self._free or (self._route.passes and now - self._kept_at < _MOMENT)
        wants = not rests and far and kept and room is None
        stood = self._patience.look(now, state, wants, self._route.waits)
        if rests or room is not None:
            self._route.leave()
        if room is not None:
            given, reason = self._make_room(state, *room, near, certificate)
        elif rests:
            blocker = certificate.blocker(wanted)
            given, reason = Separated(STILL, f"keeps clear of {blocker}") if blocker else Separated(wanted, "")
        else:
            if self._courtesy.returns and speed > UNHURRIED:
                velocity = velocity[0] * UNHURRIED / speed, velocity[1] * UNHURRIED / speed
                wanted = guided(state, (), *velocity, UNHURRIED, self._body.omega_max)
            clock = snapshot.stamp + snapshot.age if snapshot is not None else now
            given, reason = self._get_past(now, state, wanted, velocity, near, certificate, target, stood, clock)
            if not reason and self._courtesy.returns and speed > UNHURRIED:
                reason = "goes back to where it made room"
        self._free = not reason
        return Separated(given if reason else desired, reason)

    def _begin_anew(self) -> None:
        """The robot is not on its way, or on its way to another place: it has not stood in anybody's way yet."""
        self._free = True
        self._route.leave()
        self._patience.begin_anew()

    def _get_past(
        self,
        now: float,
        state: State,
        wanted: Twist2,
        desired: Point,
        near: list[Near],
        certificate: Certificate,
        target: Point | None,
        stood: float,
        clock: float,
    ) -> Separated:
        """The wanted twist when it is free; else one that gets past those who are in the way."""
        x, y = state.x, state.y
        patience = self._patience
        velocity = desired
        if target is not None:
            gives_way = not patience.retreating
            fleet = self._known.near(now, x, y, math.inf) if self._route.gates else ()
            velocity = self._route.toward(now, (x, y), desired, target, near, stood, gives_way, clock, fleet)
        else:
            self._route.leave()
        backs_off = patience.backs_off(self._route.at_gate and not self._route.passes)
        ux, uy = velocity
        rows = rows_of(x, y, near)
        parked = self._route.parked if target is not None and velocity != desired else ()
        when, who = first_met(x, y, ux, uy, [other for other in near if other not in parked] if parked else near)
        is_free = when >= HORIZON and all(nx * ux + ny * uy <= bound for nx, ny, bound in rows)
        blocker = certificate.blocker(wanted) if is_free or who is None else ""  # else it gives way to that one anyhow
        if is_free and not blocker and velocity == desired and not backs_off:
            return Separated(wanted, "")
        if backs_off:
            ux, uy = roomiest(state, near, self._inside, _SLOW, may_stay=not self._route.at_gate)
        elif who is not None and when < HORIZON:
            if (target is None or self._route.passes) and goes_along(who, ux, uy):
                ux, uy = free_speed(x, y, ux, uy, near)
            else:
                ux, uy = free_direction(x, y, ux, uy, near, self._inside, patience.side)
        rows += wall_rows(x, y, self._inside)
        speed = max(math.hypot(*desired), 0.5 * _SLOW)
        twist = self._within_limits(guided(state, rows, ux, uy, speed, self._body.omega_max))
        name = who.name if who is not None else blocker or (near[0].name if near else WALL)
        waits = self._route.waits
        if waits and twist == STILL:
            twist = self._route.face_gate(state)
        twist = self._certified(state, twist, certificate, now if stood >= 1.0 or waits else None)
        return Separated(twist, f"keeps clear of {name}")

    def _make_room(
        self, state: State, velocity: Point, other: str, near: list[Near], certificate: Certificate
    ) -> Separated:
        rows = rows_of(state.x, state.y, near) + wall_rows(state.x, state.y, self._inside)
        twist = guided(state, rows, *velocity, _SLOW, self._body.omega_max) if velocity != (0.0, 0.0) else STILL
        return Separated(self._certified(state, twist, certificate, None), f"makes room for {other}")

    def _certified(self, state: State, twist: Twist2, certificate: Certificate, waits: float | None) -> Twist2:
        """The twist, or one like it that passes; a robot that waits turns to and fro, so that others see it.

        Turning rates are near the one that is driven, and of two sides the one to which the robot turns comes first.
        """
        top = self._body.omega_max
        driven = min(max(state.omega, -top), top)
        low, high = max(-top, driven - _AHEAD_OF_WHEELS), min(top, driven + _AHEAD_OF_WHEELS)
        wanted, straight = (min(max(omega, low), high) for omega in (twist.omega, 0.0))
        turning = state.omega if abs(state.omega) > 0.1 else twist.omega
        on, back = (low, high) if math.copysign(1.0, turning) < 0.0 else (high, low)
        turns = (wanted, straight, on, back)
        tries = [(1.0, wanted), *((share, omega) for share in (0.7, 0.4, 0.0) for omega in turns)]
        commands = (Twist2(share * twist.v, omega) for share, omega in tries)
        found = next((command for command in commands if not certificate.blocker(command)), STILL)
        if waits is not None and abs(found.v) <= 0.02 and abs(found.omega) <= 0.3:
            to_and_fro = Twist2(0.0, FIDGET if math.fmod(waits, 2.0) < 1.0 else -FIDGET)
            return found if certificate.blocker(to_and_fro) else to_and_fro
        return found

    def _within_limits(self, twist: Twist2) -> Twist2:
        v_max, omega_max = self._body.v_max, self._body.omega_max
        return Twist2(min(max(twist.v, -v_max), v_max), min(max(twist.omega, -omega_max), omega_max))


def _is_elsewhere(target: Point | None, before: Point | None) -> bool:
    if target is None or before is None:
        return target is not before
    return math.dist(target, before) > _ELSEWHERE


def _preferred(state: State, wanted: Twist2, target: Point | None) -> Point:
    """The velocity that a behaviour wants: of the point ahead when it steers that to a place; otherwise in the same
    direction with the speed along its curve, because it may turn as fast as it likes."""
    ux, uy = velocity_of(state, wanted)
    speed = math.hypot(ux, uy)
    most = max(abs(wanted.v), 0.5 * _SLOW)
    if target is None and speed > most:
        return ux * most / speed, uy * most / speed
    return ux, uy
