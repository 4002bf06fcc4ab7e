"""The faults of a scenario, one ``[[fault]]`` each: what breaks, where, and when. docs/faults.md has examples.

``muro check`` applies every kind to a fleet in memory; ``muro run`` applies to real processes what can be done to them.
Adding a kind: a class here with its numbers, in :data:`KINDS`, and what it does, in a table of
:mod:`muro_zenoh.checking.faults`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import StrEnum
from typing import Annotated, ClassVar, Final, Literal

from muro_zenoh.config.schema import Section
from muro_zenoh.errors import ParameterError
from muro_zenoh.quantities import Angle, Coordinate, Duration, Period, Quantity

Delay = Annotated[float, Quantity("s", above=0.0, at_most=10.0)]
Fraction = Annotated[float, Quantity(above=0.0, at_most=1.0)]
Shift = Annotated[float, Quantity("s", at_least=-3600.0, at_most=3600.0)]
Drift = Annotated[float, Quantity("s/s", at_least=-0.01, at_most=0.01)]
SpeedError = Annotated[float, Quantity("m/s", at_least=-5.0, at_most=5.0)]
TurningError = Annotated[float, Quantity("rad/s", at_least=-20.0, at_most=20.0)]


class Place(StrEnum):
    """What a fault can befall; the values are how its ``target`` is written, with a robot's or camera's name."""

    ROBOT = "r1"
    AGENT = "r1/agent"
    BASE = "r1/base"
    BASESTATION = "basestation"
    CAMERAS = "camera"
    CAMERA = "camera/north"
    ROUTER = "router"


_PROCESSES: Final = (Place.AGENT, Place.BASE, Place.BASESTATION, Place.CAMERAS, Place.CAMERA, Place.ROUTER)
_COMPUTERS: Final = (Place.ROBOT, Place.AGENT, Place.BASE, Place.BASESTATION)
_LINKS: Final = (Place.ROBOT, *_PROCESSES)
_VIEWS: Final = (Place.ROBOT, Place.CAMERAS, Place.CAMERA)


class Fault(Section, frozen=True, kw_only=True, tag_field="kind"):
    """What every fault has. Without ``until`` and ``duration`` it lasts to the end of the run.

    Attributes:
        target: what it befalls: a robot such as ``r1``, its ``r1/agent`` or ``r1/base``, ``basestation``, ``camera``
            (all of them), ``camera/north`` or ``router``; :attr:`places` has those that make sense.
        at: when it begins, counted from the start of the run [s].
        until: when it ends [s].
        duration: how long it lasts [s], in place of ``until``.

    Raises:
        ParameterError: a number outside its limits, both ends, or an end that is not after the beginning.
    """

    target: str
    at: Duration = 0.0
    until: Period | None = None
    duration: Period | None = None

    places: ClassVar[tuple[Place, ...]] = ()
    """What it can befall."""

    def __post_init__(self) -> None:
        Section.__post_init__(self)
        if self.until is not None and self.duration is not None:
            raise ParameterError("duration", got="until as well", expected="only one of the two")
        if self.until is not None and not self.until > self.at:
            raise ParameterError("until", got=f"{self.until:g}", expected=f"a time after at = {self.at:g} [s]")

    @property
    def kind(self) -> str:
        """Its kind, as in the file."""
        return str(self.__struct_config__.tag)

    @property
    def end(self) -> float:
        """When it ends [s]; infinite without an end."""
        if self.until is not None:
            return self.until
        return self.at + self.duration if self.duration is not None else math.inf

    @property
    def place(self) -> Place:
        """What it befalls, by the form of its target."""
        head, slash, tail = self.target.partition("/")
        if head == "camera":
            return Place.CAMERA if slash else Place.CAMERAS
        if slash:
            return Place.BASE if tail == "base" else Place.AGENT
        return Place(head) if head in ("basestation", "router") else Place.ROBOT

    @property
    def robot(self) -> str:
        """The robot that it befalls, or whose process; empty for all others."""
        return self.target.partition("/")[0] if self.place in (Place.ROBOT, Place.AGENT, Place.BASE) else ""


# ---- of a link: what passes between the target and the router


class LinkFault(Fault, frozen=True, kw_only=True):
    """A fault of the link between a process and the router. That of a robot is of its computer: agent and base reach
    each other past it. That of the ``router`` is of every link.

    Attributes:
        direction: of the messages that it affects, as the target sees them.
    """

    direction: Literal["both", "in", "out"] = "both"

    places = _LINKS


class DelayFault(LinkFault, frozen=True, kw_only=True, tag="delay"):
    """Every message takes longer.

    Attributes:
        delay: by so much [s].
    """

    delay: Delay


class JitterFault(LinkFault, frozen=True, kw_only=True, tag="jitter"):
    """Every message takes longer by a random time; none overtakes another, as within a TCP connection.

    Attributes:
        jitter: the longest of these times, which are uniform [s].
    """

    jitter: Delay


class LossFault(LinkFault, frozen=True, kw_only=True, tag="loss"):
    """Messages are lost.

    Attributes:
        fraction: which part of them.
    """

    fraction: Fraction


class DuplicateFault(LinkFault, frozen=True, kw_only=True, tag="duplicate"):
    """Messages arrive twice.

    Attributes:
        fraction: which part of them.
        delay: how much later the second copy arrives [s].
    """

    fraction: Fraction
    delay: Delay = 0.05


class ReorderFault(LinkFault, frozen=True, kw_only=True, tag="reorder"):
    """Messages are held back, and overtaken by later ones.

    Attributes:
        fraction: which part of them.
        delay: for how long [s].
    """

    fraction: Fraction
    delay: Delay = 0.1


class PartitionFault(LinkFault, frozen=True, kw_only=True, tag="partition"):
    """Nothing passes, and what is under way is lost."""


class StallFault(LinkFault, frozen=True, kw_only=True, tag="stall"):
    """Nothing passes; what was sent arrives at the end, all at once."""


# ---- of a process


class ProcessFault(Fault, frozen=True, kw_only=True):
    """A fault of a process."""

    places = _PROCESSES


class CrashFault(ProcessFault, frozen=True, kw_only=True, tag="crash"):
    """The process is killed: it sends nothing any more, no zero either. It is started anew at the end."""


class RestartFault(ProcessFault, frozen=True, kw_only=True, tag="restart"):
    """The process is asked to end, does, and is started anew: at the end, or at once without one."""


class FreezeFault(ProcessFault, frozen=True, kw_only=True, tag="freeze"):
    """The process does not run, as after SIGSTOP, while messages for it pile up; at the end it wakes."""


class CameraDropoutFault(Fault, frozen=True, kw_only=True, tag="camera_dropout"):
    """The camera gives no pictures; with a robot as target, no camera sees that robot."""

    places = _VIEWS


class ClockOffsetFault(Fault, frozen=True, kw_only=True, tag="clock_offset"):
    """The clock is wrong.

    Attributes:
        offset: what it shows too much [s].
        drift: what it gains in each second besides [s/s].
    """

    offset: Shift = 0.0
    drift: Drift = 0.0

    places = _COMPUTERS


class ClockStepFault(Fault, frozen=True, kw_only=True, tag="clock_step"):
    """The clock is set, and stays so.

    Attributes:
        step: forwards by so much [s].
    """

    step: Shift

    places = _COMPUTERS


# ---- of a robot


class RobotFault(Fault, frozen=True, kw_only=True):
    """A fault of a robot's body, or of its honesty."""

    places = (Place.ROBOT,)


class HaltFault(RobotFault, frozen=True, kw_only=True, tag="halt"):
    """The wheels jam: whatever they are commanded, they stand still."""


class CarryFault(RobotFault, frozen=True, kw_only=True, tag="carry"):
    """Somebody carries the robot away, evenly from ``at`` to the end; the wheels notice nothing.

    Attributes:
        x: how far to the right [m, world]; not where to.
        y: how far upwards [m, world]; not where to.
        theta: by which angle it is turned [rad].
    """

    x: Coordinate = 0.0
    y: Coordinate = 0.0
    theta: Angle = 0.0

    def __post_init__(self) -> None:
        Fault.__post_init__(self)
        if math.isinf(self.end):
            raise ParameterError("duration", got="nothing", expected="how long it is carried [s], or until")


class LieFault(RobotFault, frozen=True, kw_only=True, tag="lie"):
    """The estimate that the robot publishes is wrong; the one that it drives by is right.

    Attributes:
        x: what is added to x [m, world].
        y: what is added to y [m, world].
        theta: what is added to the heading [rad].
        v: what is added to the speed [m/s].
        omega: what is added to the turning rate [rad/s].
        stuck: it repeats the last right one instead, with new stamps.
    """

    x: Coordinate = 0.0
    y: Coordinate = 0.0
    theta: Angle = 0.0
    v: SpeedError = 0.0
    omega: TurningError = 0.0
    stuck: bool = False


class ForeignDriverFault(RobotFault, frozen=True, kw_only=True, tag="foreign_driver"):
    """Somebody else drives the robot.

    Attributes:
        v: at this speed [m/s].
        omega: turning at this rate [rad/s].
        by: ``bus``: a program that publishes commands as the agent does; ``wheels``: past our base, with a joystick.
    """

    v: SpeedError = 0.2
    omega: TurningError = 0.0
    by: Literal["bus", "wheels"] = "bus"


KINDS: Final[Mapping[str, type[Fault]]] = {
    str(kind.__struct_config__.tag): kind
    for kind in (
        DelayFault,
        JitterFault,
        LossFault,
        DuplicateFault,
        ReorderFault,
        PartitionFault,
        StallFault,
        CrashFault,
        RestartFault,
        FreezeFault,
        CameraDropoutFault,
        ClockOffsetFault,
        ClockStepFault,
        HaltFault,
        CarryFault,
        LieFault,
        ForeignDriverFault,
    )
}
"""The kinds by name."""

OF_THE_ROOM: Final = ("carry", "camera_dropout")
"""The kinds that a simulator applies to the room that it stands in for."""

RUN_KINDS: Final = ("crash", "restart", "freeze", "delay", "jitter", "stall", "partition", *OF_THE_ROOM)
"""The kinds that `muro run` applies."""
