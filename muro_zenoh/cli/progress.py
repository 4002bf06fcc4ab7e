"""The progress of a check: a bar in a terminal, a line now and then elsewhere."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Final

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

if TYPE_CHECKING:
    from muro_zenoh.checking.check import Report

_LINE_PERIOD: Final = 30.0
"""Time between two lines where there is no terminal [s]."""


class CheckScreen:
    """The bar, with what was found so far. It is drawn on standard error, so that the output can be piped.

    Args:
        trials: number of trials.
    """

    def __init__(self, trials: int) -> None:
        console = Console(stderr=True, markup=False, highlight=False)
        self._progress = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            console=console,
            disable=not console.is_terminal,
        )
        self._console = console
        self._trials = trials
        self._next = 0.0
        self._task = self._progress.add_task("0 broken", total=trials)

    def __enter__(self) -> CheckScreen:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def show(self, report: Report) -> None:
        """Show how far a check is.

        Args:
            report: the report so far.
        """
        speed = f"{report.times_real_time:.0f}x real time"
        worst = f" (seed {report.broken[0].seed})" if report.broken else ""
        broken = f"{len(report.broken)} broken{worst}, {speed}"
        self._progress.update(self._task, completed=report.done, description=broken)
        if not self._console.is_terminal and report.done and time.monotonic() >= self._next:
            self._next = time.monotonic() + _LINE_PERIOD
            self._console.print(f"{report.done} of {self._trials} trials, {broken}")
