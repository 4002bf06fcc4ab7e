"""Reads a table of a settings file as a checked value; errors name the file and the key.

How a section is declared: :mod:`muro_zenoh.config.schema`.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar, cast

import msgspec

from muro_zenoh.config.descriptions import expected, show
from muro_zenoh.config.origin import Origin
from muro_zenoh.config.schema import REQUIRED, Field, all_keys, check_schema, fields_of
from muro_zenoh.errors import ConfigError, ParameterError
from muro_zenoh.quantities import quantity_of

T = TypeVar("T")


def read_section(kind: type[T], table: object, origin: Origin, path: str, default: T | None = None) -> T:
    """A table as a checked value.

    Args:
        kind: the section's type: a frozen dataclass or a Struct.
        table: the given keys.
        origin: their origin, for errors.
        path: the full key of the table, such as ``robot.r1``.
        default: values for the keys that are not given, instead of the type's own defaults.

    Raises:
        ConfigError: not a table, an unknown key, a wrong type or range, or inconsistent values.
        TypeError: the section is not a valid schema: two fields with the same key, or a choice without names.
    """
    section: Any = kind
    check_schema(section)
    reader = _Reader(read_table(table, origin, path), origin, path)
    reader.check(reader.keys(section, default), all_keys(section))
    return cast(T, reader.build(section, default))


def read_table(value: object, origin: Origin, path: str) -> Mapping[str, Any]:
    """A value that must be a table.

    Args:
        value: the value in the file.
        origin: its origin, for errors.
        path: its full key.

    Raises:
        ConfigError: it is not a table.
    """
    if not isinstance(value, Mapping):
        raise ConfigError(origin.at(path), got=show(value), expected=f"a table [{path}]")
    return value


def read_rows(value: object, origin: Origin, path: str) -> Sequence[Any]:
    """A value that must be rows of one kind.

    Args:
        value: the value in the file.
        origin: its origin, for errors.
        path: its full key.

    Raises:
        ConfigError: it is not a list.
    """
    if not isinstance(value, list | tuple):
        raise ConfigError(origin.at(path), got=show(value), expected=f"rows [[{path}]]")
    return value


def read_value(hint: Any, value: object, origin: Origin, path: str) -> Any:
    """A single value, checked.

    Args:
        hint: its type.
        value: the value in the file.
        origin: its origin, for errors.
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
    """An error of a law or a behaviour as an error in its settings.

    Args:
        error: the error.
        origin: the origin of the settings.
        path: the full key of their table.
    """
    return ConfigError(origin.at(_join(path, error.what)), got=error.got, expected=error.expected, hint=error.hint)


def check_keys(table: Mapping[str, Any], known: tuple[str, ...], origin: Origin, path: str) -> None:
    """Refuse unknown keys.

    Args:
        table: the given keys.
        known: the known keys.
        origin: the origin of the keys, for errors.
        path: the full key of the table.

    Raises:
        ConfigError: an unknown key; the message lists the known ones and suggests a similar one.
    """
    for key in table:
        if key not in known:
            close = difflib.get_close_matches(key, known, n=1)
            raise ConfigError(
                origin.at(_join(path, key)),
                got="an unknown key",
                expected=f"one of {', '.join(known)}" if known else "no keys here",
                hint=f"Did you mean {close[0]}?" if close else "",
            )


def check_choice(value: object, options: tuple[str, ...], origin: Origin, path: str) -> str:
    """One of several names.

    Args:
        value: the value in the file; None when there is none.
        options: the names.
        origin: its origin, for errors.
        path: its full key.

    Raises:
        ConfigError: none of them; the message lists them and suggests a similar one.
    """
    if isinstance(value, str) and value in options:
        return value
    close = difflib.get_close_matches(value, options, n=1) if isinstance(value, str) else []
    raise ConfigError(
        origin.at(path),
        got="nothing" if value is None else show(value),
        expected="one of " + ", ".join(map(repr, options)),
        hint=f"Did you mean {close[0]!r}?" if close else "",
    )


class _Reader:
    """One table being read.

    Args:
        table: the given keys.
        origin: their origin, for errors.
        path: the full key of the table.
    """

    def __init__(self, table: Mapping[str, Any], origin: Origin, path: str) -> None:
        self._table = table
        self._origin = origin
        self._path = path

    def keys(self, kind: type, default: Any) -> tuple[str, ...]:
        """The keys that may be given, with the table's choices.

        Args:
            kind: the section's type.
            default: a value of it, for the keys that are not given.
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
        """Refuse unknown keys.

        Args:
            active: the keys that may be given, with the current choices.
            known: all keys, including those of other choices.
        """
        for key in self._table:
            condition = known.get(key)
            if key not in active and condition is not None:
                choice, name = condition
                raise ConfigError(
                    self._origin.at(_join(self._path, key)),
                    got=f'a key of {choice} = "{name}", which is not selected',
                    expected=f"one of {', '.join(active)}",
                    hint=f'Set {choice} = "{name}", or remove {key}.',
                )
        check_keys(self._table, active, self._origin, self._path)

    def build(self, kind: type, default: Any) -> Any:
        """The value of a section.

        Args:
            kind: its type.
            default: a value of it, for the keys that are not given; None for the type's own defaults.
        """
        values: dict[str, Any] = {}
        for field in fields_of(kind):
            fallback = self._default(field, default)
            chosen = self._chosen(field, fallback)
            if chosen is not None:
                inner = _if_a(chosen, fallback)
                keys = [field.name] if field.is_key else self.keys(chosen, inner)
                given = fallback is not None or any(key in self._table for key in keys)
                values[field.name] = self.build(chosen, inner) if given else None
            elif field.name in self._table:
                path = _join(self._path, field.name)
                values[field.name] = read_value(field.hint, self._table[field.name], self._origin, path)
            elif fallback is REQUIRED:
                words = _options(field) if field.lifted else expected(field.hint)
                raise ConfigError(self._origin.at(_join(self._path, field.name)), got="nothing", expected=words)
            elif default is not None:
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
        path = _join(self._path, field.name)
        return field.lifted[check_choice(self._table[field.name], tuple(field.lifted), self._origin, path)]

    @staticmethod
    def _default(field: Field, default: Any) -> Any:
        return field.default if default is None else getattr(default, field.name)


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
