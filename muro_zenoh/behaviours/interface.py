"""The interface of a behaviour: observations in, intent out. No bus, no clock, and no state but its own.

A behaviour is one file of this package and has the file's name. The file holds the parameters, the behaviour itself,
and one row that all users of the table read: agent, rollout, base station, command line, score sheet::

    BEHAVIOUR = BehaviourKind(Parameters, make, "what it does, in a line", needs=frozenset({Need.CIRCLE}))
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

from muro_zenoh.geometry import Bounds, Circle, State, Twist2
from muro_zenoh.planning.destination import Destination
from muro_zenoh.planning.path import Path
from muro_zenoh.safety.separation.body import RobotSeen
from muro_zenoh.walls import Wall

if TYPE_CHECKING:  # these need numpy, which most agents do not load
    from muro_zenoh.control.importance import Importance
    from muro_zenoh.planning.density import Density


class Vehicle(NamedTuple):
    """The robot that runs a behaviour.

    ``name``; ``radius`` of its body [m]; ``v_max`` [m/s] and ``omega_max`` [rad/s], its limits; ``lag``: time constant
    of its wheels [s]; ``arena``: the floor that it may use; ``margin`` and ``wall_margin``: free floor that the
    separation filter keeps between two bodies, and between a body and a wall [m]; ``walls``: those inside the arena.
    """

    name: str
    radius: float
    v_max: float
    omega_max: float
    lag: float
    arena: Bounds
    margin: float = 0.0
    wall_margin: float = 0.0
    walls: tuple[Wall, ...] = ()

    @property
    def wall_distance(self) -> float:
        """The distance that its centre keeps from a wall [m]."""
        return self.radius + self.wall_margin


class Neighbour(NamedTuple):
    """A robot as the cameras last saw it: ``name``; ``x``, ``y`` [m, world], ``theta`` [rad], ``v`` [m/s],
    ``omega`` [rad/s]; ``age`` of the fix behind it, up to now [s]; ``state``: ``tracking``, ``silent``, ``disagrees``,
    ``stale`` or ``lost``."""

    name: str
    x: float
    y: float
    theta: float
    v: float
    omega: float
    age: float
    state: str = "tracking"


def is_visible(robot: RobotSeen) -> bool:
    """Whether the cameras see a robot now; a stale or lost robot is an obstacle at its last position.

    Args:
        robot: a robot of a snapshot.
    """
    return robot.state in ("tracking", "silent", "disagrees")


class Snapshot(NamedTuple):
    """All robots at one moment; every agent receives the same snapshot.

    ``robots``: every robot seen so far. ``stamp`` [s, the base station's clock] and ``epoch`` of the base station's
    process: the same for all receivers. ``age``: time since it was sent [s].
    """

    robots: Sequence[RobotSeen]
    stamp: float
    epoch: int
    age: float


class Seen(NamedTuple):
    """What a behaviour sees at one estimate. In the rollout the numbers may be arrays, one entry per robot.

    Attributes:
        now: the time [s, one local clock].
        state: the robot's state now.
        ahead: the predicted state when a command given now takes effect at the wheels; laws are evaluated there.
        circle: the circle to follow; None before one was received.
        speed: the speed received on ``muro/velocity/<name>`` [m/s]; None when there is none or it is stale.
        speed_age: the age of the newest speed, stale or not; infinite before the first [s].
        snapshot: all robots; None when there is none or it is stale.
        snapshot_age: the age of the newest snapshot, stale or not; infinite before the first [s].
        wish: the twist that a hand at a stick wants, from ``muro/drive/<name>``; None when there is none or it is
            stale.
        wish_age: the age of the newest wish, stale or not; infinite before the first [s].
        stopped: the robots that the newest stop order names.
        may_drive: whether the robot was allowed to drive at its last command.
    """

    now: float
    state: State
    ahead: State
    circle: Circle | None = None
    speed: Any = None
    speed_age: float = float("inf")
    snapshot: Snapshot | None = None
    snapshot_age: float = float("inf")
    wish: Twist2 | None = None
    wish_age: float = float("inf")
    stopped: frozenset[str] = frozenset()
    may_drive: bool = True


class ShownCell(NamedTuple):
    """A Voronoi cell for display: ``corners``, counter-clockwise [m, world], and its centroid ``x``, ``y`` [m]."""

    corners: tuple[tuple[float, float], ...]
    x: float
    y: float


class Intent(NamedTuple):
    """What a behaviour wants.

    Attributes:
        twist: the desired twist, before calibration and limits; None to hold.
        reason: why the robot holds.
        speed: speed to publish on ``muro/velocity/<name>`` [m/s].
        path: a path planned in this step, for display.
        path_has_heading: whether the goal of that path specified the heading at its end.
        cell: a cell for display.
        target: the position that the robot is driving to, x, y [m, world]; None when there is none. A robot that has
            to get out of another's way takes a way round to it.
    """

    twist: Twist2 | None
    reason: str = ""
    speed: Any = None
    path: Path | None = None
    path_has_heading: bool = False
    cell: ShownCell | None = None
    target: tuple[float, float] | None = None


def hold(reason: str) -> Intent:
    """The intent to stand still.

    Args:
        reason: shown to operators.
    """
    return Intent(None, reason)


class Behaviour(ABC):
    """One run of a behaviour on one robot. It keeps its own state; values go in, values come out."""

    @abstractmethod
    def step(self, seen: Seen) -> Intent:
        """The intent now; called at each estimate.

        Args:
            seen: the current observations.
        """

    def go_to(self, goal: Destination, seen: Seen) -> str:
        """Take a goal from an operator. It replaces the current goal and all that follow it.

        Args:
            goal: where to go.
            seen: the current observations.

        Returns:
            Why the goal is refused; empty when it is accepted. A refused goal changes nothing.
        """
        return f"the behaviour {type(self).__module__.rpartition('.')[2]} takes no goals"


class Need(Enum):
    """An input that a behaviour needs besides the robot's own state."""

    CIRCLE = "circle"
    SPEED = "velocity"
    SNAPSHOT = "all_positions"
    GOALS = "goal"
    HAND = "drive"


class Deployment(NamedTuple):
    """The task of robots that cover a floor.

    Attributes:
        floor: the floor to cover.
        density: the density over the floor; None for uniform.
        hold_time: how long all robots are stationary before a round ends [s].
    """

    floor: Bounds
    density: Density | None
    hold_time: float


class Expectation(NamedTuple):
    """What robots with this behaviour should achieve; it decides what their score sheet shows.

    Attributes:
        follows_circle: whether they follow the circle.
        spreads: whether they spread evenly on it.
        importance: where on the circle they stay longer; None for no weighting.
        goals: goals to visit in order, by robot; those of the scenario, for a behaviour that needs goals.
        v_min: speed on the arcs of planned paths [m/s]; None when they plan none.
        deployment: the floor that they cover; None when they cover none.
    """

    follows_circle: bool = False
    spreads: bool = False
    importance: Importance | None = None
    goals: Mapping[str, Sequence[Sequence[float]]] = MappingProxyType({})
    v_min: float | None = None
    deployment: Deployment | None = None


def _nothing_expected(parameters: Any, vehicle: Vehicle) -> Expectation:
    return Expectation()


def _always_fits(parameters: Any, circle: Circle, fleet: Sequence[Vehicle]) -> None:
    return None


@dataclass(frozen=True, slots=True)
class BehaviourKind:
    """A behaviour's row in the table: everything that other modules know about it.

    Args:
        parameters: a frozen dataclass; nested dataclasses are those of the laws, and in a settings file their keys are
            on the same level as its own.
        make: makes the behaviour of one robot from its parameters; raises a
            :class:`~muro_zenoh.errors.ParameterError` for parameters that are inconsistent or do not fit the robot.
        summary: what it does, in one line.
        needs: its inputs.
        expects: what its score sheet shows, from its parameters and a robot that runs it; the goals are filled in.
        fits: raises a :class:`~muro_zenoh.errors.ParameterError` when a whole fleet cannot do it on this circle.
    """

    parameters: Any
    make: Callable[[Any, Vehicle], Behaviour]
    summary: str
    needs: frozenset[Need] = frozenset()
    expects: Callable[[Any, Vehicle], Expectation] = _nothing_expected
    fits: Callable[[Any, Circle, Sequence[Vehicle]], None] = _always_fits
