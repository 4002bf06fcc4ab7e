"""The robot as a behaviour sees it, built in or a user's own.

::

    async def flock(robot):
        async for estimate in robot.estimates():
            ...
            robot.drive(v, omega)
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Mapping
from typing import TypeVar

from agents.tasks.drive import Drive
from agents.tasks.localize import Localize
from muro_zenoh import channels, config
from muro_zenoh.geometry import Circle, Pose2, Twist2, advance
from muro_zenoh.messages import Estimate, RobotState, SpeedReference, Value
from muro_zenoh.transport import Bus, Latest

S = TypeVar("S", bound=config.Section)


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
        self._speed = bus.publisher(channels.VELOCITY, name)

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

    def ahead(self, dt: float) -> Pose2 | None:
        """Where this robot will be at the speeds of its newest estimate, or None when there is no estimate.

        Args:
            dt: how far ahead of the estimate [s].
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
        self._drive.twist(Twist2(v, omega))

    def hold(self, reason: str) -> None:
        """Stand still.

        Args:
            reason: why; the operator sees it.
        """
        self._drive.hold(reason)

    def velocity(self, speed: float) -> None:
        """Say how fast this robot shall go along its path, as ``muro/velocity/<name>``.

        Args:
            speed: along the path [m/s].
        """
        self._speed.put(SpeedReference(speed=speed))

    def speed_references(self) -> Latest[SpeedReference]:
        """A mailbox with the speed that this robot shall go, from whoever says it; close it when done."""
        return self._bus.latest(channels.VELOCITY, self.name)

    @property
    def now(self) -> float:
        """The local clock [s since 1970]."""
        return self._bus.clock.now()
