"""The kinds of rows in the table: channels and orders, with the roles at their ends."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import Final, Generic, Literal, TypeVar

from muro_zenoh.messages import Message

__all__ = ["ALL_ROLES", "Channel", "Delivery", "Party", "Priority", "Role", "Verb"]

M_co = TypeVar("M_co", bound=Message, covariant=True)

Delivery = Literal["newest", "every", "kept"]
"""``newest``: a reader wants the last value. ``every``: each one, from a bounded queue that drops the oldest.
``kept``: the last value, and late joiners receive it too."""


class Role(StrEnum):
    """What a process is in the fleet. One process may have several: the simulator is also bases and cameras."""

    AGENT = "agent"
    BASE = "base"
    BASESTATION = "basestation"
    CAMERA = "camera"
    SIMULATOR = "simulator"
    OPERATOR = "operator"
    """Operators' tools, and a lab's own programs."""
    SUPERVISOR = "supervisor"
    """A run, which has started the other processes, and breaks them where a scenario or an operator wants it."""


ALL_ROLES: Final = frozenset(Role)
"""For tests, and for tools that stand in for any process."""


@dataclass(frozen=True, slots=True)
class Party:
    """One end of a channel.

    Attributes:
        role: the role of the process.
        task: the task in it; empty where the process has only one.
    """

    role: Role
    task: str = ""

    def __str__(self) -> str:
        return f"{self.role}/{self.task}" if self.task else str(self.role)


class Priority(IntEnum):
    """Priority of a message; the numbers are Zenoh's."""

    REAL_TIME = 1
    HIGH = 2
    DATA = 5
    BACKGROUND = 7


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel(Generic[M_co]):
    """One row of the table.

    Attributes:
        word: the second word of its keys.
        kind: the message on it.
        writers: who publishes it; the bus refuses all others.
        readers: who subscribes to it; a lab's own programs may as well.
        delivery: what a reader gets.
        rate: how often each key is written [Hz]; None for events.
        pacing: when it is written, where that is more than a fixed rate.
        stale_after: age above which its value must not be used [s]; infinite where age does not matter. A fleet file
            may set others for what robots drive by: :class:`~muro_zenoh.config.Timeouts`.
        priority: its priority.
        named: what the third word of the key names; empty when the channel has one key only.
        ros: the topic it replaces.
        note: further remarks.
    """

    word: str
    kind: type[M_co]
    writers: tuple[Party, ...]
    readers: tuple[Party, ...]
    delivery: Delivery
    rate: float | None = None
    pacing: str = ""
    stale_after: float = math.inf
    priority: Priority = Priority.DATA
    named: str = "robot"
    ros: str = ""
    note: str = ""

    @property
    def period(self) -> float:
        """Time between two messages on one key [s]; infinite for events."""
        return 1.0 / self.rate if self.rate is not None else math.inf


@dataclass(frozen=True, slots=True)
class Verb(Generic[M_co]):
    """An order: a Zenoh query with one reply.

    Attributes:
        word: what is ordered.
        kind: the message that orders it.
        named: what the last word of the key names; empty where only one process answers.
        answered_by: the role that takes it.
        asked_by: the roles that may give it.
        ros: the topic it replaces.
        at_any_age: whether it is carried out even when it may be left over from a pause of the process that takes it.
    """

    word: str
    kind: type[M_co]
    named: str = ""
    answered_by: Role = Role.BASESTATION
    asked_by: tuple[Role, ...] = (Role.OPERATOR,)
    ros: str = ""
    at_any_age: bool = False
