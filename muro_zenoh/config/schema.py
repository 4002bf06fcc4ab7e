"""How a section of a settings file is declared.

A section is a frozen dataclass (or a :class:`msgspec.Struct`); each field is a key. Nested dataclasses need no table of
their own: their keys are lifted to the level of the outer ones::

    @dataclass(frozen=True, slots=True)
    class Parameters:
        profile: SpeedProfile = SpeedProfile()              # v_min = 0.1, v_max = 0.3, ...
        law: VectorFieldGains | LqrGains = LqrGains()       # law = "lqr", radial_size = 0.05
        turning_radius: Length = 0.3

A union of dataclasses is a choice: the key with the field's name selects one by its class attribute ``NAME``, and only
the keys of that one may be given.
"""

from __future__ import annotations

import dataclasses
import types
from collections.abc import Mapping
from functools import cache
from typing import Annotated, Any, Final, NamedTuple, Union, get_args, get_origin, get_type_hints

import msgspec

from muro_zenoh.quantities import check_quantities

REQUIRED: Final = object()
"""The default of a field that must be given."""


class Section(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A table of a settings file.

    Raises:
        ParameterError: a number outside its limits.
    """

    def __post_init__(self) -> None:
        check_quantities(self)


class Field(NamedTuple):
    """A field of a section.

    Attributes:
        name: its name.
        hint: its type.
        lifted: the dataclasses whose keys are lifted, by ``NAME``; a single one, which needs no name, is under "".
        optional: whether it may be None.
        default: its default value; ``REQUIRED`` when it must be given.
    """

    name: str
    hint: Any
    lifted: Mapping[str, type]
    optional: bool
    default: Any

    @property
    def is_key(self) -> bool:
        """Whether its name is a key: not that of a single lifted dataclass."""
        return "" not in self.lifted


@cache
def fields_of(kind: type) -> tuple[Field, ...]:
    """The fields of a section.

    Args:
        kind: the section's type.

    Raises:
        TypeError: not a dataclass or a Struct, or a choice between dataclasses without distinct names.
    """
    hints = get_type_hints(kind, include_extras=True)
    return tuple(_field(kind, name, hints[name], default) for name, default in _defaults(kind))


@cache
def all_keys(kind: type) -> Mapping[str, tuple[str, str] | None]:
    """Every key that a section may have, including lifted ones.

    Args:
        kind: the section's type.

    Returns:
        By key: the choice that it depends on, as key and name; None for one that can always be given.
    """
    keys: dict[str, tuple[str, str] | None] = {}
    for field in fields_of(kind):
        if field.is_key:
            keys[field.name] = None
        for name, option in field.lifted.items():
            for key, condition in all_keys(option).items():
                keys[key] = condition or ((field.name, name) if name else None)
    return keys


@cache
def check_schema(kind: type) -> None:
    """Refuse a section with an ambiguous key.

    Args:
        kind: the section's type.

    Raises:
        TypeError: two fields have the same key.
    """
    owners: dict[str, str] = {}
    for field in fields_of(kind):
        keys = [field.name] if field.is_key else []
        for option in field.lifted.values():
            check_schema(option)
        keys += sorted({key for option in field.lifted.values() for key in all_keys(option)})
        for key in keys:
            if key in owners:
                raise TypeError(
                    f"{kind.__name__}: the fields {owners[key]!r} and {field.name!r} both have the key {key!r}"
                )
            owners[key] = field.name


def _defaults(kind: type) -> list[tuple[str, Any]]:
    if dataclasses.is_dataclass(kind):
        return [(f.name, _default(f, dataclasses.MISSING)) for f in dataclasses.fields(kind) if f.init]
    if issubclass(kind, msgspec.Struct):
        return [(f.name, _default(f, msgspec.NODEFAULT)) for f in msgspec.structs.fields(kind)]
    raise TypeError(f"{kind.__name__}: expected a dataclass or a Struct")


def _default(field: Any, missing: Any) -> Any:
    if field.default is not missing:
        return field.default
    return field.default_factory() if field.default_factory is not missing else REQUIRED


def _field(kind: type, name: str, hint: Any, default: Any) -> Field:
    base = get_args(hint)[0] if get_origin(hint) is Annotated else hint
    options = get_args(base) if get_origin(base) in (Union, types.UnionType) else (base,)
    optional = types.NoneType in options
    options = tuple(option for option in options if option is not types.NoneType)
    if not all(isinstance(option, type) and dataclasses.is_dataclass(option) for option in options):
        return Field(name, hint, {}, optional, default)
    if len(options) == 1:
        return Field(name, hint, {"": options[0]}, optional, default)
    lifted = {getattr(option, "NAME", ""): option for option in options}
    if "" in lifted or len(lifted) < len(options):
        raise TypeError(f"{kind.__name__}.{name}: each option of a choice needs a NAME of its own, got {options}")
    return Field(name, hint, lifted, optional, default)
