"""What went wrong in a behaviour, in a line: what was raised, and where in the user's own file."""

from __future__ import annotations

import os
import traceback
from collections.abc import Callable
from typing import Any

from muro_zenoh.errors import MuroError

_LONGEST = 200
"""Operators read it in a table, so it is cut here [characters]."""


def failure_of(error: BaseException, function: Callable[..., Any] | None = None) -> str:
    """An error as operators read it; the log has its whole traceback.

    Args:
        error: what was raised; of a group, its first error counts.
        function: the user's own behaviour that raised it; None for a built-in one.

    Returns:
        One line.
    """
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    kind = "" if isinstance(error, MuroError) else f"{type(error).__name__}: "
    words = " ".join(f"{kind}{error}".split()).removesuffix(":")
    if len(words) > _LONGEST:
        words = f"{words[:_LONGEST]} ..."
    return words if function is None else f"{words} ({_place(error, function)})"


def _place(error: BaseException, function: Callable[..., Any]) -> str:
    """The last line of the user's that was executed: in the folder of the behaviour's file, not in what it calls."""
    code = function.__code__
    folder = os.path.dirname(code.co_filename)
    own = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if os.path.dirname(frame.filename) == folder and frame.lineno is not None
    ]
    file, line = (own[-1].filename, own[-1].lineno) if own else (code.co_filename, code.co_firstlineno)
    return f"{os.path.basename(file)}, line {line}"
