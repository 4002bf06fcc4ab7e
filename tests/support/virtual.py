"""Tests in virtual time."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from typing import Any

from muro_zenoh.runtime.virtual_time import run_virtually


def virtual(test: Callable[[], Coroutine[Any, Any, None]]) -> Callable[[], None]:
    """A test that runs in virtual time."""

    def run() -> None:
        run_virtually(test())

    run.__name__, run.__doc__ = test.__name__, test.__doc__
    return run
