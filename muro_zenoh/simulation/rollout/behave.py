"""Lock-step runs of behaviours: a fleet in which each robot runs its own :class:`Behaviour`, as its agent would."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from muro_zenoh.behaviours.interface import Behaviour, Neighbour, Seen, Snapshot
from muro_zenoh.elementwise import Array
from muro_zenoh.geometry import STILL, Circle, State
from muro_zenoh.planning.path import Path
from muro_zenoh.simulation.rollout.fleet import Fleet
from muro_zenoh.simulation.rollout.settings import LoopSettings


class BehaviourRun(NamedTuple):
    """The true states of a run, sampled at every step of the plant.

    ``time`` (T,) [s]; ``pose`` (T, N, 3): x, y [m, world], theta [rad]; ``twist`` (T, N, 2): v [m/s], omega [rad/s];
    ``paths``: for each robot the planned paths, with the times of planning [s].
    """

    time: Array
    pose: Array
    twist: Array
    paths: tuple[tuple[tuple[float, Path], ...], ...]


def run_behaviours(
    starts: Array,
    behaviours: Sequence[Behaviour],
    circle: Circle | None,
    settings: LoopSettings,
    rng: np.random.Generator,
    seconds: float,
) -> BehaviourRun:
    """Run the behaviours of one fleet from standstill.

    The robots are named r1, r2, ... and see each other as in a snapshot: the position of the newest fix and the speeds
    of the estimate. In a loop without estimation they see the truth.

    Args:
        starts: poses (N, 3): x, y [m, world], theta [rad].
        behaviours: one per robot.
        circle: the circle, for behaviours that need it.
        settings: the loop.
        rng: for everything random.
        seconds: duration [s].
    """
    fleet = Fleet(starts, settings, rng)
    names = [f"r{k + 1}" for k in range(len(starts))]
    times: list[float] = []
    poses: list[Array] = []
    twists: list[Array] = []
    paths: list[list[tuple[float, Path]]] = [[] for _ in starts]

    def policy(t: float, ahead: State) -> tuple[Array, Array]:
        states = rows_of(fleet.state())
        snapshot = snapshot_of(fleet, names, states)
        wanted = []
        for k, (behaviour, now, then) in enumerate(zip(behaviours, states, rows_of(ahead), strict=True)):
            intent = behaviour.step(Seen(t, now, then, circle, snapshot=snapshot, snapshot_age=snapshot.age))
            if intent.path is not None:
                paths[k].append((t, intent.path))
            wanted.append(intent.twist or STILL)
        v, omega = np.array(wanted).T
        return v, omega

    def watch(t: float, pose: Array) -> None:
        times.append(t)
        poses.append(pose.copy())
        twists.append(fleet.plant.twist.copy())

    for _ in range(round(seconds / settings.period)):
        fleet.step(policy, watch)
    return BehaviourRun(np.array(times), np.array(poses), np.array(twists), tuple(map(tuple, paths)))


def rows_of(state: State) -> list[State]:
    """One state of floats per robot, from one of arrays.

    Args:
        state: arrays (N,).
    """
    return [State(*row) for row in zip(*(column.tolist() for column in state), strict=True)]


def snapshot_of(fleet: Fleet, names: Sequence[str], states: Sequence[State]) -> Snapshot:
    """The snapshot that the base station would publish now.

    Args:
        fleet: the robots.
        names: the robots' names.
        states: the robots' estimated states.
    """
    fix = fleet.newest_fix
    if fix is None:
        robots = [Neighbour(name, *state, 0.0) for name, state in zip(names, states, strict=True)]
    else:
        places = zip(fix.x.tolist(), fix.y.tolist(), fix.theta.tolist(), strict=True)
        robots = [
            Neighbour(name, *place, state.v, state.omega, fleet.fix_age)
            for name, place, state in zip(names, places, states, strict=True)
        ]
    return Snapshot(robots, fleet.time, 1, 0.0)
