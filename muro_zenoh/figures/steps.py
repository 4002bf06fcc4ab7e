"""Distributions as steps, and ticks for axes in ratios."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from muro_zenoh.elementwise import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis


def distribution(axes: Axes, values: Array, label: str, color: str, dashes: Any, alpha: float = 1.0) -> None:
    """The share of values up to each, as steps; what is infinite counts and is never reached.

    Args:
        axes: where to.
        values: the values.
        label: for the legend.
        color: of the line.
        dashes: of the line.
        alpha: of the line; fainter below 1.
    """
    reached = np.sort(values[np.isfinite(values)])
    share = np.arange(len(reached) + 1) / max(len(values), 1)
    x = np.concatenate(([1e-3], reached, [1e3]))  # from edge to edge of any axes of ratios
    y = np.concatenate((share, share[-1:]))
    axes.step(x, y, where="post", label=label, color=color, linestyle=dashes, alpha=alpha)


def log_ticks(axis: Axis, ticks: Sequence[float]) -> None:
    """Plain numbers on a logarithmic axis.

    Args:
        axis: the axis.
        ticks: where.
    """
    from matplotlib.ticker import NullLocator

    axis.set_ticks(ticks, labels=[f"{tick:g}" for tick in ticks])
    axis.set_minor_locator(NullLocator())
