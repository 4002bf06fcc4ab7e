"""The robot as a behaviour sees it, built in or a user's own.

::

    async def flock(robot):
        async for estimate in robot.estimates():
            ...
            robot.drive(v, omega)
"""

from __future__ import annotations

import copy
from collections.abc import AsyncIterator, Mapping
from typing import Any, TypeVar

from agents.tasks.drive import Drive
from agents.tasks.localize import Localize
from muro_zenoh import channels, config
from muro_zenoh.arcs import advance
from muro_zenoh.estimation.wheel_model import WheelLimits
from muro_zenoh.geometry import Circle, Pose2, Twist2
from muro_zenoh.messages import (
    Ack,
    Cell,
    Estimate,
    FleetSnapshot,
    Goal,
    Message,
    PlannedPath,
    RobotState,
    SpeedReference,
    Value,
)
from muro_zenoh.planning.path import Path
from muro_zenoh.transport import Bus, Every, Latest, Publisher

S = TypeVar("S", bound=config.Section)
M = TypeVar("M", bound=Message)


WHEEL_LAG = WheelLimits().lag
"""A law is evaluated where the robot will be when its wheels obey [s]."""


class Robot:
    """One robot, as a behaviour sees it.

    Args:
        bus: the bus.
        name: the robot's name.
        scenario: the settings.
        localize: where it is.
        drive: its way to the wheels.

    Attributes:
        name: its name.
        settings: its section of the fleet file.
        arena: the floor.
        parameters: the behaviour's parameters.
    """

    def __init__(self, bus: Bus, name: str, scenario: config.Scenario, localize: Localize, drive: Drive) -> None:
        self.name = name
        self.settings = scenario.robot[name]
        self.arena = scenario.arena
        self.parameters: Mapping[str, Value] = {}
        self._bus = bus
        self._localize = localize
        self._drive = drive
        self._snapshot = bus.latest(channels.ALL_POSITIONS)
        self._circle = bus.latest(channels.CIRCLE)
        self._publishers: dict[str, Publisher[Any]] = {}
        self._given_back = False

    def lend(self) -> Robot:
        """This robot, for one run of a behaviour: what it has left behind when it ended must not drive on."""
        lent = copy.copy(self)
        lent._given_back = False
        return lent

    def give_back(self) -> None:
        """The run is over: from now on nothing that is said to this one has an effect."""
        self._given_back = True

    def parameters_as(self, kind: type[S]) -> S:
        """The behaviour's parameters, checked.

        Args:
            kind: a :class:`~muro_zenoh.config.Section` of the behaviour's own.

        Raises:
            ConfigError: a wrong key, type or range.
        """
        return config.parameters_as(kind, self.parameters, f"behaviour of {self.name}")

    async def estimates(self) -> AsyncIterator[Estimate]:
        """This robot's estimates as they are made; a slow reader gets the newest."""
        inbox = self._bus.latest(channels.ESTIMATE, self.name, own_only=True)
        try:
            async for received in inbox:
                yield received.message
        finally:
            inbox.close()

    def ahead(self, dt: float = WHEEL_LAG) -> Pose2 | None:
        """Where this robot will be at the speeds of its newest estimate, or None when there is no estimate.

        Args:
            dt: how far ahead of the estimate [s]; by default the time that the wheels take to obey.
        """
        newest = self._localize.newest
        if newest is None:
            return None
        return advance(Pose2(newest.x, newest.y, newest.theta), newest.v, newest.omega, dt)

    @property
    def neighbours(self) -> tuple[RobotState, ...]:
        """All other robots as the cameras last saw them, the age brought up to now; none when no snapshot came yet.

        A robot that is not seen any more stays in it (``stale``, then ``lost``): it is an obstacle where it was.
        """
        snapshot = self._snapshot.get()
        if snapshot is None:
            return ()
        since = snapshot.age(self._bus.clock.now())
        return tuple(
            RobotState(r.name, r.x, r.y, r.theta, r.v, r.omega, r.age + since, r.state)
            for r in snapshot.message.robots
            if r.name != self.name
        )

    @property
    def snapshot(self) -> FleetSnapshot | None:
        """All robots, this one too, as everybody was told at the same moment; None before the first."""
        snapshot = self._snapshot.get()
        return snapshot.message if snapshot is not None else None

    @property
    def snapshot_age(self) -> float:
        """Age of the newest snapshot [s]; infinite before the first."""
        snapshot = self._snapshot.get()
        return snapshot.age(self._bus.clock.now()) if snapshot is not None else float("inf")

    @property
    def stopped(self) -> frozenset[str]:
        """The robots that the newest stop order names."""
        return self._drive.stopped_names

    @property
    def circle(self) -> Circle | None:
        """The circle to follow, or None before the first was heard."""
        received = self._circle.get()
        return received.message.circle if received is not None else None

    def drive(self, v: float, omega: float) -> None:
        """Drive, through calibration, limits and everything that may keep the robot from driving.

        Args:
            v: forward speed wanted of the body [m/s].
            omega: turning rate wanted of the body [rad/s].
        """
        if not self._given_back:
            self._drive.twist(Twist2(v, omega))

    def hold(self, reason: str) -> None:
        """Stand still.

        Args:
            reason: why; the operator sees it.
        """
        if not self._given_back:
            self._drive.hold(reason)

    def velocity(self, speed: float) -> None:
        """Say how fast this robot shall go along its path, as ``muro/velocity/<name>``.

        Args:
            speed: along the path [m/s].
        """
        self._say(channels.VELOCITY, SpeedReference(speed=speed))

    def speed_references(self) -> Latest[SpeedReference]:
        """A mailbox with the speed that this robot shall go, from whoever says it; close it when done."""
        return self._bus.latest(channels.VELOCITY, self.name)

    def goal(self, x: float, y: float, theta: float | None = None) -> None:
        """Say where this robot shall go, as ``muro/goal/<name>``.

        Args:
            x: the goal [m, world].
            y: the goal [m, world].
            theta: the heading to arrive with [rad]; None when it does not matter.
        """
        self._say(channels.GOAL, Goal(x=x, y=y, theta=theta))

    def goals(self) -> Every[Goal]:
        """A mailbox with the goals of this robot, from whoever says them; close it when done."""
        return self._bus.every(channels.GOAL, self.name, depth=16)

    def acks(self) -> Publisher[Ack]:
        """Where orders to this robot are answered; close it when done."""
        return self._bus.publisher(channels.ACK, self.name)

    def show_path(self, path: Path, goal_theta: bool) -> None:
        """Publish a planned path.

        Args:
            path: the path.
            goal_theta: whether the goal asked for the heading at its end.
        """
        x, y, theta = path.start
        segments = tuple((segment.length, segment.curvature) for segment in path.segments)
        self._say(channels.PATH, PlannedPath(x=x, y=y, theta=theta, segments=segments, goal_theta=goal_theta))

    def show_cell(self, corners: tuple[tuple[float, float], ...], x: float, y: float) -> None:
        """Publish a Voronoi cell.

        Args:
            corners: of the cell, counter-clockwise [m, world].
            x: of the centroid [m, world].
            y: of the centroid [m, world].
        """
        self._say(channels.CELL, Cell(corners=corners, x=x, y=y))

    @property
    def may_drive(self) -> bool:
        """Whether nothing kept the robot from driving at its last command."""
        return not self._drive.reasons

    @property
    def now(self) -> float:
        """The local clock [s since 1970]."""
        return self._bus.clock.now()

    def _say(self, channel: channels.Channel[M], message: M) -> None:
        """Publish under this robot's name; most robots never need most channels, so they are declared when they do."""
        if self._given_back:
            return
        publisher = self._publishers.get(channel.word)
        if publisher is None:
            publisher = self._publishers[channel.word] = self._bus.publisher(channel, self.name)
        publisher.put(message)
