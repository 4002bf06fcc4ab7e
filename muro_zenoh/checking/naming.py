"""Whether robots that are carried, lie or are driven by somebody else are named to operators."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from muro_zenoh.checking.judgement import Breach, Judgement
from muro_zenoh.checking.record import PERIOD, Incident, Record
from muro_zenoh.config.faults import CarryFault, LieFault, Place

NAMED_WITHIN: Final = 1.0
"""A disturbed robot is named on health within this time [s]."""

_ELSEWHERE: Final = 0.35
_TURNED: Final = 0.9
"""A robot that repeats an old estimate is not where it says when it is off by more than this [m], [rad]: what the base
station lets pass (0.25 m, 0.6 rad), and what a robot drives while its estimate is under way."""

_SHORTEST: Final = 0.4
"""The shortest lie of a trial [s]."""

_WITHIN: Final = 0.4
_STANDING_OFF: Final = 0.05
_SHARE: Final = 0.7
_MOST_OFF: Final = 0.12
"""A robot is carried off when within this time [s] it is moved otherwise than its wheels were commanded to by this [m]
and this share of the way that they were commanded to drive, or by this [m]. One that is carried along its own way about
as fast as it drives looks like one that drives."""

_CLOCK_SETTLES: Final = 3.0
"""A clock that was set concerns reports for this time [s]: until clocks have been compared again."""


def named(record: Record) -> Judgement:
    """Judge a record: a disturbed robot is named in time.

    Args:
        record: the record.
    """
    evaluated, breaches = 0, []
    for effect in record.effects:
        if effect.fault.kind not in ("carry", "lie", "foreign_driver") or _is_hampered(record, effect):
            continue
        for name in effect.robots:
            start = _wrong_from(record, name, effect)
            if start + NAMED_WITHIN > record.time[-1] or _is_unseen(record, name, effect):
                continue
            evaluated += 1
            if not _is_named(record, name, effect.start, start + NAMED_WITHIN):
                what = f"nobody has named {name} ({effect.fault.kind}) for {NAMED_WITHIN:g} s"
                breaches.append(Breach("named", start + NAMED_WITHIN, (name,), what))
    return Judgement(evaluated, tuple(breaches))


def _wrong_from(record: Record, name: str, effect: Incident) -> float:
    """From when a robot is not what it says; infinite when it never was. One that is carried has to leave its own way.
    One that repeats its last right estimate lies only once it is elsewhere, for as long as any lie lasts."""
    if isinstance(effect.fault, CarryFault):
        return _carried_off_from(record, name, effect)
    if not isinstance(effect.fault, LieFault) or not effect.fault.stuck:
        return effect.start
    i, first = record.names.index(name), int(np.searchsorted(record.time, effect.start))
    last = int(np.searchsorted(record.time, effect.end - _SHORTEST))
    off = record.pose[first:last, i] - record.pose[first, i]
    wrong = (np.hypot(off[:, 0], off[:, 1]) > _ELSEWHERE) | (np.abs(np.angle(np.exp(1j * off[:, 2]))) > _TURNED)
    return float(record.time[first + int(np.argmax(wrong))]) if wrong.any() else math.inf


def _carried_off_from(record: Record, name: str, effect: Incident) -> float:
    i = record.names.index(name)
    theta, ways = record.pose[:, i, 2], record.pose[:, i, :2]
    driven = PERIOD * record.command[:, i, :1] * np.stack((np.cos(theta), np.sin(theta)), axis=1)
    strange = ways - np.cumsum(driven, axis=0)
    first, last = np.searchsorted(record.time, (effect.start, effect.end))
    then = np.minimum(np.arange(first, last) + round(_WITHIN / PERIOD), len(strange) - 1)
    along = np.cumsum(PERIOD * np.abs(record.command[:, i, 0]))
    limit = np.minimum(_MOST_OFF, _STANDING_OFF + _SHARE * (along[then] - along[first:last]))
    off = np.hypot(*(strange[then] - strange[first:last]).T) > limit
    return float(record.time[first + int(np.argmax(off))]) if off.any() else math.inf


def _is_named(record: Record, name: str, start: float, end: float) -> bool:
    """Whether a reason about a robot was reported that was not there before."""
    before: dict[str, tuple[str, ...]] = {}
    for report in record.reports:
        if report.time <= start:
            before[report.process] = report.reasons
        elif report.time <= end:
            known = {_words(reason) for reason in before.get(report.process, ())}
            for reason in report.reasons:
                if name in _words(reason) and _words(reason) not in known:
                    return True
    return False


def _is_unseen(record: Record, name: str, effect: Incident) -> bool:
    """Whether a robot was carried while no picture of it reached anybody, such as long after a clock was set."""
    at = min(int(np.searchsorted(record.time, effect.start + NAMED_WITHIN)), len(record.time) - 1)
    return effect.fault.kind == "carry" and bool(record.good_pose[at, record.names.index(name)] < effect.start)


def _words(reason: str) -> tuple[str, ...]:
    """The words of a reason, without its numbers: an age that grows makes no new reason."""
    words = (word.strip(",.:;()'\"") for word in reason.replace("'s", " ").split())
    return tuple(word for word in words if not word.replace(".", "").isdigit())


def _is_hampered(record: Record, effect: Incident) -> bool:
    """Whether another fault befalls what the report about a robot needs."""
    shared = (Place.BASESTATION, Place.CAMERA, Place.CAMERAS, Place.ROUTER)
    return any(
        other is not effect
        and (other.fault.place in shared or other.fault.robot in effect.robots)
        and other.start - NAMED_WITHIN < effect.start + NAMED_WITHIN
        and effect.start < _over(other) + NAMED_WITHIN
        for other in record.effects
    )


def _over(effect: Incident) -> float:
    return max(effect.end, effect.start + _CLOCK_SETTLES) if effect.fault.kind == "clock_step" else effect.end
