"""What an operator sees while a run goes on: a table that lives, or a plain line now and then."""

from __future__ import annotations

import math
import statistics
from types import TracebackType
from typing import Any, NamedTuple, Protocol

import click

from muro_zenoh.cli.collect import Collector
from muro_zenoh.cli.score import Calibrated, radius_error, spacing_error
from muro_zenoh.config import Scenario
from muro_zenoh.geometry import TWO_PI, Circle, ccw_gap

_NO_CIRCLE = ("dubins", "coverage", "steer")
"""Scenarios whose robots have nothing to do with the circle."""

_LINE_PERIOD = 5.0
"""Seconds between two plain lines."""


class Row(NamedTuple):
    """One robot in the table; None is not known.

    Attributes:
        name: whose row.
        state: in a word.
        reasons: why it is not driving.
        pose_age: median since the last health [s].
        distance: from the circle [m].
        gap: to the next robot in the direction of travel [rad].
        command_rate: commands per second [Hz].
        calibrated: what was found of its drive.
    """

    name: str
    state: str
    reasons: str
    pose_age: float | None
    distance: float | None
    gap: float | None
    command_rate: float | None
    calibrated: Calibrated


class View(NamedTuple):
    """A run at one moment.

    Attributes:
        t: scenario time [s].
        duration: how long it goes on [s].
        rows: one per robot.
        radius_error: the largest [m]; None while a robot's truth is not known.
        spacing_error: [rad]; the same.
        restarts: of processes.
    """

    t: float
    duration: float
    rows: list[Row]
    radius_error: float | None
    spacing_error: float | None
    restarts: int


def gaps_ahead(places: dict[str, tuple[float, float]], circle: Circle) -> dict[str, float]:
    """The gap from each robot to the next in the direction of travel [rad]; a whole turn for a robot alone.

    Args:
        places: x, y [m, world] by robot.
        circle: whose centre, and whose direction.
    """
    angles = {name: circle.sigma * math.atan2(y - circle.y, x - circle.x) for name, (x, y) in places.items()}
    return {
        name: min((ccw_gap(own, other) for them, other in angles.items() if them != name), default=TWO_PI)
        for name, own in angles.items()
    }


def view_of(collector: Collector, scenario: Scenario, restarts: int) -> View:
    """A run as it is now.

    Args:
        collector: what was seen of it.
        scenario: its robots and its duration.
        restarts: of processes.
    """
    sample = collector.latest
    circling = scenario.behaviour.name not in _NO_CIRCLE
    gaps = gaps_ahead(dict(sample.places), sample.circle)
    rows = []
    for name in scenario.robots:
        health = collector.health.get(name)
        ages = health.samples.get("pose_age_s", ()) if health is not None else ()
        place = sample.places.get(name)
        rows.append(
            Row(
                name,
                health.state if health is not None else "-",
                ", ".join(health.reasons) if health is not None else "not heard yet",
                statistics.median(ages) if ages else None,
                radius_error(place, sample.circle) if place is not None and circling else None,
                gaps.get(name) if circling else None,
                health.numbers.get("command_rate_hz") if health is not None else None,
                collector.calibrated(name),
            )
        )
    everybody = circling and len(sample.places) == len(scenario.robots)
    return View(
        collector.elapsed,
        scenario.duration,
        rows,
        max(radius_error(p, sample.circle) for p in sample.places.values()) if everybody else None,
        spacing_error(sample.places, sample.circle) if everybody else None,
        restarts,
    )


def line_of(view: View) -> str:
    """A view as one line.

    Args:
        view: what to say.
    """
    ages = [row.pose_age for row in view.rows if row.pose_age is not None]
    driving = sum(1 for row in view.rows if not row.reasons)
    why: dict[str, list[str]] = {}
    for row in view.rows:
        if row.reasons:
            why.setdefault(row.reasons, []).append(row.name)
    return (
        f"{view.t:6.1f} s  driving {driving}/{len(view.rows)}  "
        f"from the circle {_number(view.radius_error, '.3f', ' m')}  "
        f"spacing error {_number(view.spacing_error, '.3f', ' rad')}  "
        f"pose age {_number(max(ages, default=None), '.0f', ' ms', 1e3)}  restarts {view.restarts}"
        + "".join(f"  {' '.join(names)}: {reasons}" for reasons, names in why.items())
    )


class Screen(Protocol):
    """Where a run is shown."""

    def tell(self, text: str) -> None:
        """Say something that happened."""
        ...

    def show(self, view: View) -> None:
        """Show how it is now; called a few times a second."""
        ...

    def __enter__(self) -> Screen: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class PlainScreen:
    """Lines on standard output; for logs and for a standard output that is no terminal."""

    def __init__(self) -> None:
        self._next = 0.0

    def tell(self, text: str) -> None:
        """Say something that happened."""
        click.echo(text)

    def show(self, view: View) -> None:
        """Print a line every few seconds."""
        if view.t >= self._next:
            self._next = _LINE_PERIOD * (math.floor(view.t / _LINE_PERIOD) + 1)
            click.echo(line_of(view))

    def __enter__(self) -> PlainScreen:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        pass


class TableScreen:
    """A table in the terminal that is drawn anew, with what happened above it."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.live import Live

        # No markup: what a robot says, and a unit such as [m], is text.
        self._console = Console(markup=False, highlight=False)
        # No thread of its own: it is drawn when there is something new.
        self._live = Live(console=self._console, auto_refresh=False, transient=False)

    def tell(self, text: str) -> None:
        """Say something that happened, above the table."""
        self._console.print(text)

    def show(self, view: View) -> None:
        """Draw the table."""
        self._live.update(table_of(view), refresh=True)

    def __enter__(self) -> TableScreen:
        self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._live.stop()


def table_of(view: View) -> Any:
    """A view as a table for a terminal.

    Args:
        view: what to show.
    """
    from rich.table import Table

    table = Table(
        title=f"{view.t:.0f} of {view.duration:g} s   "
        f"from the circle {_number(view.radius_error, '.3f', ' m')}   "
        f"spacing error {_number(view.spacing_error, '.3f', ' rad')}   restarts {view.restarts}",
        title_justify="left",
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
            row.reasons,
        )
    return table


def _number(value: float | None, form: str, unit: str = "", scale: float = 1.0) -> str:
    return "-" if value is None else f"{value * scale:{form}}{unit}"
