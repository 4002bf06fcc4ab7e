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

from collections.abc import AsyncIterator, Callable, Mapping
from typing import Any, NamedTuple, TypeVar

from muro_zenoh import config
from muro_zenoh.behaviours.circle import CircleFollowing
from muro_zenoh.behaviours.interface import Behaviour, Intent, Neighbour, Seen, Vehicle, hold
from muro_zenoh.control.circle import CircleLaw
from muro_zenoh.errors import BehaviourError, PlanningError
from muro_zenoh.geometry import Bounds, Circle, State, Twist2
from muro_zenoh.messages import Estimate
from muro_zenoh.planning.destination import Destination
from muro_zenoh.transport import Latest

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
        parameters: the behaviour's parameters, by key.
    """

    def __init__(
        self, vehicle: Vehicle, settings: config.RobotSettings, parameters: Mapping[str, Any], connection: Connection
    ) -> None:
        self.name = vehicle.name
        self.settings = settings
        self.arena: Bounds = vehicle.arena
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
        """
        self._want(Intent(Twist2(v, omega)))

    def hold(self, reason: str = "held by the behaviour") -> None:
        """Stand still.

        Args:
            reason: shown to operators.
        """
        self._want(hold(reason))

    def velocity(self, speed: float) -> None:
        """Follow the circle at a speed, and publish it on ``muro/velocity/<name>``. Call it as often as :meth:`drive`.

        Args:
            speed: along the circle [m/s].
        """
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
            ParameterError: a number that is not finite.
            PlanningError: there is no path to the goal, or the robot has no pose yet.
        """
        from muro_zenoh.behaviours import dubins  # needs numpy, which most agents do not load

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


class CalledBehaviour(Behaviour):
    """A user's own function that is called at each estimate and returns ``v, omega``.

    It may call the robot's methods instead and return None. After an exception it is not called again.

    Args:
        function: the function.
        make_robot: makes the robot that it is called with.
        on_error: called with the exception that it raises; returns the reason to hold with.
    """

    def __init__(
        self,
        function: Callable[[Robot], Any],
        make_robot: Callable[[Connection], Robot],
        on_error: Callable[[BaseException], str],
    ) -> None:
        self._function = function
        self._on_error = on_error
        self._seen: Seen | None = None
        self._intent: Intent | None = None
        self._ride: Behaviour | None = None
        self._failure = ""
        self._robot = make_robot(
            Connection(lambda: self._seen, self._want, self._behave, _no_estimates, lambda: self._seen_now)
        )

    def step(self, seen: Seen) -> Intent:
        """Call the function.

        Args:
            seen: the observations for the robot's properties.
        """
        if self._failure:
            return hold(self._failure)
        self._seen, self._intent = seen, None
        try:
            wanted = self._function(self._robot)
            if wanted is not None:
                return Intent(_twist(wanted))
        except (Exception, SystemExit) as error:
            self._failure = self._on_error(error)
            return hold(self._failure)
        if self._intent is not None:
            return self._intent
        return self._ride.step(seen) if self._ride is not None else hold("the behaviour returned nothing")

    @property
    def _seen_now(self) -> float:
        return self._seen.now if self._seen is not None else 0.0

    def _want(self, intent: Intent) -> None:
        self._intent = intent

    def _behave(self, ride: Behaviour | None) -> None:
        self._ride = ride


def _twist(wanted: Any) -> Twist2:
    try:
        v, omega = wanted
        return Twist2(float(v), float(omega))
    except (TypeError, ValueError):
        raise ValueError(f"got {wanted!r}, expected `return v, omega` [m/s, rad/s]") from None


def _no_estimates() -> Latest[Estimate]:
    raise BehaviourError("robot.estimates() needs `async def f(robot)`; a plain function is called at each estimate")
