"""Whether robots that are carried, lie or are driven by somebody else are named to operators."""

from __future__ import annotations

from typing import Final

from muro_zenoh.checking.judgement import Breach, Judgement
from muro_zenoh.checking.record import Effect, Record
from muro_zenoh.config.faults import Place

NAMED_WITHIN: Final = 1.0
"""A disturbed robot is named on health within this time [s]."""


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
            if effect.start + NAMED_WITHIN > record.time[-1]:
                continue
            evaluated += 1
            if not _is_named(record, name, effect.start):
                what = f"nobody has named {name} ({effect.fault.kind}) for {NAMED_WITHIN:g} s"
                breaches.append(Breach("named", effect.start + NAMED_WITHIN, (name,), what))
    return Judgement(evaluated, tuple(breaches))


def _is_named(record: Record, name: str, start: float) -> bool:
    """Whether a new reason about a robot was reported."""
    before: dict[str, tuple[str, ...]] = {}
    for report in record.reports:
        if report.time <= start:
            before[report.process] = report.reasons
        elif report.time <= start + NAMED_WITHIN:
            known = {_words(reason) for reason in before.get(report.process, ())}
            for reason in report.reasons:
                if name in _words(reason) and _words(reason) not in known:
                    return True
    return False


def _words(reason: str) -> tuple[str, ...]:
    """The words of a reason, without its numbers: an age that grows makes no new reason."""
    words = (word.strip(",.:;()'\"") for word in reason.replace("'s", " ").split())
    return tuple(word for word in words if not word.replace(".", "").isdigit())


def _is_hampered(record: Record, effect: Effect) -> bool:
    """Whether another fault befalls what the report about a robot needs."""
    shared = (Place.BASESTATION, Place.CAMERA, Place.CAMERAS, Place.ROUTER)
    return any(
        other is not effect
        and (other.fault.place in shared or other.fault.robot in effect.robots)
        and other.start - NAMED_WITHIN < effect.start + NAMED_WITHIN
        and effect.start < other.end + NAMED_WITHIN
        for other in record.effects
    )
