"""What a page may order, as it comes over the WebSocket: strict, so that nothing else is taken for an order."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from muro_zenoh.messages import Name, Names, Value


class Order(msgspec.Struct, tag_field="order", forbid_unknown_fields=True, frozen=True, kw_only=True):
    """What every order has.

    Attributes:
        id: comes back in the reply.
    """

    id: Annotated[int, Meta(ge=0, le=2**53)]

    @property
    def word(self) -> str:
        """Which order it is."""
        return str(self.__struct_config__.tag)


class StopOrder(Order, frozen=True, kw_only=True, tag="stop"):
    """Stop ``names``; none for all robots."""

    names: Names = ()


class ResumeOrder(Order, frozen=True, kw_only=True, tag="resume"):
    """Lift the stop of ``names``, none for all robots, as long as it is the one of the ``revision`` that was shown."""

    revision: Annotated[int, Meta(ge=0, le=2**53)]
    names: Names = ()


class GoalOrder(Order, frozen=True, kw_only=True, tag="goal"):
    """Send the robot ``name`` to ``x``, ``y`` [m, world] with the heading ``theta`` [rad], nil for any."""

    name: Name
    x: float
    y: float
    theta: float | None = None


class BehaviourOrder(Order, frozen=True, kw_only=True, tag="behaviour"):
    """Change the behaviour of ``names``; none for all robots."""

    behaviour: Annotated[str, Meta(max_length=128)]
    parameters: dict[str, Value] = msgspec.field(default_factory=dict)
    names: Names = ()


class CircleOrder(Order, frozen=True, kw_only=True, tag="circle"):
    """Change the circle; what is nil stays."""

    x: float | None = None
    y: float | None = None
    radius: float | None = None
    clockwise: bool | None = None


class ClearOrder(Order, frozen=True, kw_only=True, tag="clear"):
    """Forget where the robot ``name`` was last seen."""

    name: Name


class DriveOrder(Order, frozen=True, kw_only=True, tag="drive"):
    """Drive the robot ``name`` by hand: ``v`` [m/s], ``omega`` [rad/s], by what was seen in the state of ``t`` [s]."""

    name: Name
    v: float
    omega: float
    t: float


class PictureOrder(Order, frozen=True, kw_only=True, tag="picture"):
    """Send the pictures of ``camera``, or no longer."""

    camera: Name
    on: bool


class BreakOrder(Order, frozen=True, kw_only=True, tag="break"):
    """Let a fault of ``kind`` with its ``numbers`` befall ``target``, for a ``duration`` [s] or the rest of the run."""

    kind: Annotated[str, Meta(max_length=32)]
    target: Annotated[str, Meta(max_length=80)]
    duration: float | None = None
    numbers: dict[str, Value] = msgspec.field(default_factory=dict)


Answered = ResumeOrder | GoalOrder | BehaviourOrder | CircleOrder | ClearOrder | BreakOrder

AnyOrder = StopOrder | DriveOrder | PictureOrder | Answered

_decode = msgspec.msgpack.Decoder(AnyOrder).decode


class BadMessage(Exception):  # noqa: N818 - what a client sent, not an error of ours
    """What a client sent is no order; the text says why."""


def read_order(data: bytes) -> AnyOrder:
    """An order.

    Args:
        data: the message.

    Raises:
        BadMessage: it is none.
    """
    try:
        order: AnyOrder = _decode(data)
    except (msgspec.MsgspecError, ValueError, RecursionError) as error:
        raise BadMessage(f"not an order: {error}"[:300]) from None
    return order
