"""Cyclic pursuit from anywhere: the robots of a crowd that have to get past each other to a circle, and round it."""

from __future__ import annotations

import math

import numpy as np

from benchmarks.support.crowd import ROBOT, Case, Method, Result, World
from muro_zenoh.arcs import chord
from muro_zenoh.behaviours.interface import Seen
from muro_zenoh.behaviours.pursuit import Parameters, Pursuit
from muro_zenoh.control.circle import CircleLaw
from muro_zenoh.control.pursuit import TwoGap
from muro_zenoh.geometry import STILL, Bounds, Circle, State
from muro_zenoh.simulation.starts import random_starts

CIRCLE = Circle(0.0, 0.0, 1.2)
SPACING, OFF_CIRCLE = 0.1, 0.05
"""A ring is settled when all gaps are within this of even [rad], and all robots within this of the circle [m]."""
_SETTLED_FOR = 2.0
_LAW = TwoGap(cruise=0.2)


def pursuit(rng: np.random.Generator, robots: int, arena: Bounds) -> Case:
    """Robots anywhere, without goals."""
    starts = random_starts(rng, robots, arena, ROBOT.radius, margin=0.1)
    return Case(starts, np.empty((0, 2)), arena)


def pursue(case: Case, method: Method, rng: np.random.Generator, delay: float, loss: float) -> Result:
    """Run until the ring has been settled for two seconds, or the time is over.

    Args:
        case: where the robots start.
        method: how they avoid each other.
        rng: for lost snapshots.
        delay: age of the positions when they arrive [s].
        loss: share of the snapshots that each link loses.
    """
    world = World(case, rng, delay, loss)
    world.stand(method)
    circle_law = CircleLaw(Parameters().law)
    behaviours = [Pursuit(name, _LAW, circle_law) for name in world.names]
    since = math.inf
    while world.time < case.seconds and world.time - since < _SETTLED_FOR:
        commands = []
        for i, behaviour in enumerate(behaviours):
            state, snapshot = world.state(i), world.snapshot(i)
            twist = behaviour.step(Seen(world.time, state, _ahead(state), CIRCLE, snapshot=snapshot)).twist
            commands.append(STILL if twist is None else method.step(i, world.time, state, twist, snapshot))
        world.step(commands)
        x, y, _ = world.plant.pose.T
        angles = np.sort(np.arctan2(y, x))
        gaps = np.diff(angles, append=angles[0] + 2.0 * math.pi)
        uneven = abs(gaps - 2.0 * math.pi / world.robots).max() > SPACING
        off = abs(np.hypot(x, y) - CIRCLE.radius).max() > OFF_CIRCLE
        since = math.inf if uneven or off else min(since, world.time)
    seconds = since if world.time - since >= _SETTLED_FOR else math.inf
    return Result(seconds, world.plant.contacts, world.through_wall, world.plant.min_separation, False)


def _ahead(state: State) -> State:
    """The state when a command given now takes effect."""
    reach, c, s = chord(state.theta, state.v * ROBOT.lag, 0.5 * state.omega * ROBOT.lag)
    x, y = state.x + reach * c, state.y + reach * s
    return State(x, y, state.theta + state.omega * ROBOT.lag, state.v, state.omega)
