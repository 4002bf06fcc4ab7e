"""Wheels of the simulated plant: of all robots in the simulator, or of one robot on its own floor."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from agents.base.wheels import WheelReading
from muro_zenoh.config import RobotSettings, Scenario
from muro_zenoh.elementwise import Array
from muro_zenoh.runtime.clock import Clock
from muro_zenoh.simulation.plant import Plant
from muro_zenoh.simulation.starts import starts_of
from muro_zenoh.walls import edges

log = logging.getLogger(__name__)

STEP = 0.01
"""Step of the plant [s]."""

_MAX_CATCH_UP = 0.5
"""Simulated time beyond this is skipped [s], so that robots do not drive on blindly after the process was suspended."""


class Look(NamedTuple):
    """All robots at one moment: ``stamp`` [s since 1970], how long ago that is (``behind`` [s]), and their true
    ``poses``: (N, 3), x, y [m, world], theta [rad], with the ``twists`` (N, 2), v [m/s], omega [rad/s]."""

    stamp: float
    behind: float
    poses: Array
    twists: Array


@dataclass(frozen=True, slots=True, eq=False)
class Hand:
    """Carries a robot: from a pose, by a distance, between two times of a floor."""

    start: tuple[float, float, float]
    by: tuple[float, float, float]
    begin: float
    end: float

    def at(self, now: float) -> tuple[float, float, float]:
        """Where it has the robot: x, y [m, world], theta [rad].

        Args:
            now: the floor's time [s].
        """
        part = min(max((now - self.begin) / (self.end - self.begin), 0.0), 1.0)
        x, y, theta = (value + part * change for value, change in zip(self.start, self.by, strict=True))
        return x, y, theta

    @property
    def twist(self) -> tuple[float, float]:
        """How fast it moves the robot [m/s], and turns it [rad/s]."""
        dx, dy, turn = self.by
        lasts = self.end - self.begin
        return math.hypot(dx, dy) / lasts, turn / lasts


class Floor:
    """A plant that follows a clock: every access first advances it to now.

    Args:
        plant: the robots.
        clock: the clock to follow.
        watchdog: a command is driven for this time after it was given, as wheels do that have a watchdog of their own
            [s]. Their base gives it up earlier; but one that was frozen catches up before it looks at the time.

    Attributes:
        commands: (N, 2), the current commands: v [m/s], omega [rad/s].
        lost: skipped time, because this process was suspended [s].
    """

    def __init__(self, plant: Plant, clock: Clock, watchdog: float = math.inf) -> None:
        self.commands: Array = np.zeros((len(plant), 2))
        self.lost = 0.0
        self._plant = plant
        self._clock = clock
        self._time = clock.now()
        self._watchdog = watchdog
        self._given = [-math.inf] * len(plant)
        self._readings: list[WheelReading] = []  # cached until the plant moves
        self._begun = self._time
        self._hands: dict[int, Hand] = {}

    @property
    def plant(self) -> Plant:
        """The robots at the last :meth:`catch_up`."""
        return self._plant

    @property
    def now(self) -> float:
        """The time by the floor's clock [s since 1970]."""
        return self._clock.now()

    @property
    def behind(self) -> float:
        """Age of the plant's state [s]; after :meth:`catch_up` less than one step."""
        return self._clock.now() - self._time

    def catch_up(self) -> float:
        """Advance the plant to now; return the time of its state [s since 1970], less than one step ago."""
        behind = self._clock.now() - self._time
        if behind < STEP:
            return self._time
        if behind > _MAX_CATCH_UP:
            self.lost += behind - _MAX_CATCH_UP
            self._time += behind - _MAX_CATCH_UP
            behind = _MAX_CATCH_UP
        for _ in range(int(behind / STEP)):
            self._stop_old()
            self._step()
            self._time += STEP
        self._readings = []
        return self._time

    def look(self) -> Look:
        """All robots now."""
        return Look(self.catch_up(), self.behind, self._plant.pose.copy(), self._plant.twist)

    def command(self, row: int, v: float, omega: float) -> None:
        """Turn a robot's wheels from now on.

        Args:
            row: the robot's row.
            v: forward speed of a nominal robot [m/s].
            omega: its turning speed [rad/s].
        """
        self.catch_up()  # the old command applied until now
        self.commands[row] = v, omega
        self._given[row] = self._clock.now()

    def _stop_old(self) -> None:
        """The watchdog: commands that are too old are followed no more."""
        for row, given in enumerate(self._given):
            if self._time - given > self._watchdog and self._has_watchdog(row):
                self.commands[row] = 0.0

    def _has_watchdog(self, row: int) -> bool:
        return True

    def _step(self) -> None:
        """Advance the plant by one step."""
        self._advance(self.commands)

    def _advance(self, commands: Array) -> None:
        """Advance the plant by one step of these commands; who is carried is where the hand has it."""
        self._plant.step(commands, STEP)
        for row, hand in self._hands.items():
            self._plant.place(row, *hand.at(self.elapsed + STEP))

    @property
    def elapsed(self) -> float:
        """Time since the start [s]."""
        return self._time - self._begun

    def carry(self, row: int, by: tuple[float, float, float], lasts: float) -> Hand:
        """Carry a robot from now on.

        Args:
            row: which.
            by: how far: x [m], y [m], theta [rad].
            lasts: how long it takes [s].

        Returns:
            For :meth:`set_down`.
        """
        self.catch_up()
        x, y, theta = self.plant.pose[row].tolist()
        hand = self._hands[row] = Hand((x, y, theta), by, self.elapsed, self.elapsed + lasts)
        return hand

    def set_down(self, row: int, hand: Hand) -> float:
        """End carrying a robot.

        Args:
            row: which.
            hand: what carries it; another one may have taken it meanwhile.

        Returns:
            How far it is from where it was taken [m].
        """
        self.catch_up()
        if self._hands.get(row) is hand:
            del self._hands[row]
        x, y, _ = self.plant.pose[row].tolist()
        return math.hypot(x - hand.start[0], y - hand.start[1])

    def reading(self, row: int) -> WheelReading:
        """What the encoders of a robot's nominal wheels report now. Wheels on this floor feel no wall and no edge.

        Args:
            row: the robot's row.
        """
        self.catch_up()
        if not self._readings:
            # For all robots at once: the reader of one usually reads all.
            rows = np.concatenate((self._plant.odometry_pose, self._plant.odometry_twist), axis=1)
            self._readings = [WheelReading(*numbers) for numbers in rows.tolist()]
        return self._readings[row]


class SimulatedWheels:
    """The wheels of one robot on a :class:`Floor`.

    Args:
        floor: the floor.
        row: this robot's row.
        name: the robot's, for the log.
    """

    def __init__(self, floor: Floor, row: int, name: str = "") -> None:
        self._floor = floor
        self._row = row
        self._name = name
        self._commanded = False

    def command(self, v: float, omega: float) -> None:
        """Turn the wheels so that a nominal robot would drive at ``v`` [m/s] and ``omega`` [rad/s]."""
        self._floor.command(self._row, v, omega)
        commanded = (v, omega) != (0.0, 0.0)
        if commanded != self._commanded:
            self._commanded = commanded
            # The only witness of when wheels stop that no fault of the network silences: benchmarks/stopping.py reads
            # it.
            log.debug(
                "%s: wheels commanded to %s at %.3f", self._name, "turn" if commanded else "stop", self._floor.now
            )

    def read(self) -> WheelReading:
        """What the encoders of nominal wheels report."""
        return self._floor.reading(self._row)


def make_plant(scenario: Scenario, rng: np.random.Generator, *, count_contacts: bool = True) -> Plant:
    """The robots of a scenario, at its starts, or anywhere in its arena.

    Args:
        scenario: the settings.
        rng: draws the starts, the hidden drive errors and the slip.
        count_contacts: whether the plant counts them.

    Raises:
        PlanningError: the robots do not fit into the arena.
    """
    robots = list(scenario.robot.values())
    radii = np.array([robot.radius for robot in robots])
    apart = scenario.separation
    margin = max(apart.margin, apart.wall_margin)
    return Plant(
        starts_of(scenario.starts, scenario.robots, rng, scenario.arena, radii, margin, scenario.walls),
        rng,
        limits=[robot.wheels for robot in robots],
        radius=radii,
        drive_error=scenario.simulation.drive_error,
        slip=scenario.simulation.slip,
        count_contacts=count_contacts,
        walls=(*scenario.walls, *edges(scenario.arena)) if count_contacts else (),
    )


def make_wheels(robot: RobotSettings, clock: Clock) -> SimulatedWheels:
    """A nominal robot on its own floor, which no camera sees: to test a link and the dead-man.

    Args:
        robot: its settings.
        clock: the clock of the floor.
    """
    plant = Plant(np.zeros((1, 3)), np.random.default_rng(0), limits=robot.wheels, drive_error=0.0, slip=0.0)
    return SimulatedWheels(Floor(plant, clock), 0)
