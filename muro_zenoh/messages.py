"""Every message on the bus, and the codec.

On the wire a message is a MessagePack map, so that any language can join in. Every one has ``stamp`` (seconds since
1970), ``seq`` and ``epoch`` (random per process start; ``seq`` is compared within one epoch only). SI units, radians
in (-pi, pi], right-handed world frame (REP 103).

A value of a wrong type, an unknown or a missing field, NaN and the infinities make a :class:`MessageError`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from operator import attrgetter
from typing import Annotated, Any, Final, Literal, TypeVar, get_args, get_origin

import msgspec
from msgspec import Meta, Struct

from muro_zenoh import geometry
from muro_zenoh.errors import MessageError

VERSION = 1
"""Version of all message layouts; it stands in the encoding, as in ``application/msgpack;PoseFix.1``."""

Covariance = Annotated[tuple[float, ...], Meta(min_length=9, max_length=9)]
"""Nine floats, row-major, of x [m], y [m], theta [rad]."""

Name = Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_]{0,31}$")]
"""A robot's, a camera's or a process's name."""

Value = bool | int | float | str | tuple[float | str | tuple[float, ...], ...]
"""What a behaviour's parameter may be."""


class Message(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What every message has. A message whose ``stamp`` is 0 is stamped, and numbered, when it is sent.

    Attributes:
        stamp: when it was made (a pose fix, an odometry: when it was measured) [s since 1970, the writer's clock].
        seq: counts a writer's messages on one key from 1.
        epoch: the writer's process, a number drawn at its start.
    """

    stamp: float = 0.0
    seq: Annotated[int, Meta(ge=0)] = 0
    epoch: Annotated[int, Meta(ge=0)] = 0

    def __post_init__(self) -> None:
        scalars, vectors, others = _number_fields(type(self))
        total = sum(scalars(self))
        for name in vectors:
            total = sum(getattr(self, name), total)
        # One sum says it for all numbers; only where it is not finite, the field is looked for.
        if not math.isfinite(total):
            others = tuple(field.name for field in msgspec.structs.fields(type(self)))
        for name in others:
            _require_finite(name, getattr(self, name))


class Frame(Message, frozen=True, kw_only=True):
    """A picture of an overhead camera. ``data`` is a JPEG, or ``width * height`` grey bytes, row by row."""

    width: Annotated[int, Meta(gt=0, le=16384)]
    height: Annotated[int, Meta(gt=0, le=16384)]
    format: Literal["jpeg", "grey"]
    data: bytes


class PoseFix(Message, frozen=True, kw_only=True):
    """Where a camera saw a robot. ``stamp`` is the time of capture."""

    x: float
    y: float
    theta: float
    covariance: Covariance
    camera: str

    @property
    def pose(self) -> geometry.Pose2:
        """The place and heading."""
        return geometry.Pose2(self.x, self.y, self.theta)


class Estimate(Message, frozen=True, kw_only=True):
    """What the pose filter believes of the moment ``stamp``. ``v`` and ``omega`` are the speeds really driven."""

    x: float
    y: float
    theta: float
    v: float
    omega: float
    covariance: Covariance

    @property
    def pose(self) -> geometry.Pose2:
        """The place and heading."""
        return geometry.Pose2(self.x, self.y, self.theta)


class Calibration(Message, frozen=True, kw_only=True):
    """A drive calibration (``cal0`` multiplies omega, ``calD`` multiplies v) and its standard deviation."""

    value: float
    sigma: float


RobotStatus = Literal["tracking", "disagrees", "stale", "lost"]
"""``tracking``: seen now. ``disagrees``: the agent's estimate is not where the cameras see the robot. ``stale``: not
seen for a moment. ``lost``: not seen for long; it stays an obstacle where it was."""


class RobotState(Struct, frozen=True, forbid_unknown_fields=True):
    """One robot in the snapshot. ``age`` [s] is that of the fix behind ``x``, ``y``, ``theta``."""

    name: Name
    x: float
    y: float
    theta: float
    v: float
    omega: float
    age: float
    state: RobotStatus

    def __post_init__(self) -> None:
        if not math.isfinite(self.x + self.y + self.theta + self.v + self.omega + self.age):
            raise ValueError(f"robot {self.name}: every number must be finite")

    @property
    def pose(self) -> geometry.Pose2:
        """The place and heading."""
        return geometry.Pose2(self.x, self.y, self.theta)


class FleetSnapshot(Message, frozen=True, kw_only=True):
    """All positions, as the cameras see them."""

    robots: tuple[RobotState, ...]


class SpeedReference(Message, frozen=True, kw_only=True):
    """How fast a robot shall go along its path [m/s]."""

    speed: float


class VelocityCommand(Message, frozen=True, kw_only=True):
    """What the wheels shall do: ``v`` [m/s] forwards, ``omega`` [rad/s] counter-clockwise, after calibration."""

    v: float
    omega: float


class Goal(Message, frozen=True, kw_only=True):
    """Where a robot shall go; ``theta`` may be nil when the heading does not matter."""

    x: float
    y: float
    theta: float | None = None


class Path(Message, frozen=True, kw_only=True):
    """A planned path: a start, and arcs and straights one after the other.

    Attributes:
        x: where it begins [m, world].
        y: where it begins [m, world].
        theta: in which direction [rad].
        segments: rows ``(length [m], curvature [1/m])``, the curvature positive to the left, 0 straight on.
        goal_theta: whether the goal asked for the heading at the end; else the heuristic chose it.
    """

    x: float
    y: float
    theta: float
    segments: tuple[tuple[float, float], ...]
    goal_theta: bool = False


class Cell(Message, frozen=True, kw_only=True):
    """A robot's Voronoi cell within the arena, and the (density-weighted) centroid that it makes for.

    Attributes:
        corners: ``(x, y)`` counter-clockwise [m, world]; none for an empty cell.
        x: of the centroid [m, world].
        y: of the centroid [m, world].
    """

    corners: tuple[tuple[float, float], ...]
    x: float
    y: float


class Odometry(Message, frozen=True, kw_only=True):
    """What the wheels' encoders say: a pose in a frame of their own, and the twist."""

    x: float
    y: float
    theta: float
    v: float
    omega: float


class Truth(Message, frozen=True, kw_only=True):
    """Where a simulated robot really is. For score sheets only; no task may read it."""

    x: float
    y: float
    theta: float
    v: float
    omega: float


class Circle(Message, frozen=True, kw_only=True):
    """The circle to follow."""

    x: float
    y: float
    radius: Annotated[float, Meta(gt=0)]
    clockwise: bool = False
    revision: Annotated[int, Meta(ge=0)] = 0

    @property
    def circle(self) -> geometry.Circle:
        """As the laws take it."""
        return geometry.Circle(self.x, self.y, self.radius, self.clockwise)


class Behaviour(Message, frozen=True, kw_only=True):
    """Which behaviour a robot runs: a built-in name or ``module:function``, and its parameters."""

    behaviour: str
    parameters: dict[str, Value] = {}
    revision: Annotated[int, Meta(ge=0)] = 0


class StopOrder(Message, frozen=True, kw_only=True):
    """The whole state of stop, never a difference: everybody (``all``), or those in ``names``."""

    all: bool
    names: tuple[Name, ...] = ()
    revision: Annotated[int, Meta(ge=0)] = 0


class BaseState(Message, frozen=True, kw_only=True):
    """How a base is. ``battery`` in [0, 1]. ``dead_man``: no fresh command, wheels at zero."""

    battery: float
    charging: bool
    bumper: bool
    cliff: bool
    wheel_drop: bool
    dead_man: bool


class Health(Message, frozen=True, kw_only=True):
    """How a process is, and why it does what it does.

    Attributes:
        role: ``agent``, ``base``, ``basestation``, ``simulator`` ...
        state: one word, such as ``driving``, ``holding``, ``stopped``, ``waiting``.
        reasons: why it is not driving, most important first.
        numbers: counters and gauges by name (``pose_received``, ``pose_rejected``, ``command_rate_hz`` ...).
        samples: measurements since the last health by name (``pose_age_s``, ``pose_to_command_s``).
        stop_latched: a stop is latched here.
        stop_all: ... and it was an order to everybody.
        stop_revision: the newest revision of the stop order that was heard here.
    """

    role: str
    state: str
    reasons: tuple[str, ...] = ()
    numbers: dict[str, float] = {}
    samples: dict[str, tuple[float, ...]] = {}
    stop_latched: bool = False
    stop_all: bool = False
    stop_revision: int = 0


class Ack(Message, frozen=True, kw_only=True):
    """What became of an order, which is named by its ``channel``, ``order_epoch`` and ``order_seq``."""

    channel: str
    order_epoch: int
    order_seq: int
    accepted: bool
    reason: str = ""


class SetCircle(Message, frozen=True, kw_only=True):
    """An order to the base station: change the circle. What is nil stays as it is."""

    x: float | None = None
    y: float | None = None
    radius: Annotated[float, Meta(gt=0)] | None = None
    clockwise: bool | None = None


class SetBehaviour(Message, frozen=True, kw_only=True):
    """An order to the base station: change the behaviour of ``names`` (none: of every robot)."""

    behaviour: str
    parameters: dict[str, Value] = {}
    names: tuple[Name, ...] = ()


class Stop(Message, frozen=True, kw_only=True):
    """An order to the base station: stop ``names`` (none: everybody)."""

    names: tuple[Name, ...] = ()


class Resume(Message, frozen=True, kw_only=True):
    """An order to the base station: lift the stop of ``names`` (none: everybody's) up to ``revision``."""

    revision: Annotated[int, Meta(ge=0)]
    names: tuple[Name, ...] = ()


class Clear(Message, frozen=True, kw_only=True):
    """An order to the base station: the robot was carried away, forget where it was last seen."""

    name: Name


class Reply(Message, frozen=True, kw_only=True):
    """The base station's answer to an order."""

    accepted: bool
    reason: str = ""
    revision: int = 0


M = TypeVar("M", bound=Message)


encode: Final[Callable[[Message], bytes]] = msgspec.msgpack.Encoder().encode
"""The message as a MessagePack map."""


def decode(data: bytes, kind: type[M]) -> M:
    """A message from its bytes.

    Args:
        data: the bytes.
        kind: what they should be.

    Raises:
        MessageError: the bytes are not such a message: not MessagePack, a wrong type, an unknown or missing field,
            a number that is not finite, no stamp.
    """
    message: M = decoder(kind)(data)
    return message


@cache
def decoder(kind: type[M]) -> Callable[[bytes], M]:
    """:func:`decode` for one kind, for who decodes many.

    Args:
        kind: what the bytes should be.
    """
    raw = msgspec.msgpack.Decoder(kind).decode

    def decode_it(data: bytes) -> M:
        try:
            message: M = raw(data)
        except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError) as error:
            raise MessageError(f"{kind.__name__}: {error}") from error
        if not message.stamp > 0.0:
            raise MessageError(f"{kind.__name__}: got stamp {message.stamp!r}, expected seconds since 1970")
        return message

    return decode_it


def encoding_of(kind: type[Message]) -> str:
    """The Zenoh encoding of a message type, such as ``application/msgpack;PoseFix.1``."""
    return f"application/msgpack;{kind.__name__}.{VERSION}"


def check_encoding(encoding: str | None, kind: type[Message]) -> None:
    """Refuse bytes that say they are something else. A writer that says nothing is taken at version 1.

    Raises:
        MessageError: another type, another version, or no MessagePack at all.
    """
    if encoding is None or encoding in _UNSAID or encoding == encoding_of(kind):
        return
    raise MessageError(f"{kind.__name__}: got encoding {encoding!r}, expected {encoding_of(kind)!r}")


_UNSAID = frozenset({"", "zenoh/bytes", "application/octet-stream", "application/msgpack"})


@cache
def _number_fields(
    kind: type[Message],
) -> tuple[Callable[[Message], tuple[float, ...]], tuple[str, ...], tuple[str, ...]]:
    """A getter of the plain floats, the fields that are tuples of floats, and the others that may hold floats."""
    types = {field.name: field.type for field in msgspec.structs.fields(kind)}
    scalars = [name for name, annotation in types.items() if _bare(annotation) is float]
    vectors = tuple(name for name, annotation in types.items() if _bare(annotation) == tuple[float, ...])
    others = tuple(
        name
        for name, annotation in types.items()
        if name not in scalars and name not in vectors and _holds_float(annotation)
    )
    # Every message has a stamp. Twice, for an attrgetter of one name gives no tuple.
    return attrgetter(*scalars, "stamp"), vectors, others


def _bare(annotation: Any) -> Any:
    return get_args(annotation)[0] if get_origin(annotation) is Annotated else annotation


def _holds_float(annotation: Any) -> bool:
    return annotation is float or any(_holds_float(part) for part in get_args(annotation))


def _require_finite(field: str, value: Any) -> None:
    if isinstance(value, float):
        if not math.isfinite(value):
            raise ValueError(f"{field}: got {value}, expected a finite number")
    elif isinstance(value, tuple):
        for item in value:
            _require_finite(field, item)
    elif isinstance(value, dict):
        for key, item in value.items():
            _require_finite(f"{field}.{key}", item)
