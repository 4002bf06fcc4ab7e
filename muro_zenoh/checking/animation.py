"""A trial as an animated picture: SVG that every browser plays, written without any library."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final
from xml.sax.saxutils import escape

import numpy as np

from muro_zenoh.checking.judgement import Breach
from muro_zenoh.checking.record import PERIOD, Record
from muro_zenoh.errors import MuroError

_SCALE: Final = 180.0
"""Of the drawing [px/m]."""

_FRAME: Final = 0.1
"""From one key frame to the next [s]; between them the browser interpolates."""

_BEFORE, _AFTER = 8.0, 1.5
"""What is shown before and after a breach [s]."""

_BAD, _OURS, _PALE, _DARK = "#D55E00", "#0072B2", "#e6e6e6", "#1a1a1a"
_MARGIN = 40.0


def write_animation(record: Record, breaches: Sequence[Breach], path: Path) -> None:
    """Write a trial as an animation: around its first breach, or all of it.

    Args:
        record: the trial.
        breaches: its breaches, the first one first.
        path: the file.

    Raises:
        MuroError: the file cannot be written.
    """
    try:
        path.write_text(animation(record, breaches), encoding="utf-8")
    except OSError as error:
        raise MuroError(f"{path}: cannot be written ({error.strerror or error}). Choose another with --out") from error


def animation(record: Record, breaches: Sequence[Breach]) -> str:
    """The animation as SVG.

    Args:
        record: the trial.
        breaches: its breaches, the first one first.
    """
    start, end = 0.0, float(record.time[-1])
    if breaches:
        start, end = max(0.0, breaches[0].time - _BEFORE), min(end, breaches[0].time + _AFTER)
    rows = np.arange(
        np.searchsorted(record.time, start), np.searchsorted(record.time, end, "right"), round(_FRAME / PERIOD)
    )
    drawing = _Drawing(record, rows)
    bad = {name for breach in breaches[:1] for name in breach.robots}
    arena = record.scenario.arena
    width, height = arena.width * _SCALE + 2 * _MARGIN, arena.height * _SCALE + 2 * _MARGIN
    title = str(breaches[0]) if breaches else "no promise broken"
    return "\n".join(
        (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" '
            'font-family="sans-serif" font-size="14">',
            f"<title>{escape(title)}, seed {record.seed}</title>",
            f'<rect width="{width:.0f}" height="{height:.0f}" fill="white"/>',
            f'<rect x="{_MARGIN}" y="{_MARGIN}" width="{arena.width * _SCALE:.0f}" '
            f'height="{arena.height * _SCALE:.0f}" fill="none" stroke="{_DARK}"/>',
            *drawing.walls(),
            *(drawing.robot(i, name in bad) for i, name in enumerate(record.names)),
            *drawing.captions(breaches[:1]),
            f'<text x="{_MARGIN}" y="{_MARGIN - 14}">{escape(title)} '
            f"(seed {record.seed}; shown: {start:.1f} to {end:.1f} s)</text>",
            drawing.clock(width),
            "</svg>",
            "",
        )
    )


class _Drawing:
    """The parts of one animation."""

    def __init__(self, record: Record, rows: Iterable[int]) -> None:
        self._record = record
        self._rows = np.asarray(rows)
        self._start = float(record.time[self._rows[0]])
        self._length = max(float(record.time[self._rows[-1]]) - self._start, _FRAME)
        self._timing = f'dur="{self._length:.2f}s" repeatCount="indefinite"'

    def _place(self, x: float, y: float) -> tuple[float, float]:
        """A position [m, world] in the drawing [px]."""
        arena = self._record.scenario.arena
        return (x - arena.x_min) * _SCALE + _MARGIN, (arena.y_max - y) * _SCALE + _MARGIN

    def walls(self) -> Iterable[str]:
        """The walls inside the arena."""
        for wall in self._record.scenario.walls:
            (x, y), (x_end, y_end) = self._place(wall.x, wall.y), self._place(wall.x_end, wall.y_end)
            yield (
                f'<line x1="{x:.1f}" y1="{y:.1f}" x2="{x_end:.1f}" y2="{y_end:.1f}" stroke="{_DARK}" stroke-width="5"/>'
            )

    def robot(self, i: int, bad: bool) -> str:
        """A body with its heading and name."""
        record = self._record
        pose = record.pose[self._rows, i]
        places = [self._place(x, y) for x, y, _ in pose]
        turns = -np.degrees(np.unwrap(pose[:, 2]))
        radius = record.scenario.robot[record.names[i]].radius * _SCALE
        color = _BAD if bad else _OURS
        return (
            f'<g><animateTransform attributeName="transform" type="translate" {self._timing} '
            f'values="{";".join(f"{x:.1f},{y:.1f}" for x, y in places)}"/>'
            f'<circle r="{radius:.1f}" fill="{color}" fill-opacity="0.25" stroke="{color}"/>'
            f'<g><animateTransform attributeName="transform" type="rotate" {self._timing} '
            f'values="{";".join(f"{turn:.1f}" for turn in turns)}"/>'
            f'<line x2="{radius:.1f}" stroke="{color}" stroke-width="3"/></g>'
            f'<text text-anchor="middle" y="5" fill="{_DARK}">{record.names[i]}</text></g>'
        )

    def captions(self, breaches: Sequence[Breach]) -> Iterable[str]:
        """What happens, while it does: the faults, and the breach with a ring around its robots."""
        record, arena = self._record, self._record.scenario.arena
        bottom = arena.height * _SCALE + 2 * _MARGIN - 14
        for number, effect in enumerate(record.effects):
            words = escape(f"{effect.fault.kind} {effect.fault.target}")
            shown = self._while(effect.start, effect.end)
            x = _MARGIN + 260 * number
            yield f'<text x="{x}" y="{bottom:.0f}" fill="{_DARK}" opacity="0">{words}{shown}</text>'
        for breach in breaches:
            row = min(int(np.searchsorted(record.time, breach.time)), len(record.time) - 1)
            for name in breach.robots:
                i = record.names.index(name)
                x, y = self._place(*record.pose[row, i, :2])
                radius = 1.4 * record.scenario.robot[name].radius * _SCALE
                yield (
                    f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="none" '
                    f'stroke="{_BAD}" stroke-width="4" opacity="0">{self._while(breach.time, math.inf)}</circle>'
                )

    def clock(self, width: float) -> str:
        """A bar that grows with time."""
        return (
            f'<rect x="{_MARGIN}" y="{_MARGIN - 8}" height="3" fill="{_OURS}"><animate attributeName="width" '
            f'{self._timing} values="0;{width - 2 * _MARGIN:.0f}"/></rect>'
        )

    def _while(self, start: float, end: float) -> str:
        """Makes its element visible from ``start`` to ``end``."""
        first = min(max((start - self._start) / self._length, 0.0), 1.0)
        last = min(max((end - self._start) / self._length, first), 1.0)
        return (
            f'<animate attributeName="opacity" calcMode="discrete" {self._timing} values="0;1;0" '
            f'keyTimes="0;{first:.4f};{last:.4f}"/>'
        )
