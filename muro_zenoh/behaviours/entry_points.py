"""Functions that settings name as ``module:function``."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Callable
from typing import Any, Final

from muro_zenoh.errors import BehaviourError

BEHAVIOURS: Final = "MURO_BEHAVIOURS"
"""Environment variable with the folders, besides Python's path, in which a user's behaviours are looked for; `muro`
sets it to the scenario file's own. They come last, so that nothing in them hides a module of ours."""


def load_function(name: str) -> Callable[..., Any]:
    """The function that a name stands for.

    Args:
        name: ``module:function``, in a module beside the scenario file, or one that can be imported.

    Raises:
        BehaviourError: not such a name, no such module or function, or its import failed.
    """
    module_name, colon, function_name = name.partition(":")
    if not colon:
        raise BehaviourError(f"function: got {name!r}, expected module:function")
    for folder in os.environ.get(BEHAVIOURS, "").split(os.pathsep):
        if folder and folder not in sys.path:
            sys.path.append(folder)
    try:
        function = getattr(importlib.import_module(module_name), function_name)
    except ModuleNotFoundError as error:
        raise BehaviourError(f"{name!r}: {error}; put it beside the scenario file, or on PYTHONPATH") from error
    except AttributeError:
        raise BehaviourError(f"{name!r}: module {module_name} has no function {function_name!r}") from None
    except (Exception, SystemExit) as error:  # a script without a guard leaves when it is imported
        raise BehaviourError(f"{name!r}: importing {module_name} failed: {error!r}") from error
    if not callable(function):
        raise BehaviourError(f"{name!r}: got {function!r}, expected a function")
    return function  # type: ignore[no-any-return]  # just checked
