"""What every trial must keep: promises, each a pure function of a record.

A promise counts how often it was evaluated: one that a whole check never evaluated is an error of the check, not a
promise kept. A record that begins late or has a gap is refused, because a breach could be in what was not seen.

What each applies to:

no contact (A)
    Every pair of robots, at every sample, while neither is *disturbed*: carried, driven by somebody else, or lying
    about its estimate, from the first effect until 2 s after the last and until it was 5 cm clear of every other body.
    A robot whose agent is dead or frozen, that is cut off or whose wheels jam is not disturbed.
driven into (B)
    Every disturbed robot that has stood where it is for 1.6 s, neither driven nor carried: no undisturbed robot that
    moves touches it.
named (B)
    Every robot that is carried, lies or is driven by somebody else: within 1 s of the first effect a health report has
    a reason with its name that it did not have before. One that repeats its last right estimate lies from when it is
    0.35 m or 0.9 rad from there. Not where another fault, at that time, befalls what the report
    needs: the robot, its processes, the base station, a camera or the router.
blind (C)
    Every robot that nobody else drives, at every sample: its wheels are commanded zero when the last good information
    is older than 0.45 s, or 0.6 s where the camera's age counts. The *last good information* is, of three, the one that
    is too old first: when the youngest command that its base has received from its own agent was sent (0.45 s); when
    the picture behind the youngest fix that its agent has received was taken (0.6 s); when the youngest snapshot of the
    fleet that its agent has received was sent (0.6 s; with the separation filter off it needs none). Times are true
    times, whatever the stamps say: a message that was long under way is old when it arrives.
braking (C)
    Every stop of an undisturbed robot that was commanded zero until it stood: from then on it travelled no further than
    its braking distance, at the speed that it had.
stop
    Every robot that is ordered to stop and that no fault concerns then: its wheels are commanded zero 0.45 s later.
    Every robot whose agent has latched a stop: its wheels are commanded zero 0.45 s later, until a resume that is not
    refused is given, or is on its way, or the agent dies.
inside
    Every robot, at every sample: its body is inside the arena, and reaches over no wall in it. One that was disturbed,
    from when it has been in, and off the wall, once.
behaves
    Every robot: its behaviour neither fails nor ends by itself.
survives
    Every process: it does not end by itself with an error.
finished
    Every trial goes on to its end.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from muro_zenoh.checking.contacts import ContactClass, contacts, disturbances
from muro_zenoh.checking.driving import CAMERA_AGE, COMMAND_AGE, blind, braking, stop
from muro_zenoh.checking.judgement import Breach, Judgement, episodes
from muro_zenoh.checking.naming import NAMED_WITHIN, named
from muro_zenoh.checking.record import PERIOD, Record
from muro_zenoh.checking.trace import HealthReport
from muro_zenoh.errors import MuroError

_OUTSIDE: Final = 1e-3
"""A body may reach this far over the arena's edge or a wall [m]: a robot put down beside it by its start."""


class Promise(NamedTuple):
    """A promise.

    Attributes:
        name: its name.
        says: what it says, in one line.
        judge: from a record to its judgement.
        always: whether there is something to evaluate in every trial, not only after some faults or orders.
    """

    name: str
    says: str
    judge: Callable[[Record], Judgement]
    always: bool = True


class IncompleteRecord(MuroError):  # noqa: N818 - reads as a state, and is one
    """A record cannot be judged, because not all of the trial is in it."""


def require_whole(record: Record) -> None:
    """Refuse a record that begins late, has a gap or ends early.

    Args:
        record: the record.

    Raises:
        IncompleteRecord: not all of the trial was watched.
    """
    time = record.time
    if not len(time) or time[0] > PERIOD:
        began = f"{time[0]:.2f} s" if len(time) else "never"
        raise IncompleteRecord(f"record: got a first sample at {began}, expected one at 0 s: it was watched too late")
    gap = float(np.diff(time).max(initial=0.0))
    if gap > 2.0 * PERIOD:
        raise IncompleteRecord(f"record: got a gap of {gap:.3f} s, expected a sample every {PERIOD:g} s")
    if record.finished and time[-1] < record.scenario.duration - 2.0 * PERIOD:
        raise IncompleteRecord(
            f"record: got the last sample at {time[-1]:.2f} s, expected one at {record.scenario.duration:g} s"
        )


# ---- A and B: contacts


def _no_contact(record: Record) -> Judgement:
    free = (~disturbances(record)).sum(axis=1)
    return Judgement(int((free * (free - 1) // 2).sum()), _of_class(record, ContactClass.OURS, "no contact", "touches"))


def _driven_into(record: Record) -> Judgement:
    evaluated = int(disturbances(record).any(axis=0).sum())
    return Judgement(evaluated, _of_class(record, ContactClass.STANDING, "driven into", "touches, standing,"))


def _of_class(record: Record, kind: ContactClass, promise: str, verb: str) -> tuple[Breach, ...]:
    return tuple(
        Breach(promise, contact.time, contact.robots, f"{contact.robots[0]} {verb} {contact.robots[1]}")
        for contact in contacts(record)
        if contact.kind is kind
    )


# ---- where, and to the end


def _inside(record: Record) -> Judgement:
    arena, breaches = record.scenario.arena, []
    disturbed = disturbances(record)
    for i, name in enumerate(record.names):
        radius = record.scenario.robot[name].radius
        x, y = record.pose[:, i, 0], record.pose[:, i, 1]
        beyond = np.maximum.reduce([arena.x_min - x, x - arena.x_max, arena.y_min - y, y - arena.y_max])
        reaches = [("leaves the arena", beyond)]
        reaches += [(f"touches {wall}", -wall.distance(x, y)) for wall in record.scenario.walls]
        for what, over in reaches:
            for first, last in episodes(over + radius > _OUTSIDE):
                if disturbed[first, i]:
                    continue  # it was put down there, or driven there by somebody else
                far = float(over[first:last].max()) + radius
                time = float(record.time[first])
                breaches.append(Breach("inside", time, (name,), f"{name} {what} (by {far:.2f} m)"))
    return Judgement(int((~disturbed).sum()), tuple(breaches))


def _behaves(record: Record) -> Judgement:
    evaluated: set[str] = set()
    failed: dict[str, HealthReport] = {}
    for report in record.reports:
        if report.process in record.names:
            evaluated.add(report.process)
            if report.failure:
                failed.setdefault(report.process, report)
    breaches = (Breach("behaves", report.time, (name,), f"{name}: {report.failure}") for name, report in failed.items())
    return Judgement(len(evaluated), tuple(breaches))


def _survives(record: Record) -> Judgement:
    breaches = tuple(
        Breach("survives", end.time, _robots_of(end.name, record), f"the process {end.name} ends with {end.error}")
        for end in record.ends
        if end.error
    )
    return Judgement(1, breaches)


def _robots_of(process: str, record: Record) -> tuple[str, ...]:
    robot = process.partition("/")[0]
    return (robot,) if robot in record.names else ()


def _finished(record: Record) -> Judgement:
    if record.finished:
        return Judgement(1, ())
    at = float(record.time[-1]) if len(record.time) else 0.0
    return Judgement(1, (Breach("finished", at, (), "the trial does not go on"),))


PROMISES: Final = (
    Promise("no contact", "robots that run the control loop and were not disturbed do not touch", _no_contact),
    Promise("driven into", "nobody drives into a disturbed robot that stands", _driven_into, always=False),
    Promise("named", f"a disturbed robot is named on health within {NAMED_WITHIN:g} s", named, always=False),
    Promise("blind", f"zero {COMMAND_AGE:g} s after the last good information ({CAMERA_AGE:g} s: camera)", blind),
    Promise("braking", "after a zero a robot travels at most its braking distance", braking, always=False),
    Promise("stop", f"a stopped robot stands, from {COMMAND_AGE:g} s on until it is resumed", stop, always=False),
    Promise("inside", "nobody leaves the arena or touches a wall", _inside),
    Promise("behaves", "no behaviour fails or ends by itself", _behaves),
    Promise("survives", "no process ends by itself with an error", _survives),
    Promise("finished", "every trial goes on to its end", _finished),
)
"""Every promise, most important first."""


def judge(record: Record) -> dict[str, Judgement]:
    """Judge a record by every promise.

    Args:
        record: the record.

    Returns:
        The judgements by the promise's name.

    Raises:
        IncompleteRecord: not all of the trial was watched.
    """
    require_whole(record)
    return {promise.name: promise.judge(record) for promise in PROMISES}
