"""Right of way where two robots cannot pass: it is the turn of the side on which a robot has waited longest.

How long the others have waited each robot knows from what it has seen itself. Each robot more that drives or waits on
one side counts like a second: a side that has passed as a whole is shut in by those who still wait on the other. While
nobody has waited, the sides take turns by the clock that all share. A side whose turn it is goes, one robot after
another, and so does the other while nobody comes from that side. Who is inside goes on. Those who wait line up beside
the gate, on their right, and leave its middle to those who come out.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from muro_zenoh.geometry import Bounds
from muro_zenoh.safety.separation.guidance import FIDGET, Near
from muro_zenoh.safety.separation.line import Point, Stretch, nearest_points
from muro_zenoh.walls import Wall, edges

_WIDEST: Final = 1.5
"""A passage is a gate below this multiple of what two robots need side by side."""
_ROUNDING: Final = 1e-9
_ZONE: Final = 1.5
"""Robots this near to a gate's middle take part in its traffic [m]."""
_TURN: Final = 8.0
"""For how long it is one side's turn by the clock [s]: two or three robots pass."""
_WAITED: Final = 1.0
"""The clock decides until a robot has waited for this time [s]."""
_PATIENT: Final = 16.0
"""One that has waited for this time has had its turn and did not go: its side has no turn because of it [s]."""
_EACH: Final = 1.0
"""So much longer a side counts as having waited for each robot that it has more than the other [s] ..."""
_AT_MOST: Final = 8.0
"""... and so much for all of them [s]: a few robots get through among many."""
_PLACE: Final = 0.3
"""A robot that has come further than this from where it began to wait has got on [m]."""
_PAUSE: Final = 1.0
"""One that has neither driven nor turned for this time, or was out of sight for it, has not waited: it begins anew
[s]."""
_SPOTS: tuple[tuple[float, float], ...] = ((0.55, 0.55), (0.6, 1.05), (1.05, 0.75), (1.1, 1.25), (1.55, 0.9))
"""Where to wait, the nearest to the gate first: back from its middle, and to the robot's right [m]."""
_APART: Final = 0.5
"""Of those whose turn it is, each keeps this further from the gate's middle than the one before it [m]."""
_INSIDE: Final = 0.1
"""Robots count as inside a gate up to this beyond half its width from its middle [m]."""
_OUT: Final = 0.25
"""One that comes out lets nobody wait any longer when its centre is this far beyond the gate's middle [m]."""


class Gate(NamedTuple):
    """A narrow passage: its middle ``x``, ``y`` [m, world] and the direction across its walls, ``nx``, ``ny``, a unit
    vector along which robots pass; ``half``, half its width [m]."""

    x: float
    y: float
    nx: float
    ny: float
    half: float


def gates_between(walls: Sequence[Wall], arena: Bounds, keep: float) -> list[Gate]:
    """The narrow passages between walls, and between walls and the arena's.

    Args:
        walls: the walls inside the arena.
        arena: the floor.
        keep: what a robot's centre keeps from a wall [m].
    """
    every = (*walls, *edges(arena))
    gates = []
    for k, wall in enumerate(walls):
        for other in every[k + 1 :]:
            (ax, ay), (bx, by) = nearest_points(_stretch(wall), _stretch(other))
            width = math.hypot(bx - ax, by - ay)
            x, y = 0.5 * (ax + bx), 0.5 * (ay + by)
            if not 2.0 * keep <= width <= _WIDEST * 4.0 * keep:
                continue
            # None where the two cross, or a third wall stands between them: that is nearer to the middle.
            if all(each.distance(x, y) > 0.5 * width - _ROUNDING for each in every):
                gates.append(Gate(x, y, -(by - ay) / width, (bx - ax) / width, 0.5 * width))
    return gates


def _stretch(wall: Wall) -> Stretch:
    return Stretch(*wall, 0.0, 0.0, 0.0)


def gate_ahead(gates: Sequence[Gate], way: Sequence[Point]) -> Gate | None:
    """The first gate that a planned way goes through; None when there is none near.

    Args:
        gates: all gates.
        way: from the robot's position on [m, world].
    """
    for (ax, ay), (bx, by) in itertools.pairwise(way):
        for gate in gates:
            before = (ax - gate.x) * gate.nx + (ay - gate.y) * gate.ny
            after = (bx - gate.x) * gate.nx + (by - gate.y) * gate.ny
            if before * after <= 0.0 and before != after:
                s = before / (before - after)
                x, y = ax + s * (bx - ax), ay + s * (by - ay)
                if math.hypot(x - gate.x, y - gate.y) <= gate.half and math.dist((gate.x, gate.y), way[0]) < _ZONE:
                    return gate
    return None


class Wait(NamedTuple):
    """A robot at ``x``, ``y`` [m, world] that has waited for some ``seconds``."""

    x: float
    y: float
    seconds: float


class _Stay(NamedTuple):
    x: float
    y: float
    since: float
    took_part: float


class Waits:
    """For how long this robot and those that it sees have waited."""

    def __init__(self) -> None:
        self._stays: dict[str, _Stay] = {}

    def look(self, now: float, here: Point, near: Sequence[Near]) -> list[Wait]:
        """The robots that wait, or drive and have not come far yet.

        Args:
            now: the time [s].
            here: the position of the robot that looks, and that is on its way [m, world].
            near: the neighbours.
        """
        part = [("", *here), *((other.name, other.x, other.y) for other in near if _takes_part(other))]
        for name, x, y in part:
            stay = self._stays.get(name)
            if stay is None or math.dist((stay.x, stay.y), (x, y)) > _PLACE or now - stay.took_part >= _PAUSE:
                stay = _Stay(x, y, now, now)
            self._stays[name] = stay._replace(took_part=now)
        self._stays = {name: stay for name, stay in self._stays.items() if now - stay.took_part < _PAUSE}
        return [Wait(stay.x, stay.y, now - stay.since) for stay in self._stays.values()]


def _has_turn(gate: Gate, sign: float, waits: Sequence[Wait], drive: Sequence[Point], clock: float) -> bool:
    """Whether it is the turn of one side of a gate, the one toward which its direction points for a ``sign`` of +1."""
    longest = {True: 0.0, False: 0.0}
    for wait in waits:
        dx, dy = wait.x - gate.x, wait.y - gate.y
        if math.hypot(dx, dy) < _ZONE and wait.seconds < _PATIENT:
            mine = sign * (dx * gate.nx + dy * gate.ny) > 0.0
            longest[mine] = max(longest[mine], wait.seconds)
    more = sum(math.copysign(_EACH, sign * ((x - gate.x) * gate.nx + (y - gate.y) * gate.ny)) for x, y in drive)
    ahead = longest[True] - longest[False] + min(max(more, -_AT_MOST), _AT_MOST)
    if max(longest.values()) < _WAITED or ahead == 0.0:
        return (math.fmod(clock, 2.0 * _TURN) < _TURN) == (sign > 0.0)
    return ahead > 0.0


def place_to_wait(
    gate: Gate,
    x: float,
    y: float,
    near: Sequence[Near],
    clock: float,
    waits: Sequence[Wait] = (),
    fleet: Sequence[Near] = (),
) -> Point | None:
    """Where a robot waits that has to let others through first; None when it may go.

    Args:
        gate: the gate in its way.
        x: its position [m, world].
        y: the same.
        near: the neighbours.
        clock: the time that all robots share [s].
        waits: the robots that wait, itself among them.
        fleet: all other robots, however far.
    """
    sign = 1.0 if (x - gate.x) * gate.nx + (y - gate.y) * gate.ny >= 0.0 else -1.0
    nx, ny = sign * gate.nx, sign * gate.ny
    mine = math.hypot(x - gate.x, y - gate.y)
    drive = [(x, y), *((other.x, other.y) for other in fleet if _takes_part(other))]
    goes = mine < gate.half + _INSIDE or _has_turn(gate, sign, waits, drive, clock)
    before, lets_through = 0, False
    for other in near:
        if not _takes_part(other):
            continue
        px, py = other.x - gate.x, other.y - gate.y
        theirs = math.hypot(px, py)
        across = px * nx + py * ny
        coming = math.cos(other.theta) * nx + math.sin(other.theta) * ny
        if theirs < gate.half + _INSIDE and across < _OUT and coming > 0.2:
            lets_through |= theirs < mine
        if across < -0.05 and theirs < _ZONE and coming > -0.5:
            lets_through |= not goes
        if across > 0.05 and theirs < mine and coming < -0.3:
            before += 1
    if not lets_through:
        return (x, y) if mine < _APART * before else None
    back, right = _SPOTS[min(before, len(_SPOTS) - 1)]
    # looking at the gate, -n, the right is n turned counter-clockwise
    return gate.x + back * nx - right * ny, gate.y + back * ny + right * nx


def _takes_part(other: Near) -> bool:
    """Whether a neighbour drives or waits to; one that is parked does not.

    One that waits is overlooked for a moment whenever it turns the other way. Without that chance to go first, more
    robots stand for ten seconds (in 11 of 80 doorways in place of 5, when turns were by the clock).
    """
    return math.hypot(other.vx, other.vy) > 0.03 or abs(other.omega) > 0.5 * FIDGET
