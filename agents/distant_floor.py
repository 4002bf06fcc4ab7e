"""The floor as a simulated camera in a process of its own sees it: by the truth that the simulator sends."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from agents.base.simulated import Look
from muro_zenoh import channels
from muro_zenoh.arcs import advance
from muro_zenoh.geometry import Pose2
from muro_zenoh.transport import Bus

_OLDEST: Final = 4.0 * channels.TRUTH.period
"""A robot whose truth is older than this has not been heard of: nothing is seen [s]."""


class DistantFloor:
    """A floor in another process, with every robot where its last truth has taken it until now.

    Args:
        bus: the bus.
        robots: the names of the robots, in the scenario's order.
    """

    def __init__(self, bus: Bus, robots: Sequence[str]) -> None:
        self._clock = bus.clock
        self._robots = robots
        self._truth = bus.latest(channels.TRUTH, "*")

    def look(self) -> Look | None:
        """All robots now; None when the simulator is silent, for there is then no floor to be seen."""
        now, truth = self._clock.now(), self._truth.values()
        poses, twists = [], []
        for name in self._robots:
            received = truth.get(name)
            if received is None or not received.age(now) <= _OLDEST:
                return None
            m = received.message
            # At most a period ago: what it accelerated meanwhile moves it by less than a millimetre.
            poses.append(advance(Pose2(m.x, m.y, m.theta), m.v, m.omega, now - m.stamp))
            twists.append((m.v, m.omega))
        return Look(now, 0.0, np.array(poses), np.array(twists))
