"""Numbers with a unit and limits, declared once on a dataclass field, for checks and for documentation.

::

    @dataclass(frozen=True, slots=True)
    class Gains:
        k_o: Annotated[float, Quantity("1/m", above=0.0)] = 15.0

        def __post_init__(self) -> None:
            check_quantities(self)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from types import UnionType
from typing import Annotated, Any, Final, Union, get_args, get_origin, get_type_hints

from muro_zenoh.errors import ParameterError


@dataclass(frozen=True, slots=True)
class Quantity:
    """The unit and the limits of a number.

    Args:
        unit: such as ``m/s``; empty for a plain number.
        above: exclusive lower limit; None for none.
        at_least: inclusive lower limit.
        below: exclusive upper limit.
        at_most: inclusive upper limit.
        finite: whether infinity is refused.
        whole: whether only integers are allowed.
    """

    unit: str = ""
    above: float | None = None
    at_least: float | None = None
    below: float | None = None
    at_most: float | None = None
    finite: bool = True
    whole: bool = False

    def allows(self, value: object) -> bool:
        """Whether a value is a number within the limits; NaN never is.

        Args:
            value: the value.
        """
        if isinstance(value, bool) or not isinstance(value, int | float) or math.isnan(value):
            return False
        return (
            (math.isfinite(value) or not self.finite)
            and (isinstance(value, int) or not self.whole)
            and (self.above is None or value > self.above)
            and (self.at_least is None or value >= self.at_least)
            and (self.below is None or value < self.below)
            and (self.at_most is None or value <= self.at_most)
        )

    def allows_all(self, value: object) -> bool:
        """Whether a value is such a number, or a (nested) tuple of such numbers.

        Args:
            value: the value.
        """
        return all(map(self.allows_all, value)) if isinstance(value, tuple) else self.allows(value)

    def __str__(self) -> str:
        limits = (("above", self.above), ("at least", self.at_least), ("below", self.below), ("at most", self.at_most))
        words = "a whole number" if self.whole else "a number"
        bounds = " and ".join(f"{word} {limit:g}" for word, limit in limits if limit is not None)
        return " ".join(filter(None, [words, bounds, f"[{self.unit}]" if self.unit else ""]))


LEAST: Final = 0.001
"""The least length [m], size of an angle [rad] and turning rate [rad/s]: laws divide by them and by their squares."""

Number = Annotated[float, Quantity()]
Positive = Annotated[float, Quantity(above=0.0)]
Count = Annotated[int, Quantity(at_least=0, whole=True)]
Coordinate = Annotated[float, Quantity("m")]
Height = Annotated[float, Quantity("m", at_least=0.0)]
Length = Annotated[float, Quantity("m", at_least=LEAST)]
Angle = Annotated[float, Quantity("rad", at_least=-2.0 * math.pi, at_most=2.0 * math.pi)]
AngleSize = Annotated[float, Quantity("rad", at_least=LEAST)]
Speed = Annotated[float, Quantity("m/s", above=0.0)]
SpeedOrRest = Annotated[float, Quantity("m/s", at_least=0.0)]
TurningRate = Annotated[float, Quantity("rad/s", at_least=LEAST)]
Acceleration = Annotated[float, Quantity("m/s^2", above=0.0)]
AngularAcceleration = Annotated[float, Quantity("rad/s^2", above=0.0)]
Rate = Annotated[float, Quantity("Hz", above=0.0)]
Duration = Annotated[float, Quantity("s", at_least=0.0)]
Period = Annotated[float, Quantity("s", above=0.0)]


def quantity_of(hint: Any) -> Quantity | None:
    """The quantity that a type hint declares.

    Args:
        hint: the type hint: ``Annotated[float, Quantity(...)]``, that ``| None``, or a tuple of such numbers.
    """
    for note in getattr(hint, "__metadata__", ()):
        if isinstance(note, Quantity):
            return note
    if get_origin(hint) is Annotated:
        return quantity_of(get_args(hint)[0])
    if get_origin(hint) in (Union, UnionType, tuple):
        return next((found for part in get_args(hint) if (found := quantity_of(part)) is not None), None)
    return None


@cache
def quantities(kind: type) -> dict[str, Quantity]:
    """The quantities among a class's fields, by name.

    Args:
        kind: the class.
    """
    hints = get_type_hints(kind, include_extras=True)
    return {name: found for name, hint in hints.items() if (found := quantity_of(hint)) is not None}


def check_quantities(value: Any) -> None:
    """Refuse a value with a number outside its limits. None is left to the type.

    Args:
        value: an instance of a class with quantities among its fields.

    Raises:
        ParameterError: the first such field, with what was got and what was expected.
    """
    for name, quantity in quantities(value.__class__).items():
        number = getattr(value, name)
        if number is not None and not quantity.allows_all(number):
            raise ParameterError(name, got=repr(number), expected=str(quantity))
