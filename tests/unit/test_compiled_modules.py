"""What may be compiled: nothing that Python looks into at run time."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
from typing import Annotated, get_origin, get_type_hints

import pytest

from muro_zenoh import is_compiled
from tests.support.wheels import ROOT, compiled_in, mypyc_hook, to_compile


@pytest.mark.parametrize("name", sorted(file.removesuffix(".py").replace("/", ".") for file in to_compile()))
def test_it_has_no_values_that_check_themselves(name: str) -> None:
    """mypyc drops the quantities from a class's annotations, whose limits would not be checked, and a frozen dataclass
    can no longer be pickled."""
    module = importlib.import_module(name)
    for kind in (kind for _, kind in inspect.getmembers(module, inspect.isclass) if kind.__module__ == name):
        frozen = dataclasses.is_dataclass(kind) and kind.__dataclass_params__.frozen
        hints = get_type_hints(kind, include_extras=True)
        limited = [key for key, hint in hints.items() if get_origin(hint) is Annotated]
        assert not frozen, f"{name}: move {kind.__name__}, which is frozen, to a module that is not compiled"
        assert not limited, f"{name}: move {kind.__name__}, whose {limited} have limits, to one that is not compiled"


@pytest.mark.parametrize("key", ["include", "exclude"])
def test_each_pattern_names_a_file(key: str) -> None:
    assert [pattern for pattern in mypyc_hook()[key] if not any(ROOT.glob(pattern))] == []


def test_nothing_compiled_lies_beside_a_source() -> None:
    """It would go on running when that is edited: delete it."""
    assert compiled_in(ROOT) == set()
    assert not is_compiled()


def test_the_checks_and_the_compiled_build_have_the_same_mypy() -> None:
    constraints = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    (fixed,) = (row for row in mypyc_hook()["dependencies"] if row.startswith("mypy=="))
    assert fixed in constraints
