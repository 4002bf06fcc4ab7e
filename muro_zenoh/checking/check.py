"""Many trials, on many processes: which promises were broken, by which seeds, and what was tried."""

from __future__ import annotations

import logging
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Final, NamedTuple, Protocol

from muro_zenoh.checking.coverage import CELLS, Cell
from muro_zenoh.checking.promises import PROMISES
from muro_zenoh.checking.trial import Result, run_trial
from muro_zenoh.checking.workers import Workers
from muro_zenoh.config import Scenario

WALL_LIMIT: Final = 300.0
"""Longest time for one trial [s]: a hundred times as long as one takes on a machine that does nothing else."""

AGAIN: Final = 40
"""Every so many trials one is run a second time, to see whether the same seed gives the same run."""

MOST_REPLACED: Final = 2
"""A check gives up when it has replaced this many times as many trials as it was asked for."""

COVERING: Final = 2 * len(CELLS)
"""From this number of random trials on, a cell of the coverage table that was never met fails the check. Each cell is
then aimed at twice by the first fault alone; in fewer trials it is only shown."""


class Task(NamedTuple):
    """A ``seed`` to run; ``again``: for the second time."""

    seed: int
    again: bool = False


class Screen(Protocol):
    """Shows how far a check is."""

    def show(self, report: Report) -> None:
        """Show a report that is not complete yet."""


class Plan(NamedTuple):
    """What is to be checked.

    Attributes:
        trial: from a seed to the scenario with its faults and orders; a function that can be pickled.
        trials: number of trials that must count.
        seed: of the first trial; the others have the following ones.
        jobs: number of processes.
        covers: whether the trials are to meet every cell of the coverage table.
        all_count: whether every trial counts, however little its robots drive.
        first: whether it ends with the first trial that breaks a promise.
    """

    trial: Callable[[int], Scenario]
    trials: int
    seed: int
    jobs: int
    covers: bool = True
    all_count: bool = False
    first: bool = False


class Report:
    """What a check has found so far.

    Args:
        plan: the check.

    Attributes:
        plan: the check.
        results: the results of the trials that count, by seed.
        replaced: the results of trials that did not count, by seed: they broke nothing, but lacked something.
        failures: why trials have no result, by seed: they crashed or hung.
        unlike: the seeds whose second run was not like the first.
        repeated: number of trials that were run twice.
        wall: how long the check took [s].
        interrupted: whether it was ended early.
    """

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.results: dict[int, Result] = {}
        self.replaced: dict[int, Result] = {}
        self.failures: dict[int, str] = {}
        self.unlike: list[int] = []
        self.repeated = 0
        self.wall = 0.0
        self.interrupted = False

    @property
    def done(self) -> int:
        """Number of trials that count, or have failed."""
        return len(self.results) + len(self.failures)

    @property
    def broken(self) -> tuple[Result, ...]:
        """The results with a breach, the worst first."""
        return tuple(result for result in self.by_severity() if result.breaches)

    def by_severity(self) -> list[Result]:
        """The results, the worst first: by the most important promise broken, by how often, by the smallest gap."""
        rank = {promise.name: index for index, promise in enumerate(PROMISES)}

        def severity(result: Result) -> tuple[int, int, float, int]:
            first = min((rank[breach.promise] for breach in result.breaches), default=len(rank))
            return first, -len(result.breaches), result.separation, result.seed

        return sorted(self.results.values(), key=severity)

    @property
    def met(self) -> Counter[Cell]:
        """How many trials met each cell of the coverage table; those that did not count, too, for they were judged."""
        met: Counter[Cell] = Counter()
        for result in (*self.results.values(), *self.replaced.values()):
            met.update(result.met)
        return met

    @property
    def evaluated(self) -> Counter[str]:
        """How often each promise was evaluated."""
        evaluated = Counter({promise.name: 0 for promise in PROMISES})
        for result in self.results.values():
            evaluated.update({name: judgement.evaluated for name, judgement in result.judgements.items()})
        return evaluated

    @property
    def must_cover(self) -> bool:
        """Whether a cell that was never met fails the check."""
        return self.plan.covers and len(self.results) >= COVERING

    @property
    def gave_up(self) -> bool:
        """Whether too many trials were replaced."""
        return len(self.replaced) > MOST_REPLACED * self.plan.trials

    @property
    def times_real_time(self) -> float:
        """Virtual seconds of a whole fleet for each second of one core."""
        cpu = sum(result.cpu for result in self.results.values())
        return sum(result.duration for result in self.results.values()) / cpu if cpu else 0.0

    def problems(self) -> list[str]:
        """What makes the check fail besides breaches, in words."""
        problems = [f"seed {seed}: {failure}" for seed, failure in sorted(self.failures.items())]
        problems += [f"seed {seed}: two runs of it differ" for seed in self.unlike]
        if self.gave_up:
            problems.append(
                f"got {len(self.replaced)} trials that do not count, expected at most {MOST_REPLACED} for each that "
                f"does; the last one: {list(self.replaced.values())[-1].lacks}"
            )
        if self.interrupted:
            return problems
        evaluated = self.evaluated
        problems += [
            f"the promise {promise.name!r} was never evaluated: it was not watched, or nothing has happened"
            for promise in PROMISES
            if not evaluated[promise.name] and (promise.always or self.must_cover)
        ]
        if self.must_cover:
            problems += [f"never met: {' '.join(cell)}" for cell in CELLS if not self.met[cell]]
        return problems

    @property
    def passed(self) -> bool:
        """Whether all trials were run, nothing was broken, and nothing is wrong with the check."""
        return not self.interrupted and not self.broken and not self.problems()


def run_check(plan: Plan, screen: Screen) -> Report:
    """Run a check; Ctrl-C ends it with what was done so far.

    Args:
        plan: what is to be checked.
        screen: shows how far it is.
    """
    report = Report(plan)
    began = time.perf_counter()
    with Workers(partial(_run, plan.trial), plan.jobs, WALL_LIMIT) as workers:
        try:
            _run_all(report, workers, screen)
        except KeyboardInterrupt:
            report.interrupted = True
        report.wall = time.perf_counter() - began
    return report


def _run_all(report: Report, workers: Workers[Task, Result], screen: Screen) -> None:
    """The seeds that are run are the same for any number of processes: the first ones of which enough count."""
    plan = report.plan
    next_seed, firsts = plan.seed, 0
    to_repeat: list[Result] = []
    while True:
        while workers.has_room and not report.gave_up:
            if to_repeat:
                workers.start(Task(to_repeat.pop().seed, again=True))
            elif report.done + firsts < plan.trials:
                workers.start(Task(next_seed))
                next_seed, firsts = next_seed + 1, firsts + 1
            else:
                break
        if not workers.busy:
            return
        for task, result, failure in workers.finished():
            if task.again:
                report.repeated += 1
                if result is None or result.digest != report.results[task.seed].digest:
                    report.unlike.append(task.seed)
                continue
            firsts -= 1
            if result is None:
                report.failures[task.seed] = failure
            elif result.counts or plan.all_count:
                report.results[task.seed] = result
                if plan.first and result.breaches:
                    return
                if task.seed % AGAIN == plan.seed % AGAIN:
                    to_repeat.append(result)
            else:
                report.replaced[task.seed] = result
        screen.show(report)


@contextmanager
def quiet() -> Iterator[None]:
    """Log nothing: what a fleet's processes log of faults that are meant would hide what the check says."""
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        yield
    finally:
        logging.disable(before)


def _run(trial: Callable[[int], Scenario], task: Task) -> Result:
    with quiet():
        return run_trial(trial(task.seed), task.seed)[1]
