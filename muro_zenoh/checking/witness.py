"""Sees from outside when information reaches a robot, and how old it is, whatever its own stamps say."""

from __future__ import annotations

import asyncio
import bisect
from array import array
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from muro_zenoh import channels
from muro_zenoh.channels import Channel, key_of
from muro_zenoh.elementwise import Array
from muro_zenoh.messages import Message
from muro_zenoh.transport.memory_link import Witness

REALM = "muro"


class _Arrivals:
    """When messages arrived, and from when what they say is [s, loop]."""

    def __init__(self) -> None:
        self.arrived = array("d")  # a list would keep a float each
        self.known = array("d")

    def add(self, arrived: float, since: float) -> None:
        self.arrived.append(arrived)
        self.known.append(max(since, self.known[-1]) if self.known else since)

    def newest(self, times: Array) -> Array:
        """From when the newest information is that had arrived at each time; minus infinity before the first."""
        known = np.array([-np.inf, *self.known])
        newest: Array = known[np.searchsorted(np.array(self.arrived), times, side="right")]
        return newest


class Informed(NamedTuple):
    """From when the newest information is that has reached a robot, at each time (T,) [s].

    Attributes:
        pose: when the newest picture was taken whose pose has reached its agent.
        snapshot: when the newest table of all positions was sent that has reached its agent.
        command: when the newest command was sent that has reached its base.
    """

    pose: Array
    snapshot: Array
    command: Array


class Witnesses:
    """Note what reaches the robots.

    Args:
        robots: their names.
    """

    def __init__(self, robots: Sequence[str]) -> None:
        self._poses = {name: _Arrivals() for name in robots}
        self._snapshots = {name: _Arrivals() for name in robots}
        self._commands = {name: _Arrivals() for name in robots}
        self._looked = array("d")
        self._taken = array("d")

    def located(self, taken: float) -> None:
        """The base station has located the robots in a picture.

        Args:
            taken: when it was taken [s, loop].
        """
        self._looked.append(asyncio.get_running_loop().time())
        self._taken.append(taken)

    def of_agent(self, name: str) -> dict[str, Witness]:
        """What looks at the messages to an agent, by key expression.

        Args:
            name: the robot's.
        """
        poses, snapshots = self._poses[name], self._snapshots[name]

        def see_pose(key: str, sent: float) -> None:
            looked = bisect.bisect_right(self._looked, sent)
            poses.add(_now(), self._taken[looked - 1] if looked else -np.inf)

        def see_snapshot(key: str, sent: float) -> None:
            snapshots.add(_now(), sent)

        return {_key(channels.POSE, name): see_pose, _key(channels.ALL_POSITIONS): see_snapshot}

    def of_bases(self, names: Sequence[str]) -> dict[str, Witness]:
        """What looks at the messages to the bases of a process, by key expression.

        Args:
            names: the robots'.
        """
        seen = {_key(channels.CMD_VEL, name): self._commands[name] for name in names}

        def see_command(key: str, sent: float) -> None:
            if key in seen:
                seen[key].add(_now(), sent)

        return {_key(channels.CMD_VEL, names[0] if len(names) == 1 else "*"): see_command}

    def informed(self, name: str, times: Array, begun: float) -> Informed:
        """What a robot has been informed of.

        Args:
            name: the robot's.
            times: when (T,) [s since the start].
            begun: when that start was [s, loop].
        """
        of = (self._poses[name], self._snapshots[name], self._commands[name])
        return Informed(*(arrivals.newest(times + begun) - begun for arrivals in of))


def _key(channel: Channel[Message], name: str = "") -> str:
    return key_of(REALM, channel, name)


def _now() -> float:
    return asyncio.get_running_loop().time()
