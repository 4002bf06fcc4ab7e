"""A table of a settings file becomes a checked value, or an error that names the file and the key.

A section is a frozen dataclass (or a :class:`msgspec.Struct`); each field is a key. Dataclasses in it need no table of
their own: their keys are lifted and stand beside the outer ones::

    @dataclass(frozen=True, slots=True)
    class Parameters:
        profile: SpeedProfile = SpeedProfile()              # v_min = 0.1, v_max = 0.3, ...
        law: VectorFieldGains | LqrGains = LqrGains()       # law = "lqr", radial_size = 0.05
        turning_radius: Length = 0.3

A union of dataclasses is a choice: the key with the field's name picks one by its class attribute ``NAME``, and only
the keys of that one may be given.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import types
from collections.abc import Mapping
from functools import cache
from typing import Annotated, Any, Final, NamedTuple, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import msgspec

from muro_zenoh.config.descriptions import expected, show
from muro_zenoh.config.origin import Origin
from muro_zenoh.errors import ConfigError, ParameterError
from muro_zenoh.quantities import quantity_of

T = TypeVar("T")

_REQUIRED: Final = object()


class Field(NamedTuple):
    """A field of a section.

    Attributes:
        name: of it.
        hint: its type.
        lifted: the dataclasses whose keys are lifted, by ``NAME``; one alone, which needs no name, stands under "".
        optional: whether it may be None.
        default: what it is when nothing is given; a private marker when it must be given.
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


def read_section(kind: type[T], table: Mapping[str, Any], origin: Origin, path: str, default: T | None = None) -> T:
    """A table as a checked value.

    Args:
        kind: the section's type: a frozen dataclass or a Struct.
        table: the keys that are given.
        origin: where they came from, for errors.
        path: the full key of the table, such as ``robot.r1``.
        default: fills in what is not given, in place of the type's own defaults.

    Raises:
        ConfigError: an unknown key, a wrong type or range, or values that do not fit together.
        TypeError: the section is no schema: two fields want the same key, or a choice has no names.
    """
    section: Any = kind
    check_schema(section)
    reader = _Reader(table, origin, path)
    reader.check(reader.keys(section, default), all_keys(section))
    return cast(T, reader.build(section, default))


def read_value(hint: Any, value: object, origin: Origin, path: str) -> Any:
    """A single value, checked.

    Args:
        hint: its type.
        value: what the file has.
        origin: where it came from, for errors.
        path: its full key.

    Raises:
        ConfigError: a wrong type, a number outside its limits or not finite.
    """
    try:
        converted = msgspec.convert(value, hint)
    except msgspec.ValidationError:
        raise ConfigError(origin.at(path), got=show(value), expected=expected(hint)) from None
    quantity = quantity_of(hint)
    if quantity is not None and converted is not None:
        if not quantity.allows_all(converted):
            raise ConfigError(origin.at(path), got=show(value), expected=expected(hint))
    elif not _is_finite(converted):
        what = "a finite number" if isinstance(converted, float) else "finite numbers"
        raise ConfigError(origin.at(path), got=show(value), expected=what)
    return converted


def config_error(error: ParameterError, origin: Origin, path: str) -> ConfigError:
    """What a law or a behaviour refuses, as an error in the settings that it came from.

    Args:
        error: what was refused.
        origin: where the settings came from.
        path: the full key of their table.
    """
    return ConfigError(origin.at(_join(path, error.what)), got=error.got, expected=error.expected, hint=error.hint)


def check_keys(table: Mapping[str, Any], known: tuple[str, ...], origin: Origin, path: str) -> None:
    """Refuse unknown keys.

    Args:
        table: what is given.
        known: the keys that something reads.
        origin: where they came from, for errors.
        path: the full key of the table.

    Raises:
        ConfigError: an unknown key, with the ones that there are and the one that may have been meant.
    """
    for key in table:
        if key not in known:
            close = difflib.get_close_matches(key, known, n=1)
            raise ConfigError(
                origin.at(_join(path, key)),
                got="a key that nothing reads",
                expected=f"one of {', '.join(known)}" if known else "no keys here",
                hint=f"Did you mean {close[0]}?" if close else "",
            )


# ---- schema


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
    """Every key that a section may have, those lifted included.

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
    """Refuse a section in which one key would mean two things.

    Args:
        kind: the section's type.

    Raises:
        TypeError: two fields want the same key.
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
    return field.default_factory() if field.default_factory is not missing else _REQUIRED


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


# ---- reading


class _Reader:
    """One table being read.

    Args:
        table: the keys that are given.
        origin: where they came from, for errors.
        path: the full key of the table.
    """

    def __init__(self, table: Mapping[str, Any], origin: Origin, path: str) -> None:
        self._table = table
        self._origin = origin
        self._path = path

    def keys(self, kind: type, default: Any) -> tuple[str, ...]:
        """The keys that may be given, with the choices as the table makes them.

        Args:
            kind: the section's type.
            default: a value of it that fills in what is not given.
        """
        keys: list[str] = []
        for field in fields_of(kind):
            if field.is_key:
                keys.append(field.name)
            fallback = self._default(field, default)
            chosen = self._chosen(field, fallback)
            if chosen is not None:
                keys += self.keys(chosen, _if_a(chosen, fallback))
        return tuple(keys)

    def check(self, active: tuple[str, ...], known: Mapping[str, tuple[str, str] | None]) -> None:
        """Refuse keys that nothing reads.

        Args:
            active: the keys that may be given, with the choices as they are.
            known: those that other choices would have, too.
        """
        for key in self._table:
            condition = known.get(key)
            if key not in active and condition is not None:
                choice, name = condition
                raise ConfigError(
                    self._origin.at(_join(self._path, key)),
                    got=f'a key of {choice} = "{name}", which is not chosen',
                    expected=f"one of {', '.join(active)}",
                    hint=f'Set {choice} = "{name}", or remove {key}.',
                )
        check_keys(self._table, active, self._origin, self._path)

    def build(self, kind: type, default: Any) -> Any:
        """The value of a section.

        Args:
            kind: its type.
            default: a value of it that fills in what is not given; None for the type's own defaults.
        """
        values: dict[str, Any] = {}
        for field in fields_of(kind):
            fallback = self._default(field, default)
            chosen = self._chosen(field, fallback)
            if chosen is not None:
                inner = _if_a(chosen, fallback)
                keys = [field.name] if field.is_key else self.keys(chosen, inner)
                if fallback is not None or any(key in self._table for key in keys):
                    values[field.name] = self.build(chosen, inner)
            elif field.name in self._table:
                path = _join(self._path, field.name)
                values[field.name] = read_value(field.hint, self._table[field.name], self._origin, path)
            if field.name not in values:
                if fallback is _REQUIRED:
                    words = _options(field) if field.lifted else expected(field.hint)
                    raise ConfigError(self._origin.at(_join(self._path, field.name)), got="nothing", expected=words)
                values[field.name] = fallback
        try:
            return kind(**values)
        except ParameterError as error:
            raise config_error(error, self._origin, self._path) from None

    def _chosen(self, field: Field, default: Any) -> type | None:
        """The dataclass whose keys are lifted for a field; None when there is none."""
        if not field.lifted or not field.is_key:
            return field.lifted.get("")
        if field.name not in self._table:
            return type(default) if type(default) in field.lifted.values() else None
        name = self._table[field.name]
        if not isinstance(name, str) or name not in field.lifted:
            close = difflib.get_close_matches(name, field.lifted, n=1) if isinstance(name, str) else []
            raise ConfigError(
                self._origin.at(_join(self._path, field.name)),
                got=show(name),
                expected=_options(field),
                hint=f"Did you mean {close[0]!r}?" if close else "",
            )
        return field.lifted[name]

    @staticmethod
    def _default(field: Field, default: Any) -> Any:
        return getattr(default, field.name) if hasattr(default, field.name) else field.default


def _if_a(kind: type, value: Any) -> Any:
    return value if type(value) is kind else None


def _options(field: Field) -> str:
    return "one of " + ", ".join(repr(name) for name in field.lifted)


def _join(path: str, key: str) -> str:
    return f"{path}.{key}" if path else key


def _is_finite(value: object) -> bool:
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, tuple | list):
        return all(_is_finite(item) for item in value)
    if isinstance(value, dict):
        return all(_is_finite(item) for item in value.values())
    return True
