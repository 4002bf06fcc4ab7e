"""The picture of a breach: the floor when it happened, and what the robots concerned did before."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from muro_zenoh.checking.driving import CAMERA_AGE, COMMAND_AGE
from muro_zenoh.checking.judgement import Breach
from muro_zenoh.checking.record import Record
from muro_zenoh.figures.canvas import BLUE, GREY, ORANGE, PAGE, PALE, plan_view, save, sheet, style
from muro_zenoh.runtime.waiting import without_numbers

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_BEFORE: Final = 5.0
"""What is drawn of the time before a breach [s] ..."""

_AFTER: Final = 1.0
"""... and after it [s]."""

_DASHES: Final[tuple[Any, ...]] = ("-", (0, (4, 2)), (0, (1, 1)), (0, (4, 1, 1, 1)))


def draw_breach(record: Record, breach: Breach, path: Path) -> None:
    """Draw a breach.

    Args:
        record: the trial.
        breach: the breach.
        path: the file; its suffix, ``.svg`` or ``.png``, selects the format.

    Raises:
        MissingExtra: matplotlib is not installed.
        MuroError: the file cannot be written.
    """
    with style():
        figure, (floor, speeds, ages) = sheet(PAGE, 6.4, 3, 1, height_ratios=(3.2, 1.0, 1.0))
        figure.suptitle(f"seed {record.seed}: {breach}")
        draw_floor(floor, record, breach)
        rows = _rows(record, breach)
        for number, name in enumerate(breach.robots or record.names):
            i, dashes = record.names.index(name), _DASHES[number % len(_DASHES)]
            time = record.time[rows]
            speeds.plot(time, record.command[rows, i, 0], color=BLUE, linestyle=dashes, label=f"{name} commanded")
            speeds.plot(time, record.twist[rows, i, 0], color=GREY, linestyle=dashes, label=f"{name} true")
            ages.plot(time, time - record.good_command[rows, i], color=BLUE, linestyle=dashes, label=f"{name} command")
            ages.plot(time, time - record.good_pose[rows, i], color=ORANGE, linestyle=dashes, label=f"{name} pose")
        ages.axhline(COMMAND_AGE, color=BLUE, linewidth=0.5)
        ages.axhline(CAMERA_AGE, color=ORANGE, linewidth=0.5)
        ages.set_ylim(0.0, 2.0)
        speeds.set_ylabel("v [m/s]")
        ages.set_ylabel("age [s]")
        ages.set_xlabel("time [s]")
        for axes in (speeds, ages):
            axes.set_xlim(float(record.time[rows[0]]), float(record.time[rows[-1]]))
            axes.axvline(breach.time, color=ORANGE, linewidth=0.8)
            _faults(axes, record)
            axes.legend(loc="upper left", ncols=2)
        save(figure, path)


def _rows(record: Record, breach: Breach) -> Any:
    first, last = np.searchsorted(record.time, (breach.time - _BEFORE, breach.time + _AFTER))
    return np.arange(min(first, len(record.time) - 1), max(last, first + 1))


def draw_floor(axes: Axes, record: Record, breach: Breach) -> None:
    """Draw the floor when a breach happened: the arena, its walls, the robots, and their ways before.

    Args:
        axes: to draw on.
        record: the trial.
        breach: the breach.
    """
    from matplotlib.patches import Circle, Rectangle

    plan_view(axes)
    arena = record.scenario.arena
    axes.add_patch(Rectangle((arena.x_min, arena.y_min), arena.width, arena.height, fill=False, edgecolor=GREY))
    for wall in record.scenario.walls:
        axes.plot((wall.x, wall.x_end), (wall.y, wall.y_end), color=GREY, linewidth=2.0)
    axes.set_xlim(arena.x_min - 0.3, arena.x_max + 0.3)
    axes.set_ylim(arena.y_min - 0.3, arena.y_max + 0.3)
    now = min(int(np.searchsorted(record.time, breach.time)), len(record.time) - 1)
    rows: Sequence[int] = _rows(record, breach)
    for i, name in enumerate(record.names):
        color = ORANGE if name in breach.robots else BLUE
        x, y, theta = record.pose[now, i]
        radius = record.scenario.robot[name].radius
        axes.plot(*record.pose[rows, i, :2].T, color=color, linewidth=0.8)
        axes.add_patch(Circle((x, y), radius, facecolor=PALE, edgecolor=color, zorder=3))
        axes.plot((x, x + radius * np.cos(theta)), (y, y + radius * np.sin(theta)), color=color, zorder=4)
        axes.annotate(name, (x, y), ha="center", va="center", fontsize=7.0, zorder=5)


def _faults(axes: Axes, record: Record) -> None:
    for effect in record.effects:
        axes.axvspan(effect.start, min(effect.end, float(record.time[-1])), color=PALE, zorder=0)


def story(record: Record, breaches: Sequence[Breach]) -> list[str]:
    """What happened in a trial, in words, in the order of time: the faults, the orders, and the reasons of the base
    station and of the robots that the faults or the first breach concern.

    Args:
        record: the trial.
        breaches: its breaches, the first one first.
    """
    lines: list[tuple[float, str]] = []
    for effect in record.effects:
        what = f"{effect.fault.kind} of {effect.fault.target}"
        concerned = ", ".join(f"{name} {activity}" for name, activity in effect.robots.items())
        lines.append((effect.start, f"{what} begins to have an effect ({concerned})"))
        if effect.end < record.time[-1]:
            lines.append((effect.end, f"{what} is over"))
    for given in record.orders:
        order = given.order
        answer = {True: "", False: " (not accepted)", None: " (no answer)"}[given.accepted]
        whom = " ".join(order.robots) or "all robots"
        lines.append((given.time, f"order: {order.behaviour or order.kind} for {whom}{answer}"))
    lines += [(breach.time, f"BROKEN: {breach.what} [{breach.promise}]") for breach in breaches]
    concerned_robots = {"basestation", *(name for breach in breaches[:1] for name in breach.robots)}
    concerned_robots |= {effect.fault.robot for effect in record.effects}
    lines += _said(record, concerned_robots)
    return [f"{time:7.2f} s  {line}" for time, line in sorted(lines, key=lambda line: line[0])]


def _said(record: Record, processes: set[str]) -> list[tuple[float, str]]:
    """What processes reported when it was new, those that said the same at one time in one line."""
    said: dict[tuple[float, tuple[str, ...]], list[str]] = {}
    before: dict[str, str] = {}
    for report in record.reports:
        words = without_numbers(report.reasons)
        if report.process in processes and before.get(report.process, "") != words:
            said.setdefault((report.time, report.reasons), []).append(report.process)
        before[report.process] = words
    return [(time, f"{', '.join(names)}: {', '.join(what) or '-'}") for (time, what), names in said.items()]
