"""Numbers with units and limits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any

import pytest

from muro_zenoh.errors import ParameterError
from muro_zenoh.quantities import Count, Length, Number, Quantity, check_quantities, quantities, quantity_of


@dataclass(frozen=True, slots=True)
class Shape:
    radius: Length = 1.0
    sides: Count | None = None
    place: tuple[Number, ...] = ()
    name: str = ""

    def __post_init__(self) -> None:
        check_quantities(self)


@pytest.mark.parametrize(
    ("quantity", "allowed", "refused"),
    [
        (Quantity(), (0, -1.5, 1e300), (math.nan, math.inf, "1", None, True)),
        (Quantity(finite=False), (math.inf, -math.inf), (math.nan,)),
        (Quantity(above=0.0), (1e-300,), (0.0, -1)),
        (Quantity(at_least=0.0, below=1.0), (0.0, 0.999), (1.0, -1e-9)),
        (Quantity(at_most=2.0), (2, -5.0), (2.1,)),
        (Quantity(whole=True), (3, -1), (3.0, 2.5)),
    ],
)
def test_limits(quantity: Quantity, allowed: tuple[Any, ...], refused: tuple[Any, ...]) -> None:
    assert all(map(quantity.allows, allowed))
    assert not any(map(quantity.allows, refused))
    assert quantity.allows_all(allowed)
    assert quantity.allows_all((allowed, ()))
    assert not quantity.allows_all((*allowed, refused[0]))


@pytest.mark.parametrize(
    ("quantity", "words"),
    [
        (Quantity(), "a number"),
        (Quantity("m/s", above=0.0), "a number above 0 [m/s]"),
        (Quantity("px", at_least=1.0, at_most=8192.0, whole=True), "a whole number at least 1 and at most 8192 [px]"),
    ],
)
def test_a_quantity_describes_its_limits(quantity: Quantity, words: str) -> None:
    assert str(quantity) == words


def test_quantities_are_found_on_the_fields() -> None:
    assert list(quantities(Shape)) == ["radius", "sides", "place"]
    assert quantities(Shape)["radius"].unit == "m"
    assert quantity_of(dict[str, Length]) is None
    assert quantity_of(Annotated[tuple[Length, ...], "a note"] | None) == quantity_of(Length)


def test_a_value_outside_its_limits_is_refused_by_name() -> None:
    assert Shape(sides=3, place=(1.0, 2.0)).sides == 3
    with pytest.raises(ParameterError, match=r"^radius: got -1, expected a number at least 0.001 \[m\]$") as refused:
        Shape(radius=-1)
    assert (refused.value.what, refused.value.got) == ("radius", "-1")
    with pytest.raises(ParameterError, match=r"sides: got 2\.5, expected a whole number at least 0"):
        Shape(sides=2.5)  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match="place: got "):
        Shape(place=(1.0, math.nan))
