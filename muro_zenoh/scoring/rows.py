"""The rows of a score sheet: a value's definition, unit and decimals, declared once on its field.

::

    @dataclass(frozen=True, slots=True)
    class ProcessUse(Table):
        rss_mb: Annotated[float | None, Row("largest resident memory seen", "MB", digits=1)]

The table in ``report.json`` and the one in ``docs/scoresheet.md`` are both made from such fields.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, get_args, get_origin, get_type_hints


@dataclass(frozen=True, slots=True)
class Row:
    """A field of a score sheet.

    Args:
        definition: definition of the value. For a nested table: the quantity of which its rows give, for example, the
            median.
        unit: such as ``m``; empty for a plain number. That of a nested table applies to its rows without a unit.
        digits: decimals to which the value, or every value of a nested table, is rounded; None for no rounding.
        by: what the keys of a mapping name, such as ``robot``.
    """

    definition: str = ""
    unit: str = ""
    digits: int | None = None
    by: str = ""


class Table:
    """Base of the frozen dataclasses of a score sheet. Numbers are rounded to the digits of their rows."""

    __slots__ = ()

    def __post_init__(self) -> None:
        for name, _, row in _fields(type(self)):
            if row.digits is not None:
                object.__setattr__(self, name, _rounded(getattr(self, name), row.digits))


class Definition(NamedTuple):
    """One line of the documentation: a ``key`` with dots, the ``unit`` of its value, and its ``text``."""

    key: str
    unit: str
    text: str


def definitions(kind: type[Table], path: str = "", parent: Row | None = None) -> Iterator[Definition]:
    """Every key of a table, including those of nested tables, in order.

    Args:
        kind: the table's class.
        path: key of the table itself, with a dot at its end; empty for the whole sheet.
        parent: row of the table itself.
    """
    parent = parent or Row()
    for index, (name, hint, row) in enumerate(_fields(kind)):
        key, inner = path + name, hint
        if get_origin(hint) is Mapping:
            key, inner = f"{key}.<{row.by}>", get_args(hint)[1]
        if get_origin(inner) is tuple:
            key, inner = f"{key}[]", get_args(inner)[0]
        if isinstance(inner, type) and issubclass(inner, Table):
            yield from definitions(inner, f"{key}.", row)
            continue
        text = row.definition
        if parent.definition:
            text = f"the same: {text}" if index else f"{text} of {parent.definition}"
        yield Definition(key, row.unit or parent.unit, text)


def as_json(value: Any) -> Any:
    """A table as plain JSON values.

    Args:
        value: a table, or a value in one.
    """
    if isinstance(value, Table):
        return {name: as_json(getattr(value, name)) for name, _, _ in _fields(type(value))}
    if isinstance(value, Mapping):
        return {key: as_json(inner) for key, inner in value.items()}
    if isinstance(value, tuple):
        return [as_json(inner) for inner in value]
    return value


def _fields(kind: type[Table]) -> tuple[tuple[str, Any, Row], ...]:
    """Name, type and row of each field."""
    found = []
    for name, hint in get_type_hints(kind, include_extras=True).items():
        plain, *notes = get_args(hint)
        (row,) = (note for note in notes if isinstance(note, Row))
        found.append((name, plain, row))
    return tuple(found)


def _rounded(value: Any, digits: int) -> Any:
    if isinstance(value, Table):
        return type(value)(*(_rounded(getattr(value, name), digits) for name, _, _ in _fields(type(value))))
    if isinstance(value, Mapping):
        return {key: _rounded(inner, digits) for key, inner in value.items()}
    return None if value is None else round(value, digits)
