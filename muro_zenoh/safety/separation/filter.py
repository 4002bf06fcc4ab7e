"""The separation filter of one robot: a desired twist in, one that keeps clear of all others and the walls out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from muro_zenoh.geometry import STILL, Bounds, State, Twist2
from muro_zenoh.safety.separation.body import Body, SharedSnapshot
from muro_zenoh.safety.separation.certificate import Certificate, Wall
from muro_zenoh.safety.separation.settings import SeparationSettings


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
        if not self._certificate.blocker(desired):
            return Separated(desired, "")
        reason = f"keeps clear of {self._certificate.blocker(desired)}"
        body = self._body
        commands = [
            Twist2(desired.v * share, omega)
            for share in (1.0, 0.75, 0.5, 0.25, 0.0)
            for omega in (desired.omega, *(body.omega_max * k / 3.0 for k in range(-3, 4)))
        ]
        commands.sort(key=lambda c: math.hypot(c.v - desired.v, 0.15 * (c.omega - desired.omega)))
        for command in commands:
            if not self._certificate.blocker(command):
                return Separated(command, reason)
        return Separated(STILL, reason)
