"""A behaviour's failure: what it may raise, and that in one line with the line in the user's file."""

from __future__ import annotations

import asyncio
import os
import traceback
from collections.abc import Callable
from typing import Any, Final

from muro_zenoh.errors import MuroError

FAILURES: Final = (Exception, BaseExceptionGroup, SystemExit, asyncio.CancelledError)
"""What a behaviour may raise without ending its agent. In a plain function a cancellation is always its own."""

OnFailure = Callable[[BaseException], str]
"""Takes what a behaviour has raised; returns the reason to hold with."""

_LONGEST = 200
"""Maximum length for the live table [characters]."""


def failure_of(error: BaseException, function: Callable[..., Any] | None = None) -> str:
    """An exception in one line, for operators; the log has the whole traceback.

    Args:
        error: the exception; of a group, the first one counts.
        function: the user's behaviour that raised it; None for a built-in one.

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
    """The last executed line in the folder of the behaviour's file, not in libraries that it calls."""
    code = function.__code__
    folder = os.path.dirname(code.co_filename)
    own = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if os.path.dirname(frame.filename) == folder and frame.lineno is not None
    ]
    file, line = (own[-1].filename, own[-1].lineno) if own else (code.co_filename, code.co_firstlineno)
    return f"{os.path.basename(file)}, line {line}"
