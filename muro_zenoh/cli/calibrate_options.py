"""Options of ``muro calibrate``: the board, and what is typed as NAME=VALUE."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

from muro_zenoh.errors import ConfigError, ParameterError

if TYPE_CHECKING:
    import numpy as np

    from basestation.calibration.board import Board
    from muro_zenoh.geometry import Bounds, Pose2


def board_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """The options of a board.

    Args:
        command: the function under the click decorators.
    """
    for option in (
        click.option("--marker", default=22.0, show_default=True, help="Side of the board's tags [mm]."),
        click.option("--square", default=30.0, show_default=True, help="Side of the board's squares [mm]; measure it."),
        click.option("--rows", default=6, show_default=True, help="Squares down."),
        click.option("--columns", default=9, show_default=True, help="Squares across."),
    ):
        command = option(command)
    return command


def make_board(columns: int, rows: int, square: float, marker: float) -> Board:
    """The board.

    Args:
        columns: of squares.
        rows: of squares.
        square: side of a square [mm].
        marker: side of a tag [mm].

    Raises:
        ConfigError: no such board.
    """
    from basestation.calibration.board import Board

    try:
        return Board(columns, rows, 1e-3 * square, 1e-3 * marker)
    except ParameterError as error:
        raise ConfigError(f"--{error.what}", got=error.got, expected=error.expected) from None


def floor_of(fleet: str) -> tuple[Bounds, float]:
    """A fleet's arena, and the height of its highest tag [m].

    Args:
        fleet: its file.
    """
    from muro_zenoh.config import find_scenario

    scenario = find_scenario(fleet)
    return scenario.arena, max((robot.tag_z for robot in scenario.robot.values()), default=0.0)


def place(text: str, option: str, parts: int) -> tuple[str, np.ndarray[Any, Any]]:
    """``ID=X,Y[,Z]`` or ``U,V=X,Y[,Z]``.

    Args:
        text: what was typed.
        option: the option, for errors.
        parts: numbers before the equals sign.

    Returns:
        What is before it, and the place (3,) [m].

    Raises:
        ConfigError: something else was typed.
    """
    import numpy as np

    left, equals, right = text.partition("=")
    shape = "ID=X,Y or ID=X,Y,Z" if parts == 1 else "U,V=X,Y or U,V=X,Y,Z"
    try:
        numbers = [float(part) for part in right.split(",")]
        before = [float(part) for part in left.split(",")]
        if not equals or len(numbers) not in (2, 3) or len(before) != parts or not np.isfinite(numbers).all():
            raise ValueError
        if parts == 1:
            int(left)
    except ValueError:
        raise ConfigError(option, got=repr(text), expected=f"{shape} [m]") from None
    return left, np.array((*numbers, 0.0)[:3])


def pairs(given: tuple[str, ...], option: str) -> dict[str, str]:
    """``NAME=VALUE`` by name.

    Args:
        given: what was typed.
        option: the option, for errors.

    Raises:
        ConfigError: something else was typed.
    """
    table = {}
    for text in given:
        name, equals, value = text.partition("=")
        if not equals or not name or not value:
            raise ConfigError(option, got=repr(text), expected="NAME=VALUE with the name of a camera")
        table[name] = value
    return table


def number(text: str, option: str) -> float:
    """A length [m].

    Args:
        text: what was typed.
        option: the option, for errors.

    Raises:
        ConfigError: something else was typed.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < 100.0:
        raise ConfigError(option, got=repr(text), expected="metres above 0")
    return value


def distance_of(text: str | None) -> tuple[int, int, float] | None:
    """``ID,ID=METRES``.

    Args:
        text: what was typed; None for no distance.

    Raises:
        ConfigError: something else was typed.
    """
    if text is None:
        return None
    tags, _, metres = text.partition("=")
    try:
        first, second = (int(tag) for tag in tags.split(","))
    except ValueError:
        raise ConfigError("--distance", got=repr(text), expected="ID,ID=METRES, such as 40,41=2.000") from None
    return first, second, number(metres, "--distance")


def start_of(text: str) -> Pose2:
    """``x,y,theta``.

    Args:
        text: what was typed.

    Raises:
        ConfigError: something else was typed.
    """
    from muro_zenoh.geometry import Pose2

    try:
        x, y, theta = (float(part) for part in text.split(","))
    except ValueError:
        raise ConfigError("--start", got=repr(text), expected="x,y,theta [m, rad]") from None
    return Pose2(x, y, theta)
