"""What a behaviour is: what it sees goes in, what it wants comes out. No bus, no clock, no memory but its own.

A behaviour is one file of this package, and the file's name is the behaviour's. It holds the parameters, the behaviour
itself, and one row for everybody who has to know of it: agent, rollout, base station, command line, score sheet::

    BEHAVIOUR = BehaviourKind(Parameters, make, "what it does, in a line", needs=frozenset({Need.CIRCLE}))
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from muro_zenoh.geometry import Bounds, Circle, State, Twist2
from muro_zenoh.planning.destination import Destination
from muro_zenoh.planning.path import Path

if TYPE_CHECKING:  # these need numpy, which most agents do without
    from muro_zenoh.control.importance import Importance
    from muro_zenoh.planning.density import Density


class Vehicle(NamedTuple):
    """The robot that a behaviour is for.

    ``name``; ``radius`` of its body [m]; ``v_max`` [m/s] and ``omega_max`` [rad/s], its limits; ``lag``: time constant
    of its wheels [s]; ``arena``: the floor that it may use.
    """

    name: str
    radius: float
    v_max: float
    omega_max: float
    lag: float
    arena: Bounds


class RobotSeen(Protocol):
    """One robot of a snapshot: place, heading and speeds as the cameras and its agent have them [m, rad, s; world],
    ``age`` of the fix behind them when the snapshot was sent [s], and ``state``."""

    @property
    def name(self) -> str: ...
    @property
    def x(self) -> float: ...
    @property
    def y(self) -> float: ...
    @property
    def theta(self) -> float: ...
    @property
    def v(self) -> float: ...
    @property
    def omega(self) -> float: ...
    @property
    def age(self) -> float: ...
    @property
    def state(self) -> str: ...


def is_visible(robot: RobotSeen) -> bool:
    """Whether the cameras see a robot now; one that is stale or lost is an obstacle where it was.

    Args:
        robot: of a snapshot.
    """
    return robot.state in ("tracking", "disagrees")


class Snapshot(NamedTuple):
    """All robots as everybody was told at the same moment.

    ``robots``: every robot ever seen. ``stamp`` [s, the base station's clock] and ``epoch`` of its process: what all
    robots read alike. ``age``: how long ago it was sent [s].
    """

    robots: Sequence[RobotSeen]
    stamp: float
    epoch: int
    age: float


class Seen(NamedTuple):
    """What a behaviour sees at one estimate. In the rollout the numbers may be arrays, an entry per robot.

    Attributes:
        now: the time [s, one local clock].
        state: where the robot is.
        ahead: where it will be, and how fast, when a command given now is felt at the wheels; laws are evaluated there.
        circle: to follow; None before it was heard.
        speed: what is said on ``muro/velocity/<name>`` [m/s]; None when nothing fresh is.
        speed_age: of that; infinite when nobody ever said one [s].
        snapshot: all robots; None when nothing fresh is known.
        snapshot_age: of the newest, fresh or not; infinite before the first [s].
        stopped: the robots that the newest stop order names.
        may_drive: nothing kept the robot from driving at its last command.
    """

    now: float
    state: State
    ahead: State
    circle: Circle | None = None
    speed: Any = None
    speed_age: float = float("inf")
    snapshot: Snapshot | None = None
    snapshot_age: float = float("inf")
    stopped: frozenset[str] = frozenset()
    may_drive: bool = True


class ShownCell(NamedTuple):
    """A Voronoi cell to be shown: ``corners``, counter-clockwise [m, world], and its centroid ``x``, ``y`` [m]."""

    corners: tuple[tuple[float, float], ...]
    x: float
    y: float


class Intent(NamedTuple):
    """What a behaviour wants.

    Attributes:
        twist: what to drive, before calibration and limits; None to stand still.
        reason: why it stands.
        speed: to be said on ``muro/velocity/<name>`` [m/s].
        path: planned just now, to be shown ...
        path_has_heading: ... and whether its goal asked for the heading at its end.
        cell: to be shown.
    """

    twist: Twist2 | None
    reason: str = ""
    speed: Any = None
    path: Path | None = None
    path_has_heading: bool = False
    cell: ShownCell | None = None


def hold(reason: str) -> Intent:
    """Stand still.

    Args:
        reason: why; operators read it.
    """
    return Intent(None, reason)


class Behaviour(ABC):
    """A behaviour of one robot, from its start to its end. Its memory is its own; values go in and come out."""

    @abstractmethod
    def step(self, seen: Seen) -> Intent:
        """What it wants now; called at each estimate.

        Args:
            seen: what there is to see.
        """

    def go_to(self, goal: Destination, seen: Seen) -> str:
        """Take a goal from an operator, in place of the one being gone to and of those that would have come next.

        Args:
            goal: where to go.
            seen: what there is to see.

        Returns:
            Why not; empty when the goal is taken. A goal that is refused changes nothing.
        """
        return f"the behaviour {type(self).__module__.rpartition('.')[2]} takes no goals"


class Need(Enum):
    """What a behaviour needs to be given, besides the robot's own state."""

    CIRCLE = "circle"
    SPEED = "velocity"
    SNAPSHOT = "all_positions"
    GOALS = "goal"


class Deployment(NamedTuple):
    """What robots that cover a floor are asked for: ``density``, how much each place matters (None for all alike), and
    ``hold_time``, so long all have stood when a round ends [s]."""

    density: Density | None
    hold_time: float


class Expectation(NamedTuple):
    """What robots with this behaviour should achieve, so what their score sheet shows.

    Attributes:
        on_circle: they follow the circle ...
        evenly: ... spread evenly round it ...
        importance: ... or stay longer where this is greater.
        goals: they go to the scenario's goals.
        v_min: they plan paths, on whose arcs they drive so fast [m/s].
        deployment: they cover the floor.
    """

    on_circle: bool = False
    evenly: bool = False
    importance: Importance | None = None
    goals: bool = False
    v_min: float | None = None
    deployment: Deployment | None = None


def _nothing_expected(parameters: Any) -> Expectation:
    return Expectation()


def _always_fits(parameters: Any, circle: Circle, fleet: Sequence[Vehicle]) -> None:
    return None


@dataclass(frozen=True, slots=True)
class BehaviourKind:
    """The row of a behaviour: all that others have to know of it.

    Args:
        parameters: a frozen dataclass; those nested in it are the laws' own, and their keys stand beside its own in a
            settings file.
        make: the behaviour of one robot, from its parameters; raises a
            :class:`~muro_zenoh.errors.ParameterError` for parameters that do not fit together or do not fit the robot.
        summary: what it does, in a line.
        needs: what it must be given.
        expects: what its score sheet shows, from its parameters.
        fits: raises a :class:`~muro_zenoh.errors.ParameterError` when a whole fleet cannot do it on this circle.
    """

    parameters: Any
    make: Callable[[Any, Vehicle], Behaviour]
    summary: str
    needs: frozenset[Need] = frozenset()
    expects: Callable[[Any], Expectation] = _nothing_expected
    fits: Callable[[Any, Circle, Sequence[Vehicle]], None] = _always_fits


Parameters = Mapping[str, Any]
"""A behaviour's parameters as settings files and orders have them: values by key."""
