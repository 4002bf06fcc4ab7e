"""Figure of the topology: seed 000, figure 8, the flow of topics, drawn from the table of channels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

from muro_zenoh.channels import CHANNELS, TIME, VERBS
from muro_zenoh.figures.canvas import AMBER, BLACK, BLUE, GREEN, GREY, PAGE, PURPLE, sheet
from muro_zenoh.figures.simulation import Effort

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WRITERS_AT, CHANNELS_AT, READERS_AT = 0.0, 0.5, 1.0

GROUPS: Final = (
    (("camera", "simulator", "base"), AMBER),
    (("basestation",), BLUE),
    (("agent",), GREEN),
    (("operator",), PURPLE),
)
"""Programs from top to bottom, one colour per group; a program in no group is last, in grey."""


class Flow(NamedTuple):
    """A channel, or orders: the key without the realm, and the programs at either end."""

    key: str
    writers: tuple[str, ...]
    readers: tuple[str, ...]


def flows() -> list[Flow]:
    """The table of channels as flows, and the orders; all orders to the base station are one flow."""
    rows = [
        Flow(
            f"{channel.word}/<{channel.named}>" if channel.named else channel.word,
            tuple(map(str, channel.writers)),
            tuple(map(str, channel.readers)),
        )
        for channel in CHANNELS
    ]
    orders = {
        Flow(
            f"{verb.word}/<{verb.named}>" if verb.named else f"{verb.answered_by}/<order>",
            tuple(map(str, verb.asked_by)),
            (str(verb.answered_by),),
        ): None
        for verb in VERBS
        if verb is not TIME  # everybody's, and no order
    }
    return [*rows, *orders]


def topics(effort: Effort) -> Figure:
    """Seed 000, figure 8: the writers and readers of each topic.

    Args:
        effort: not used: nothing is simulated.
    """
    figure, axes = sheet(PAGE, 5.4)
    axes.set_axis_off()
    axes.set_xlim(-0.12, 1.12)
    rows = _by_writer(flows())
    heights = {row.key: 1.0 - k / (len(rows) - 1) for k, row in enumerate(rows)}
    writers = _column([(name, heights[row.key]) for row in rows for name in row.writers])
    readers = _column([(name, heights[row.key]) for row in rows for name in row.readers])
    for row in rows:
        color, height = _color(row.writers[0]), heights[row.key]
        for name in row.writers:
            _link(axes, (WRITERS_AT + 0.1, writers[name]), (CHANNELS_AT - 0.13, height), _color(name))
        for name in row.readers:
            _link(axes, (CHANNELS_AT + 0.13, height), (READERS_AT - 0.1, readers[name]), color)
        _box(axes, (CHANNELS_AT, height), row.key, color, 0.26)
    for x, width, column in ((WRITERS_AT, 0.2, writers), (READERS_AT, 0.2, readers)):
        for name, height in column.items():
            _box(axes, (x, height), name, _color(name), width, filled=True)
    for x, text in ((WRITERS_AT, "writers"), (CHANNELS_AT, "channels"), (READERS_AT, "readers")):
        axes.text(x, 1.045, text, ha="center", va="bottom", fontsize=9)
    axes.set_ylim(-0.03, 1.08)
    return figure


def _by_writer(rows: list[Flow]) -> list[Flow]:
    """Sorted by the group of the first writer, so that few lines cross."""
    return sorted(rows, key=lambda row: _group(row.writers[0]))


def _group(name: str) -> int:
    program = name.partition("/")[0]
    return next((k for k, (programs, _) in enumerate(GROUPS) if program in programs), len(GROUPS))


def _color(name: str) -> str:
    group = _group(name)
    return GROUPS[group][1] if group < len(GROUPS) else GREY


def _column(ends: Sequence[tuple[str, float]]) -> dict[str, float]:
    """Heights of the names in a column, by the mean height of their channels, so that few lines cross."""
    at: dict[str, list[float]] = {}
    for name, height in ends:
        at.setdefault(name, []).append(height)
    names = sorted(at, key=lambda name: (-sum(at[name]) / len(at[name]), name))
    return {name: 0.97 - 0.94 * k / (len(names) - 1) for k, name in enumerate(names)}


def _link(axes: Axes, start: tuple[float, float], end: tuple[float, float], color: str) -> None:
    from matplotlib.patches import FancyArrowPatch
    from matplotlib.path import Path

    (x0, y0), (x1, y1) = start, end
    middle = 0.5 * (x0 + x1)
    curve = Path([(x0, y0), (middle, y0), (middle, y1), (x1, y1)], [Path.MOVETO, Path.CURVE4, Path.CURVE4, Path.CURVE4])
    axes.add_patch(
        FancyArrowPatch(path=curve, arrowstyle="-|>", mutation_scale=6, color=color, linewidth=0.9, alpha=0.8)
    )


def _box(axes: Axes, at: tuple[float, float], text: str, color: str, width: float, filled: bool = False) -> None:
    from matplotlib.patches import FancyBboxPatch

    x, y = at
    shape = FancyBboxPatch(
        (x - width / 2, y - 0.016),
        width,
        0.032,
        boxstyle="round,pad=0,rounding_size=0.008",
        facecolor=(color, 0.25) if filled else "white",
        edgecolor=color,
        linewidth=0.9,
        zorder=3,
    )
    axes.add_patch(shape)
    axes.text(x, y - 0.001, text, ha="center", va="center", fontsize=7, color=BLACK, zorder=4)
