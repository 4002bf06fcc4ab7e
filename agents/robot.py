"""The robot as a user's own behaviour sees it.

A plain function is called at each estimate and returns the twist; an ``async`` one runs until another is ordered::

    def flock(robot):
        ...
        return v, omega

    async def patrol(robot):
        async for estimate in robot.estimates():
            robot.drive(v, omega)
"""

from __future__ import annotations

import math
import reprlib
from collections.abc import AsyncIterator, Callable, Mapping
from typing import Any, NamedTuple, TypeVar

from muro_zenoh import config
from muro_zenoh.behaviours.circle import CircleFollowing
from muro_zenoh.behaviours.interface import Behaviour, Intent, Neighbour, Seen, Vehicle, hold
from muro_zenoh.control.circle import CircleLaw
from muro_zenoh.errors import ParameterError, PlanningError
from muro_zenoh.geometry import Bounds, Circle, State, Twist2
from muro_zenoh.messages import Estimate
from muro_zenoh.planning.destination import Destination
from muro_zenoh.transport import Latest
from muro_zenoh.walls import Wall

P = TypeVar("P")


class Connection(NamedTuple):
    """The connection of a :class:`Robot` to its agent.

    ``seen``: the observations at the newest estimate; ``want``: takes an intent; ``behave``: installs a behaviour that
    is stepped at each estimate; ``estimates``: a new mailbox with the robot's own estimates; ``now``: the clock
    [s since 1970].
    """

    seen: Callable[[], Seen | None]
    want: Callable[[Intent], None]
    behave: Callable[[Behaviour | None], None]
    estimates: Callable[[], Latest[Estimate]]
    now: Callable[[], float]


class Robot:
    """One robot, for one run of a behaviour.

    Args:
        vehicle: its name, limits and arena.
        settings: its section of the fleet file.
        parameters: the behaviour's, by key.
        connection: to its agent.

    Attributes:
        name: its name.
        settings: its section of the fleet file.
        arena: the floor [m, world].
        walls: the walls on it.
        parameters: the behaviour's parameters, by key.
    """

    def __init__(
        self, vehicle: Vehicle, settings: config.RobotSettings, parameters: Mapping[str, Any], connection: Connection
    ) -> None:
        self.name = vehicle.name
        self.settings = settings
        self.arena: Bounds = vehicle.arena
        self.walls: tuple[Wall, ...] = vehicle.walls
        self.parameters = parameters
        self._vehicle = vehicle
        self._connection = connection
        self._revoked = False
        self._ride: Behaviour | None = None
        self._circle = CircleFollowing(CircleLaw(), 0.0)

    def revoke(self) -> None:
        """End the run: later calls have no effect."""
        self._revoked = True

    @property
    def revoked(self) -> bool:
        """Whether the run is over."""
        return self._revoked

    def parameters_as(self, kind: type[P]) -> P:
        """The behaviour's parameters, checked.

        Args:
            kind: a frozen dataclass of the behaviour's own, or a :class:`~muro_zenoh.config.Section`.

        Raises:
            ConfigError: a wrong key, type or range.
        """
        return config.parameters_as(kind, self.parameters, f"behaviour of {self.name}")

    # ---- observations

    async def estimates(self) -> AsyncIterator[Estimate]:
        """This robot's estimates as they are made; a slow reader receives only the newest."""
        inbox = self._connection.estimates()
        try:
            async for received in inbox:
                yield received.message
        finally:
            inbox.close()

    @property
    def state(self) -> State | None:
        """This robot's pose and speeds now; None before the first fix."""
        seen = self._connection.seen()
        return seen.state if seen is not None else None

    @property
    def ahead(self) -> State | None:
        """This robot's predicted pose and speeds when a command given now takes effect at its wheels; None before the
        first fix."""
        seen = self._connection.seen()
        return seen.ahead if seen is not None else None

    @property
    def neighbours(self) -> tuple[Neighbour, ...]:
        """All other robots as the cameras last saw them, with ages up to now; empty while no fresh snapshot is known.

        A robot that is no longer seen stays in it (``stale``, then ``lost``): it is an obstacle at its last position.
        """
        seen = self._connection.seen()
        snapshot = seen.snapshot if seen is not None else None
        if snapshot is None:
            return ()
        return tuple(
            Neighbour(r.name, r.x, r.y, r.theta, r.v, r.omega, r.age + snapshot.age, r.state)
            for r in snapshot.robots
            if r.name != self.name
        )

    @property
    def stopped(self) -> frozenset[str]:
        """The robots that the newest stop order names."""
        seen = self._connection.seen()
        return seen.stopped if seen is not None else frozenset()

    @property
    def circle(self) -> Circle | None:
        """The circle to follow; None before one was received."""
        seen = self._connection.seen()
        return seen.circle if seen is not None else None

    @property
    def speed(self) -> float | None:
        """The speed received on ``muro/velocity/<name>`` [m/s]; None when there is none or it is stale."""
        seen = self._connection.seen()
        return seen.speed if seen is not None else None

    @property
    def now(self) -> float:
        """The clock [s since 1970]."""
        return self._connection.now()

    # ---- actions

    def drive(self, v: float, omega: float) -> None:
        """Drive; calibration, limits and the safety checks are applied to the twist.

        Call it at each estimate: the robot is stopped when its behaviour makes no call for 0.25 s.

        Args:
            v: forwards [m/s].
            omega: counter-clockwise [rad/s].

        Raises:
            ParameterError: not a finite number.
        """
        self._want(Intent(twist_of(v, omega)))

    def hold(self, reason: str = "held by the behaviour") -> None:
        """Stand still.

        Args:
            reason: shown to operators.
        """
        self._want(hold(str(reason)))

    def velocity(self, speed: float) -> None:
        """Follow the circle at a speed, and publish it on ``muro/velocity/<name>``. Call it as often as :meth:`drive`.

        Args:
            speed: along the circle [m/s].

        Raises:
            ParameterError: not a finite number.
        """
        speed = _number("speed", speed, "m/s")
        seen = self._connection.seen()
        if seen is not None:
            self._want(self._circle.step(seen._replace(speed=speed))._replace(speed=speed))

    def goal(self, x: float, y: float, theta: float | None = None) -> None:
        """Drive to a goal along a Dubins curve; call it once. Any later call of a method that drives replaces it.

        Args:
            x: the goal [m, world].
            y: the goal [m, world].
            theta: the heading to arrive with [rad]; None when it does not matter.

        Raises:
            ParameterError: not a finite number.
            PlanningError: there is no path to the goal, or the robot has no pose yet.
        """
        from muro_zenoh.behaviours import dubins  # needs numpy, which most agents do not load

        x, y = _number("x", x, "m"), _number("y", y, "m")
        theta = _number("theta", theta, "rad") if theta is not None else None
        seen = self._connection.seen()
        if seen is None:
            raise PlanningError(
                f"goal ({x:g}, {y:g}): got no pose of {self.name} yet, expected one to plan a path from"
            )
        ride = self._ride or dubins.make(dubins.Parameters(), self._vehicle)
        refused = ride.go_to(Destination(x, y, theta), seen)
        if refused:
            raise PlanningError(refused)
        if not self._revoked:
            self._ride = ride
            self._connection.behave(ride)

    def _want(self, intent: Intent) -> None:
        if self._revoked:
            return
        if self._ride is not None:
            self._ride = None
            self._connection.behave(None)
        self._connection.want(intent)


def twist_of(v: Any, omega: Any) -> Twist2:
    """A user's twist, checked.

    Args:
        v: forwards [m/s]; any kind of number.
        omega: counter-clockwise [rad/s].

    Raises:
        ParameterError: not a finite number.
    """
    return Twist2(_number("v", v, "m/s"), _number("omega", omega, "rad/s"))


def _number(name: str, value: Any, unit: str) -> float:
    """A user's number as a float, so that a numpy scalar is one too."""
    try:
        if math.isfinite(value):  # raises TypeError for text, which float() would read
            return float(value)
    except (TypeError, ValueError, OverflowError):
        pass
    raise ParameterError(name, got=reprlib.repr(value), expected=f"a finite number [{unit}]")
