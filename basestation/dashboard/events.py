"""What happened, in words: the last hundred changes of robots, processes and orders."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Mapping
from typing import Final

from basestation.dashboard.frames import Frames
from muro_zenoh.geometry import Circle
from muro_zenoh.messages import Behaviour, Goal, Lease, StopOrder, Value
from muro_zenoh.runtime.waiting import without_numbers

_MOST: Final = 100


class Events:
    """Notes what changes.

    Args:
        frames: takes the events.
    """

    def __init__(self, frames: Frames) -> None:
        self._frames = frames
        self._numbers = itertools.count(1)
        self._robots: dict[str, tuple[str, str]] = {}
        self._alive: set[tuple[str, str]] | None = None
        self._stop: tuple[bool, tuple[str, ...]] | None = None
        self._leases: tuple[str, ...] | None = None
        self._faults: tuple[str, ...] = ()
        self._behaviours: dict[str, tuple[str, Mapping[str, Value]]] = {}
        self._circle: Circle | None = None

    def add(self, t: float, process: str, text: str) -> None:
        """Add an event.

        Args:
            t: when [s].
            process: whose.
            text: what happened.
        """
        self._frames.add_event([next(self._numbers), t, process, text], _MOST)

    def robot(self, t: float, name: str, state: str, reason: str) -> None:
        """Note a robot's state.

        Args:
            t: the time [s].
            name: of the robot.
            state: in one word.
            reason: for it.
        """
        # "keeps clear" and ages change all the time; what an operator wants to know is when the reason does.
        now = state, without_numbers((reason,))
        if self._robots.get(name) == now:
            return
        self._robots[name] = now
        self.add(t, name, f"{state}: {reason}" if reason else state)

    def behaviour(self, t: float, name: str, behaviour: Behaviour | None) -> None:
        """Note what a robot is to do.

        Args:
            t: the time [s].
            name: of the robot.
            behaviour: its behaviour; None when it is not known.
        """
        if behaviour is None:
            return
        before, now = self._behaviours.get(name), (behaviour.behaviour, behaviour.parameters)
        if before == now:
            return
        self._behaviours[name] = now
        if before is None:
            return
        given = ", ".join(f"{key} = {value}" for key, value in behaviour.parameters.items())
        self.add(t, name, f"behaviour {behaviour.behaviour}" + (f" with {given}" if given else ""))

    def goal(self, t: float, name: str, goal: Goal) -> None:
        """Note a goal that a robot has taken.

        Args:
            t: the time [s].
            name: of the robot.
            goal: the goal.
        """
        heading = f", heading {math.degrees(goal.theta):.0f}°" if goal.theta is not None else ""
        self.add(t, name, f"goal ({goal.x:.2f}, {goal.y:.2f}) m{heading}")

    def circle(self, t: float, circle: Circle) -> None:
        """Note the circle.

        Args:
            t: the time [s].
            circle: the circle.
        """
        before, self._circle = self._circle, circle
        if before in (None, circle):
            return
        sense = "clockwise" if circle.clockwise else "counter-clockwise"
        self.add(
            t, "basestation", f"circle round ({circle.x:.2f}, {circle.y:.2f}) m, radius {circle.radius:.2f} m, {sense}"
        )

    def processes(self, t: float, alive: set[tuple[str, str]]) -> None:
        """Note which processes are alive.

        Args:
            t: the time [s].
            alive: role and name of each.
        """
        before, self._alive = self._alive, set(alive)
        if before is None:
            return
        for role, name in sorted(self._alive - before):
            self.add(t, name, f"{role} is there")
        for role, name in sorted(before - self._alive):
            self.add(t, name, f"{role} is gone")

    def stop(self, t: float, order: StopOrder) -> None:
        """Note the stop state.

        Args:
            t: the time [s].
            order: the stop state.
        """
        before, self._stop = self._stop, (order.all, order.names)
        if before == self._stop or (before is None and not order.all and not order.names):
            return
        whom = "every robot" if order.all else " ".join(order.names)
        self.add(t, "basestation", f"stop: {whom}" if whom else "no robot is stopped any longer")

    def faults(self, t: float, lasting: tuple[str, ...]) -> None:
        """Note what is broken.

        Args:
            t: the time [s].
            lasting: the faults that last, in words.
        """
        before, self._faults = self._faults, lasting
        for text in lasting:
            if text not in before:
                self.add(t, "muro", f"fault: {text}")
        for text in before:
            if text not in lasting:
                self.add(t, "muro", f"fault over: {text}")

    def leases(self, t: float, leases: Collection[Lease]) -> None:
        """Note who holds robots.

        Args:
            t: the time [s].
            leases: those in force.
        """
        before, self._leases = self._leases, tuple(map(str, leases))
        for text in self._leases:
            if text not in (before or ()):
                self.add(t, "basestation", f"robots are {text}")
        for text in before or ():
            if text not in self._leases:
                self.add(t, "basestation", f"no longer {text}")
