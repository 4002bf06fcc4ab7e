"""The display during a run: a live table, or a plain line every few seconds."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Any

import click

from muro_zenoh.cli.desk import HELP, Desk
from muro_zenoh.cli.keyboard import has_keyboard, keyboard
from muro_zenoh.scoring.view import View
from muro_zenoh.transport import Bus

_LINE_PERIOD = 5.0
"""Time between two plain lines [s]."""


def line_of(view: View) -> str:
    """A view as one line.

    Args:
        view: the run at one moment.
    """
    ages = [row.pose_age for row in view.rows if row.pose_age is not None]
    reasons: dict[str, list[str]] = {}
    for row in view.rows:
        for text in filter(None, (row.reasons, row.complaints)):
            reasons.setdefault(text, []).append(row.name)
    return (
        f"{view.t:6.1f} s  driving {view.driving}/{len(view.rows)}  "
        f"radius error {_number(view.radius_error, '.3f', ' m')}  "
        f"spacing error {_number(view.spacing_error, '.3f', ' rad')}  "
        f"pose age {_number(max(ages, default=None), '.0f', ' ms', 1e3)}  restarts {view.restarts}{_faults(view)}"
        + "".join(f"  {' '.join(names)}: {reason}" for reason, names in reasons.items())
    )


class PlainScreen:
    """Plain lines on standard output, for logs and when the output is not a terminal."""

    def __init__(self) -> None:
        self._next = 0.0

    def notify(self, text: str) -> None:
        """Print an event."""
        click.echo(text)

    def show(self, view: View) -> None:
        """Print a line every few seconds."""
        if view.t >= self._next:
            self._next = _LINE_PERIOD * (math.floor(view.t / _LINE_PERIOD) + 1)
            click.echo(line_of(view))

    @contextmanager
    def operating(self, bus: Bus, say: Callable[[str], None]) -> Iterator[None]:
        """Nothing: there are no keys."""
        yield

    def __enter__(self) -> PlainScreen:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        pass


class TableScreen:
    """A table in the terminal that is redrawn in place, with events above it."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.live import Live

        self._help = ""
        # No markup: a robot's reasons, and a unit such as [m], are text.
        self._console = Console(markup=False, highlight=False)
        # No refresh thread: the table is drawn when there is a new view.
        self._live = Live(console=self._console, auto_refresh=False, transient=False)

    def notify(self, text: str) -> None:
        """Print an event above the table."""
        self._console.print(text)

    def show(self, view: View) -> None:
        """Draw the table."""
        self._live.update(table_of(view, self._help), refresh=True)

    @contextmanager
    def operating(self, bus: Bus, say: Callable[[str], None]) -> Iterator[None]:
        """Let the space bar stop the robots, and r and y resume them, where there is a keyboard."""
        if not has_keyboard():
            yield
            return
        desk = Desk(bus, say)
        self._help = HELP
        try:
            with keyboard(desk.press):
                yield
        finally:
            self._help = ""
            desk.close()

    def __enter__(self) -> TableScreen:
        self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._live.stop()


def table_of(view: View, keys: str = "") -> Any:
    """A view as a table for a terminal.

    Args:
        view: the run at one moment.
        keys: what the keys do; empty where there are none.
    """
    from rich.table import Table

    table = Table(
        title=f"{view.t:.0f} of {view.duration:g} s   "
        f"radius error {_number(view.radius_error, '.3f', ' m')}   "
        f"spacing error {_number(view.spacing_error, '.3f', ' rad')}   restarts {view.restarts}{_faults(view)}",
        title_justify="left",
        caption=keys or None,
        caption_justify="left",
    )
    table.add_column("robot")
    table.add_column("state")
    for header in ("pose age\n[ms]", "from circle\n[m]", "gap\n[rad]", "commands\n[Hz]", "cal0", "calD"):
        table.add_column(header, justify="right")
    table.add_column("reasons", overflow="fold")
    for row in view.rows:
        table.add_row(
            row.name,
            row.state,
            _number(row.pose_age, ".0f", scale=1e3),
            _number(row.distance, ".3f"),
            _number(row.gap, ".2f"),
            _number(row.command_rate, ".1f"),
            _number(row.calibrated.cal0, ".3f"),
            _number(row.calibrated.calD, ".3f"),
            "; ".join(filter(None, (row.reasons or row.note, row.complaints))),
        )
    return table


def _faults(view: View) -> str:
    return f"  faults: {', '.join(view.faults)}" if view.faults else ""


def _number(value: float | None, form: str, unit: str = "", scale: float = 1.0) -> str:
    return "-" if value is None else f"{value * scale:{form}}{unit}"
