"""Every figure by its file name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, NamedTuple

from muro_zenoh.errors import ConfigError, MuroError
from muro_zenoh.figures import deploying, driving, following, spreading, steering, topics
from muro_zenoh.figures.canvas import FORMATS, save, style
from muro_zenoh.figures.simulation import PUBLISHED, Effort

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Entry(NamedTuple):
    """A figure of the catalogue.

    Args:
        draw: from an effort to the figure; called within :func:`~muro_zenoh.figures.canvas.style`.
        shows: what it shows, in one line.
    """

    draw: Callable[[Effort], Figure]
    shows: str


FIGURES: Final[Mapping[str, Entry]] = MappingProxyType(
    {
        "seed000_fig1": Entry(following.gain_too_low, "passivity law, gain too low"),
        "seed000_fig2": Entry(following.gain_good, "passivity law, gain good"),
        "seed000_fig3": Entry(following.gain_too_high, "passivity law, gain too high"),
        "seed000_fig4": Entry(following.noisy_trajectory, "a circle followed with noise, delay and drive errors"),
        "seed000_fig5": Entry(spreading.steps_0, "ten robots bunched together"),
        "seed000_fig6": Entry(spreading.steps_10, "the same after 10 steps of cyclic pursuit"),
        "seed000_fig7": Entry(spreading.steps_100, "the same after 100 steps"),
        "seed000_fig8": Entry(topics.topics, "the flow of topics"),
        "seed001_wheel_speeds": Entry(steering.wheel_speeds_over_alpha, "point-forward wheel speeds over the angle"),
        "seed004_dubins": Entry(driving.dubins, "a Dubins path with its speed profile"),
        "circle_settling": Entry(following.settling, "settling of the circle laws beside the Dubins reference"),
        "pursuit_settling": Entry(spreading.settling, "settling of the pursuit laws beside the lower bound"),
        "importance_density": Entry(spreading.importance, "where robots were, beside the desired importance"),
        "coverage_cells": Entry(deploying.coverage_cells, "Voronoi cells before and after Lloyd's algorithm"),
    }
)
"""Figures by name, in the order of the reports."""


def draw(
    out: Path, only: Sequence[str] = (), file_format: str = "svg", effort: Effort = PUBLISHED
) -> Iterator[tuple[str, Path]]:
    """Draw figures into a folder, which is created if it is missing.

    Args:
        out: the folder.
        only: names of figures; empty for all.
        file_format: ``svg`` or ``png``.
        effort: how much is simulated.

    Yields:
        Name and file of each figure, once it is written.

    Raises:
        ConfigError: an unknown name or format; the message lists the valid ones.
        MissingExtra: matplotlib is not installed.
        MuroError: the folder or a file cannot be written.
    """
    for name in only:
        if name not in FIGURES:
            raise ConfigError("figure", got=repr(name), expected=f"one of {', '.join(FIGURES)}")
    if file_format not in FORMATS:
        raise ConfigError("figure format", got=repr(file_format), expected=" or ".join(FORMATS))
    with style():
        try:
            out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise MuroError(f"{out}: cannot create the folder ({error.strerror}). Choose another with --out") from error
        for name in only or FIGURES:
            path = out / f"{name}.{file_format}"
            save(FIGURES[name].draw(effort), path)
            yield name, path
