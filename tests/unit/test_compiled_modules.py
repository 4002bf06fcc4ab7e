"""What may be compiled: nothing that Python looks into at run time."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def compiled_modules() -> list[str]:
    """The modules that the hook in pyproject.toml compiles."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    hook = settings["tool"]["hatch"]["build"]["targets"]["wheel"]["hooks"]["mypyc"]
    files = {path for pattern in hook["include"] for path in ROOT.glob(pattern)}
    files -= {path for pattern in hook["exclude"] for path in ROOT.glob(pattern)}
    return sorted(".".join(path.relative_to(ROOT).with_suffix("").parts) for path in files)


@pytest.mark.parametrize("name", compiled_modules())
def test_it_has_no_values_that_check_themselves(name: str) -> None:
    """mypyc drops the quantities from a dataclass's annotations, whose limits would not be checked, and a frozen one
    can no longer be pickled."""
    module = importlib.import_module(name)
    own = [kind for _, kind in inspect.getmembers(module, inspect.isclass) if kind.__module__ == name]
    frozen = [kind.__name__ for kind in own if dataclasses.is_dataclass(kind) and kind.__dataclass_params__.frozen]
    assert not frozen, f"{name}: move {', '.join(frozen)} to a module that is not compiled"
