"""``[[order]]`` rows: what an operator orders during a check, and when."""

from __future__ import annotations

from typing import Literal

from msgspec import field

from muro_zenoh.config.schema import Section
from muro_zenoh.messages import Name, Value
from muro_zenoh.quantities import Duration


class OrderRow(Section, frozen=True, kw_only=True):
    """An order at a time, given as ``muro set``, ``muro stop`` and ``muro resume`` do.

    Attributes:
        at: when it is given, from the start of the run [s].
        kind: a ``behaviour``, a ``stop`` or a ``resume``.
        robots: which robots; none for all.
        behaviour: the name of the behaviour, for that kind; a robot's goals are those of ``[goals]``.
        parameters: the behaviour's, by key.
    """

    at: Duration
    kind: Literal["behaviour", "stop", "resume"] = "behaviour"
    robots: tuple[Name, ...] = ()
    behaviour: str = ""
    parameters: dict[str, Value] = field(default_factory=dict)
