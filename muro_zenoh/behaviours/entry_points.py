"""Functions that settings name as ``module:function``."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Callable
from typing import Any, Final

from muro_zenoh.errors import BehaviourError

BEHAVIOURS: Final = "MURO_BEHAVIOURS"
"""Environment variable with folders that are searched for a user's behaviours after Python's path; `muro` sets it to
the scenario file's folder. They are searched last, so that nothing in them shadows an installed module."""


def load_function(name: str) -> Callable[..., Any]:
    """Import a function by its name.

    Args:
        name: ``module:function``; the module is beside the scenario file or on Python's path.

    Raises:
        BehaviourError: a malformed name, no such module or function, or the import failed.
    """
    module_name, _, function_name = name.partition(":")
    if not all(part.isidentifier() for part in (*module_name.split("."), function_name)):
        raise BehaviourError(f"function: got {name!r}, expected module:function")
    for folder in os.environ.get(BEHAVIOURS, "").split(os.pathsep):
        if folder and folder not in sys.path:
            sys.path.append(folder)
    try:
        function = getattr(importlib.import_module(module_name), function_name)
    except ModuleNotFoundError as error:
        raise BehaviourError(f"{error}; put it beside the scenario file, or on PYTHONPATH") from error
    except AttributeError:
        raise BehaviourError(f"module {module_name} has no function {function_name!r}") from None
    except (Exception, SystemExit) as error:  # a script without a main guard may exit when imported
        raise BehaviourError(f"importing {module_name} failed: {error!r}") from error
    if not callable(function):
        raise BehaviourError(f"{name}: got {function!r}, expected a function")
    return function  # type: ignore[no-any-return]  # just checked
