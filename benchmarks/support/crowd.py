"""Robots that have to get past each other: the cases of ``benchmarks/safety.py``, and the lock-step world they run in.

No bus and no filter of poses: each robot knows its own state exactly and the others' as they were ``delay`` ago, in
snapshots of which each robot's link loses a share. The wheels are those of a robot's settings.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from muro_zenoh.behaviours.interface import Neighbour, Snapshot
from muro_zenoh.config.sections import ARENA, RobotSettings
from muro_zenoh.control.point_forward import GoToGoal
from muro_zenoh.geometry import STILL, Bounds, Pose2, State, Twist2
from muro_zenoh.simulation.plant import Plant
from muro_zenoh.simulation.starts import random_starts
from muro_zenoh.walls import Wall

ROBOT = RobotSettings()
PERIOD = 0.05
"""Of the cameras and of the control loops [s]."""
CRUISE = 0.4
"""Speed at which robots want to drive [m/s]."""
ARRIVED = 0.1
"""A robot within this distance of its goal is there [m]."""
DESIRED = GoToGoal(speed=CRUISE, ahead=0.15, slope=1.0, tolerance=0.03)
OPEN = Bounds(-4.0, 4.0, -4.0, 4.0)
LARGE = Bounds(-3.0, 3.0, -3.0, 3.0)
DOOR = 0.8
"""Width of the doorway [m]."""
SNAPSHOT_LIMIT = 0.5
"""An older snapshot is stale [s]."""

_BEFORE_START = 1.0
"""For how long the robots have stood and heard snapshots when they set off, as agents do that hold [s]."""
_SUBSTEPS = 4
_CAMERA_AGE = 0.05
_STANDING, _STOOD = 0.01, 10.0  # m/s, s
_STUCK = 20.0  # when nobody has moved for so long, nobody will [s]


class Case(NamedTuple):
    """One start of a crowd.

    ``starts`` (N, 3): x, y [m, world], theta [rad]; ``goals`` (N, 2) [m, world]; ``arena``: the floor; ``walls``
    inside it; ``seconds``: the robots' time to arrive [s].
    """

    starts: np.ndarray
    goals: np.ndarray
    arena: Bounds
    walls: tuple[Wall, ...] = ()
    seconds: float = 120.0


def swap(rng: np.random.Generator, robots: int, arena: Bounds) -> Case:
    """Robots on a circle, each with its goal at the opposite point; places and headings jittered."""
    angles = np.arange(robots) * (2.0 * math.pi / robots)
    radius = 1.3 if robots <= 10 else 0.13 * robots
    circle = radius * np.column_stack((np.cos(angles), np.sin(angles)))
    places = circle + rng.uniform(-0.02, 0.02, (robots, 2))
    headings = angles + math.pi + rng.uniform(-0.3, 0.3, robots)
    return Case(np.column_stack((places, headings)), -circle, arena)


def pairs(rng: np.random.Generator, robots: int, arena: Bounds) -> Case:
    """Robots anywhere, with goals anywhere; both 10 cm from each other and from the walls."""
    starts = random_starts(rng, robots, arena, ROBOT.radius, margin=0.1)
    return Case(starts, random_starts(rng, robots, arena, ROBOT.radius, margin=0.1)[:, :2], arena)


def doorway(rng: np.random.Generator, robots: int, arena: Bounds) -> Case:
    """A wall across the middle with one doorway; each robot's goal is in the other half."""
    left = Bounds(arena.x_min, 0.0, arena.y_min, arena.y_max)
    right = Bounds(0.0, arena.x_max, arena.y_min, arena.y_max)
    there, back = robots - robots // 2, robots // 2
    starts, goals = (
        np.concatenate(
            (
                random_starts(rng, there, first, ROBOT.radius, margin=0.1),
                random_starts(rng, back, second, ROBOT.radius, margin=0.1),
            )
        )
        for first, second in ((left, right), (right, left))
    )
    walls = Wall(0.0, 0.5 * DOOR, 0.0, arena.y_max), Wall(0.0, arena.y_min, 0.0, -0.5 * DOOR)
    return Case(starts, goals[:, :2], arena, walls, seconds=300.0)


Layout = Callable[[np.random.Generator, int, Bounds], Case]
CASES: dict[str, Layout] = {"swap": swap, "pairs": pairs, "doorway": doorway}
FLOORS = {"walls": ARENA, "open": OPEN, "6 x 6": LARGE}


class Method(Protocol):
    """How the robots of one case avoid each other."""

    def hear(self, robot: int, t: float, snapshot: Snapshot) -> None:
        """Take a snapshot before the start; most methods need none.

        Args:
            robot: the robot's index.
            t: the time [s].
            snapshot: what it sees of all.
        """
        return

    def step(self, robot: int, t: float, state: State, desired: Twist2, snapshot: Snapshot | None) -> Twist2:
        """The command of one robot.

        Args:
            robot: its index.
            t: the time [s].
            state: its own, now.
            desired: what it wants.
            snapshot: what it sees of all; None when that is stale.
        """
        ...


class Result(NamedTuple):
    """One run: ``seconds`` until all robots were at their goals, infinite when they never were; ``contacts`` between
    two bodies; whether one touched a wall, ``walls``; ``separation``: the least distance of two centres [m]; ``stood``:
    whether a robot stood still for ten seconds away from its goal."""

    seconds: float
    contacts: int
    walls: bool
    separation: float
    stood: bool


class World:
    """Bodies, and what each robot sees of them.

    Args:
        case: where they start.
        rng: for slip and lost snapshots.
        delay: age of the positions when they arrive [s].
        loss: share of the snapshots that each link loses.
    """

    def __init__(self, case: Case, rng: np.random.Generator, delay: float, loss: float) -> None:
        self.robots = len(case.starts)
        self.time = 0.0
        self.through_wall = False
        self._rng, self._loss = rng, loss
        self._inside = case.arena.shrunk(ROBOT.radius)
        self.plant = Plant(
            case.starts, rng, limits=ROBOT.wheels, radius=ROBOT.radius, drive_error=0.0, slip=0.0, add_odometry=False
        )
        self.names = [f"r{i}" for i in range(self.robots)]
        self._camera_age = min(delay, _CAMERA_AGE)
        self._walls = case.walls
        self._behind = round(delay / PERIOD)
        # The robots stood where they start, and were seen there, long before.
        self._seen = [self._photograph()] * (self._behind + 1)
        self._newest = np.zeros(self.robots, dtype=int)
        self._step = self._behind

    def _photograph(self) -> tuple[Neighbour, ...]:
        rows = np.column_stack((self.plant.pose, self.plant.twist)).tolist()
        return tuple(Neighbour(name, *row, self._camera_age) for name, row in zip(self.names, rows, strict=True))

    def state(self, robot: int) -> State:
        """A robot's state now."""
        seen = self._seen[-1][robot]
        return State(seen.x, seen.y, seen.theta, seen.v, seen.omega)

    def snapshot(self, robot: int) -> Snapshot | None:
        """The newest snapshot that a robot has received; None when it is stale."""
        newest = int(self._newest[robot])
        age = (self._step - newest) * PERIOD - self._camera_age
        if age > SNAPSHOT_LIMIT:
            return None
        return Snapshot(self._seen[newest], (newest - self._behind) * PERIOD + self._camera_age, 1, age)

    def step(self, commands: list[Twist2]) -> None:
        """Drive for one period, and deliver what arrives at its end."""
        held = np.array(commands)
        for _ in range(_SUBSTEPS):
            self.plant.step(held, PERIOD / _SUBSTEPS)
            self._look()
        self._step += 1
        self.time += PERIOD
        self._seen.append(self._photograph())
        arrived = self._rng.random(self.robots) >= self._loss
        self._newest[arrived] = self._step - self._behind

    def stand(self, method: Method) -> None:
        """Let the robots stand and hear snapshots until the start.

        Args:
            method: how they avoid each other.
        """
        self.time = -_BEFORE_START
        for _ in range(round(_BEFORE_START / PERIOD)):
            for robot in range(self.robots):
                if (snapshot := self.snapshot(robot)) is not None:
                    method.hear(robot, self.time, snapshot)
            self.step([STILL] * self.robots)
        self.time = 0.0

    def _look(self) -> None:
        """Walls; the plant itself sees robots touch."""
        x, y, _ = self.plant.pose.T
        inside = self._inside
        self.through_wall |= bool(
            x.min() < inside.x_min or x.max() > inside.x_max or y.min() < inside.y_min or y.max() > inside.y_max
        )
        for wall in self._walls:
            self.through_wall |= bool(wall.distance(x, y).min() < ROBOT.radius)


def drive_to_goals(case: Case, method: Method, rng: np.random.Generator, delay: float, loss: float) -> Result:
    """Run a case until all robots are at their goals, or its time is over.

    Args:
        case: where they start and where to.
        method: how they avoid each other.
        rng: for lost snapshots.
        delay: age of the positions when they arrive [s].
        loss: share of the snapshots that each link loses.
    """
    world = World(case, rng, delay, loss)
    world.stand(method)
    since = np.zeros(world.robots)
    stood, anybody_moved = False, 0.0
    seconds = math.inf
    while world.time < case.seconds:
        commands = []
        for i, (x, y) in enumerate(case.goals.tolist()):
            state = world.state(i)
            desired = DESIRED.twist(Pose2(state.x, state.y, state.theta), x, y)
            commands.append(method.step(i, world.time, state, desired, world.snapshot(i)))
        world.step(commands)
        away = np.hypot(*(world.plant.pose[:, :2] - case.goals).T) > ARRIVED
        if not away.any():
            seconds = world.time
            break
        moving = abs(world.plant.twist[:, 0]) > _STANDING
        if moving.any():
            anybody_moved = world.time
        elif world.time - anybody_moved > _STUCK:
            return Result(math.inf, world.plant.contacts, world.through_wall, world.plant.min_separation, True)
        since[moving | ~away] = world.time
        stood |= bool((world.time - since >= _STOOD).any())
    return Result(seconds, world.plant.contacts, world.through_wall, world.plant.min_separation, stood)
