"""Many runs, in this process or in several, with the count on stderr."""

from __future__ import annotations

import multiprocessing
import sys
from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

Job = TypeVar("Job")
Done = TypeVar("Done")


def run_jobs(work: Callable[[Job], Done], jobs: Sequence[Job], processes: int, what: str) -> list[Done]:
    """The results, in the order of the jobs.

    Args:
        work: a function of a module.
        jobs: its arguments.
        processes: how many; 1 for this one.
        what: what they do, for the eyes of who waits.
    """
    if processes > 1:
        with multiprocessing.get_context("spawn").Pool(processes) as pool:
            return _watch(pool.imap(work, jobs), len(jobs), what)
    return _watch(map(work, jobs), len(jobs), what)


def _watch(results: Iterable[Done], count: int, what: str) -> list[Done]:
    done: list[Done] = []
    for result in results:
        done.append(result)
        print(f"\r{what}: {len(done)} of {count} ", end="", file=sys.stderr, flush=True)
    print("\r" + " " * 79 + "\r", end="", file=sys.stderr)
    return done
