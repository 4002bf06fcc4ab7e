"""Whether wheels are commanded zero when they must be, and how far robots travel then."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from muro_zenoh.checking.contacts import STANDING, disturbances
from muro_zenoh.checking.judgement import Breach, Judgement, between, episodes
from muro_zenoh.checking.operator import Ordered
from muro_zenoh.checking.record import PERIOD, Flags, Record

COMMAND_AGE: Final = 0.45
"""Wheels stand this time after the last good command, and after a stop was latched [s]."""

CAMERA_AGE: Final = 0.6
"""The same where the camera's age counts [s]."""

_SLACK: Final = 1.5 * PERIOD
"""A time is seen this much too late at most [s]: by the sampling and by the base's beat."""

_RECOVERED: Final = 3.0
"""Links and processes work again this time after a fault [s]."""

_TRAVEL_SLACK: Final = 0.01
"""Of a braking distance: the wheels' last step, and slip [m]."""


def blind(record: Record) -> Judgement:
    """Judge a record: nobody drives without fresh information.

    Args:
        record: the record.
    """
    driving = np.any(record.command != 0.0, axis=2)
    now = record.time[:, None]
    breaches = []
    late = {
        "the last command of its agent": now - record.good_command - COMMAND_AGE,
        "the last picture of it": now - record.good_pose - CAMERA_AGE,
    }
    if record.scenario.separation.enabled:
        late["the last snapshot of the fleet"] = now - record.good_snapshot - CAMERA_AGE
    judged = ~_driven_by_others(record)
    for what, excess in late.items():
        blind = driving & judged & (excess > _SLACK)
        for i, name in enumerate(record.names):
            for first, last in episodes(blind[:, i]):
                limit = COMMAND_AGE if "command" in what else CAMERA_AGE
                oldest = float((excess[first:last, i]).max()) + limit
                age = f"{oldest:.2f} s" if np.isfinite(oldest) else "never"
                breaches.append(
                    Breach("blind", float(record.time[first]), (name,), f"{name} drives blind ({what}: {age})")
                )
    return Judgement(int(judged.sum()), tuple(breaches))


def _driven_by_others(record: Record) -> Flags:
    """Whether somebody else drives each robot (T, N)."""
    driven = np.zeros((len(record.time), len(record.names)), dtype=bool)
    for i, name in enumerate(record.names):
        for effect in record.effects_on(name, "foreign_driver"):
            driven[between(record, effect.start - PERIOD, effect.end + COMMAND_AGE), i] = True
    return driven


def braking(record: Record) -> Judgement:
    """Judge a record: a robot travels at most its braking distance.

    Args:
        record: the record.
    """
    evaluated, breaches = 0, []
    disturbed = disturbances(record)
    travelled = np.zeros(disturbed.shape)
    travelled[1:] = np.cumsum(np.hypot(*np.moveaxis(np.diff(record.pose[..., :2], axis=0), -1, 0)), axis=0)
    zero = np.all(record.command == 0.0, axis=2)
    slowest = 1.0 - record.scenario.simulation.drive_error
    for i, name in enumerate(record.names):
        robot = record.scenario.robot[name]
        speed = np.abs(record.twist[:, i, 0])
        for first, last in episodes(zero[:, i]):
            stood = np.flatnonzero(speed[first:last] < STANDING)
            if not first or not len(stood) or disturbed[first:last, i].any():
                continue  # it stood from the start, or drove on before it stood
            evaluated += 1
            v = float(speed[first - 1])
            allowed = v * (robot.lag + PERIOD) + 0.5 * v * v / (robot.brake * slowest) + _TRAVEL_SLACK
            way = float(travelled[last - 1, i] - travelled[first, i])
            if way > allowed:
                what = f"{name} travels {way:.2f} m after its command is zero, expected at most {allowed:.2f} m,"
                breaches.append(Breach("braking", float(record.time[first]), (name,), what))
    return Judgement(evaluated, tuple(breaches))


def stop(record: Record) -> Judgement:
    """Judge a record: a stopped robot stands, and a robot that is ordered to stop is stopped.

    Args:
        record: the record.
    """
    driving = np.any(record.command != 0.0, axis=2) & ~_driven_by_others(record)
    latched, ordered = _latched(record, driving), _ordered(record, driving)
    return Judgement(latched.evaluated + ordered.evaluated, latched.breaches + ordered.breaches)


def _ordered(record: Record, driving: Flags) -> Judgement:
    """Robots that no fault concerns obey at once, also those that do not say that they have latched the stop."""
    evaluated, breaches = 0, []
    for given in record.orders:
        if given.order.kind != "stop":
            continue
        begin = given.time + COMMAND_AGE + _SLACK
        for name in given.order.robots or record.names:
            i = record.names.index(name)
            effects = [effect for effect in record.effects if name in effect.robots]
            if any(effect.start < begin and effect.end > given.time - _RECOVERED for effect in effects):
                continue
            evaluated += 1
            if record.latched[between(record, given.time, begin), i].any():
                continue  # from then on it is judged by that
            resumes = (o.time for o in _resumes(record, name) if o.answered > given.time)
            end = min([*resumes, *(effect.start for effect in effects if effect.start >= begin)], default=math.inf)
            wrong = between(record, begin, end) & driving[:, i]
            if wrong.any():
                at = float(record.time[np.argmax(wrong)])
                breaches.append(Breach("stop", at, (name,), f"{name} drives although it was ordered to stop"))
    return Judgement(evaluated, tuple(breaches))


def _resumes(record: Record, name: str) -> list[Ordered]:
    """Those that may have lifted a robot's stop; one without an answer may have been accepted: the answer was lost."""
    return [
        given
        for given in record.orders
        if given.order.kind == "resume"
        and given.accepted is not False
        and (not given.order.robots or name in given.order.robots)
    ]


def _latched(record: Record, driving: Flags) -> Judgement:
    evaluated, breaches = 0, []
    for i, name in enumerate(record.names):
        resumes = _resumes(record, name)
        deaths = [effect.start for effect in record.effects_on(name, "crash", "restart")]
        for first, _ in episodes(record.latched[:, i]):
            evaluated += 1
            begin = float(record.time[first])
            # A latch that opens without a resume is a breach like one that does not hold, so it holds until then.
            # One that was on its way when the robot latched the stop (both held up by a frozen router) may lift it.
            lifts = [max(given.time, begin) for given in resumes if given.answered > begin]
            ends = [*lifts, *(time for time in deaths if time > begin)]
            end = min(ends, default=float(record.time[-1]))
            wrong = between(record, begin + COMMAND_AGE + _SLACK, end) & driving[:, i]
            if wrong.any():
                at = float(record.time[np.argmax(wrong)])
                breaches.append(Breach("stop", at, (name,), f"{name} drives although it was stopped"))
    return Judgement(evaluated, tuple(breaches))
