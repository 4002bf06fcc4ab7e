"""Kept state, orders and answers: circle, behaviours, stop, health, and the orders."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated

from msgspec import Meta, field

from muro_zenoh import geometry
from muro_zenoh.messages.base import Message, Name, Names, Order, Value
from muro_zenoh.messages.lease import Text
from muro_zenoh.quantities import LEAST


class Goal(Order, frozen=True, kw_only=True):
    """An order to a robot: drive to a goal; ``theta`` is nil when the heading does not matter. ``operator``: whose
    order it is."""

    x: float
    y: float
    theta: float | None = None
    operator: Text = ""


_circle = lru_cache(maxsize=16)(geometry.Circle)
"""Every agent asks at each fix, and the answer is checked only once."""


class Circle(Message, frozen=True, kw_only=True):
    """The circle to follow."""

    x: float
    y: float
    radius: Annotated[float, Meta(ge=LEAST)]
    clockwise: bool = False
    revision: Annotated[int, Meta(ge=0)] = 0

    @classmethod
    def of(cls, circle: geometry.Circle, revision: int = 0) -> Circle:
        """The message of a circle.

        Args:
            circle: the circle.
            revision: the revision of the kept state.
        """
        return cls(x=circle.x, y=circle.y, radius=circle.radius, clockwise=circle.clockwise, revision=revision)

    @property
    def circle(self) -> geometry.Circle:
        """The circle as the laws use it."""
        return _circle(self.x, self.y, self.radius, self.clockwise)


class Behaviour(Message, frozen=True, kw_only=True):
    """Which behaviour a robot runs: a built-in name or ``module:function``, and its parameters."""

    behaviour: str
    parameters: dict[str, Value] = field(default_factory=dict)
    revision: Annotated[int, Meta(ge=0)] = 0


class StopOrder(Message, frozen=True, kw_only=True):
    """The whole stop state, never a difference: all robots (``all``), or those in ``names``."""

    all: bool
    names: Names = ()
    revision: Annotated[int, Meta(ge=0)] = 0


class Health(Message, frozen=True, kw_only=True):
    """The state of a process, and the reasons for it.

    Attributes:
        role: ``agent``, ``base``, ``basestation``, ``simulator`` ...
        state: one word, such as ``driving``, ``holding``, ``stopped``, ``failed``.
        reasons: why it does not drive, most important first.
        note: why it drives otherwise than its behaviour wants, such as ``keeps clear of r3``; the newest such reason
            since the previous health message.
        numbers: counters and gauges by name (``pose_received``, ``pose_rejected``, ``command_rate_hz`` ...).
        samples: measurements since the previous health message, by name (``pose_age_s``, ``pose_to_command_s``).
        complaints: what is wrong and does not keep it from driving.
        failure: why the behaviour failed, or ended before another was ordered; empty while it runs.
        behaviour_revision: the revision of the newest order of a behaviour that was obeyed; ``failure`` is about it.
        stop_latched: a stop is latched.
        stop_all: the latched stop was one to all robots.
        stop_names: the robots that the stop orders name that were received; the others remember it for a robot whose
            agent restarts.
        stop_revision: the newest revision of the stop order that was received.
    """

    role: str
    state: str
    reasons: tuple[str, ...] = ()
    note: str = ""
    complaints: tuple[str, ...] = ()
    numbers: dict[str, float] = field(default_factory=dict)
    samples: dict[str, tuple[float, ...]] = field(default_factory=dict)
    failure: str = ""
    behaviour_revision: int = 0
    stop_latched: bool = False
    stop_all: bool = False
    stop_names: Names = ()
    stop_revision: int = 0


class SetCircle(Order, frozen=True, kw_only=True):
    """An order to the base station: change the circle. What is nil stays unchanged. ``operator``: whose order it is."""

    x: float | None = None
    y: float | None = None
    radius: Annotated[float, Meta(ge=LEAST)] | None = None
    clockwise: bool | None = None
    operator: Text = ""


class SetBehaviour(Order, frozen=True, kw_only=True):
    """An order to the base station: change the behaviour of ``names`` (empty: all robots). ``operator``: whose order it
    is."""

    behaviour: str
    parameters: dict[str, Value] = field(default_factory=dict)
    names: Names = ()
    operator: Text = ""


class Stop(Message, frozen=True, kw_only=True):
    """An order to the base station: stop ``names`` (empty: all robots)."""

    names: Names = ()


class Resume(Order, frozen=True, kw_only=True):
    """An order to the base station: lift the stop of ``names`` (empty: all robots) up to ``revision``."""

    revision: Annotated[int, Meta(ge=0)]
    names: Names = ()


class Clear(Order, frozen=True, kw_only=True):
    """An order to the base station: forget a robot's last position, because it was carried away."""

    name: Name


class Break(Message, frozen=True, kw_only=True):
    """An order to a run, and from it to the simulator: let a fault happen now, as a row ``[[fault]]`` of a scenario.

    Attributes:
        fault: the kind of fault.
        target: what it befalls.
        duration: how long it lasts [s]; nil for the rest of the run.
        numbers: its other numbers.
    """

    fault: Text
    target: Text
    duration: float | None = None
    numbers: dict[str, Value] = field(default_factory=dict)


class FaultList(Message, frozen=True, kw_only=True):
    """What a run has broken on an operator's order: ``rows`` is the text for its scenario's file; ``lasting`` are those
    that last now, in words, with those of the scenario itself."""

    rows: str = ""
    lasting: tuple[str, ...] = ()


class AskTime(Message, frozen=True, kw_only=True):
    """A question to the base station, or an agent's to its base, whose four time stamps measure the asker's clock
    (``stamp`` is the first, the Reply has the next two). ``offset``: what the asker has to add to its clock to have the
    answerer's, as far as it has measured that [s]; nil before the first answer. ``steps``: how often it was certain
    that one of the two clocks had been set."""

    offset: float | None = None
    steps: int = 0


class Reply(Message, frozen=True, kw_only=True):
    """The answer to an order: accepted, or refused with the reason. With an accepted one, ``reason`` is why nothing
    follows from it yet; empty when something does. ``received``: when the order came [s, the answerer's clock]."""

    accepted: bool
    reason: str = ""
    revision: int = 0
    received: float = 0.0
