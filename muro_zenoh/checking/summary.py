"""A check's report as text, and as a table for JSON."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from muro_zenoh import is_compiled
from muro_zenoh.checking.check import COVERING, Report
from muro_zenoh.checking.contacts import ContactClass
from muro_zenoh.checking.coverage import CELLS, Activity, as_nested
from muro_zenoh.checking.judgement import Breach
from muro_zenoh.checking.promises import PROMISES
from muro_zenoh.errors import MuroError
from muro_zenoh.wording import counted

_WORST: Final = 10
"""So many seeds are listed."""


def as_table(report: Report) -> dict[str, Any]:
    """A report for JSON.

    Args:
        report: the report.
    """
    results = report.results.values()
    collisions: Counter[str] = Counter({str(kind): 0 for kind in ContactClass})
    for result in results:
        collisions.update(result.contacts)
    breaches = Counter({promise.name: 0 for promise in PROMISES})
    for result in results:
        breaches.update(breach.promise for breach in result.breaches)
    separation = min((result.separation for result in results), default=math.inf)
    return {
        "trials": len(results),
        "passed": report.passed,
        "seed": report.plan.seed,
        "replaced": len(report.replaced),
        "repeated": report.repeated,
        "not_repeatable": len(report.unlike),
        "collisions": dict(collisions),
        "min_separation_m": round(separation, 4) if math.isfinite(separation) else None,
        "left_arena": breaches["inside"],
        "blind_moves": breaches["blind"],
        "unfinished": breaches["finished"] + len(report.failures),
        "breaches": dict(breaches),
        "evaluated": dict(report.evaluated),
        "simulated_s": round(sum(result.duration for result in results), 1),
        "wall_s": round(report.wall, 1),
        "times_real_time": round(report.times_real_time, 1),
        "compiled": is_compiled(),
        "interrupted": report.interrupted,
        "worst": [result.seed for result in report.broken[:_WORST]] or [r.seed for r in report.by_severity()[:3]],
        "problems": report.problems(),
        "coverage": as_nested(report.met),
    }


def summary(report: Report, how: str) -> str:
    """A report as lines of text, the worst seeds first.

    Args:
        report: the report.
        how: the command that replays a seed, without the seed, such as ``muro check random --replay``.
    """
    return "\n".join((*_worst(report, how), *_numbers(report), *_verdict(report)))


def _worst(report: Report, how: str) -> Iterator[str]:
    for result in report.broken[:_WORST]:
        yield f"seed {result.seed}: {result.breaches[0]}"
        for breach in result.breaches[1:3]:
            yield f"    then {breach}"
        yield f"    {how} {result.seed}"
    if len(report.broken) > _WORST:
        yield f"... and {counted(len(report.broken) - _WORST, 'more seed')}"


def _numbers(report: Report) -> Iterator[str]:
    table = as_table(report)
    trials = counted(table["trials"], "trial")
    jobs = "1 process" if report.plan.jobs == 1 else f"{report.plan.jobs} processes"
    yield (
        f"{trials}, {table['simulated_s']:.0f} s simulated in {table['wall_s']:.0f} s by {jobs}; "
        f"{table['times_real_time']:g} times real time on one core" + (", compiled" if table["compiled"] else "")
    )
    if report.replaced:
        stood = sum(1 for result in report.replaced.values() if "%" in result.lacks)
        others = [result.lacks for result in report.replaced.values() if "%" not in result.lacks]
        yield (
            f"{counted(len(report.replaced), 'more trial')} did not count: {stood} whose robots stood for more than "
            f"half of the time, {len(others)} in which a fault or order came to nothing"
            + (f" (such as: {others[0]})" if others else "")
        )
    for promise in PROMISES:
        count, evaluated = table["breaches"][promise.name], table["evaluated"][promise.name]
        kept = "kept" if not count else f"BROKEN {count} times" if count > 1 else "BROKEN once"
        yield f"  {promise.says}: {kept if evaluated else 'not evaluated'}" + (f" ({evaluated})" if evaluated else "")
    collisions = ", ".join(f"{kind} {count}" for kind, count in table["collisions"].items())
    separation = table["min_separation_m"]
    centres = "-" if separation is None else f"{separation:.3f} m"
    yield f"  contacts: {collisions}; smallest distance of two centres {centres}"
    yield f"  same seed, same run: {report.repeated - len(report.unlike)} of {report.repeated} repeated"


def _verdict(report: Report) -> Iterator[str]:
    yield from report.problems()[:_WORST]
    if report.passed:
        yield "PASSED"
    elif report.broken:
        yield f"NOT PASSED: {counted(len(report.broken), 'seed')} broke a promise"
    else:
        yield f"NOT PASSED{_interrupted(report)}"


def quick_verdict(report: Report, how: str) -> str:
    """Whether a behaviour may drive, in a line; or why not, for each robot that was concerned, the earliest first.

    Args:
        report: the report of a quick check.
        how: the command that replays a seed, without the seed.
    """
    if report.passed:
        seconds = f"{counted(len(report.results), 'trial')} of {next(iter(report.results.values())).duration:.0f} s"
        return f"may drive ({seconds}, no promise broken, {report.wall:.0f} s)"
    lines = [f"{breach} (seed {seed}): {how} {seed}" for seed, breach in _first_of_each(report)]
    lines += report.problems()[:_WORST]
    return "\n".join((*lines, "may not drive" if lines else f"no verdict{_interrupted(report)}"))


def _interrupted(report: Report) -> str:
    return f" (interrupted after {report.done} of {counted(report.plan.trials, 'trial')})" if report.interrupted else ""


def _first_of_each(report: Report) -> list[tuple[int, Breach]]:
    """The first breach of each promise, with its seed."""
    first: dict[str, tuple[int, Breach]] = {}
    for result in report.broken:
        for breach in result.breaches:
            first.setdefault(breach.promise, (result.seed, breach))
    return list(first.values())


def write_json(report: Report, path: Path) -> None:
    """Write a report as JSON.

    Args:
        report: the report.
        path: the file.

    Raises:
        MuroError: it cannot be written.
    """
    try:
        path.write_text(json.dumps(as_table(report), indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise MuroError(f"{path}: cannot be written ({error.strerror or error}). Choose another file") from error


def coverage_text(report: Report) -> str:
    """The coverage table as text: a row for each kind and role, how many trials met it in each state.

    Args:
        report: the report.
    """
    met, rows = report.met, []
    width = max(len(f"{cell.kind} {cell.role}") for cell in CELLS)
    rows.append(f"{'fault, where':<{width}}" + "".join(f"{activity:>10}" for activity in Activity))
    for kind, role in dict.fromkeys((cell.kind, cell.role) for cell in CELLS):
        counts = [met[cell] for cell in CELLS if cell[:2] == (kind, role)]
        rows.append(f"{f'{kind} {role}':<{width}}" + "".join(f"{count or '-':>10}" for count in counts))
    missing = sum(1 for cell in CELLS if not met[cell])
    if missing:
        needed = "" if report.must_cover else f"; from {COVERING} trials on that is an error"
        rows.append(f"{missing} of {len(CELLS)} cells were never met{needed}")
    return "\n".join(rows)
