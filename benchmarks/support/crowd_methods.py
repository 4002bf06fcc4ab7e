"""How the robots of a crowd avoid each other: our filter, and what it is compared with.

ORCA and the barrier know no way through a doorway: they get one, a place in front of the door, as the planner of a lab
would give it to them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import daqp
import numpy as np
import pyrvo

from benchmarks.support.crowd import DESIRED, DOOR, OPEN, PERIOD, ROBOT, Case, Method
from muro_zenoh.behaviours.interface import Snapshot
from muro_zenoh.geometry import STILL, Pose2, State, Twist2, wrap_to_pi
from muro_zenoh.safety.barrier import Barrier
from muro_zenoh.safety.separation import Body, Separation, SeparationSettings
from muro_zenoh.safety.separation.projection import Row

BODY = Body(ROBOT.radius, ROBOT.v_max, ROBOT.omega_max, ROBOT.a_max, ROBOT.alpha_max, ROBOT.brake, ROBOT.lag)
_INFLATION = 0.05
_HORIZON = 5.0
_WALL_HORIZON = 1.0
_RANGE = 3.0
_NUDGE = 0.1
"""What the authors' examples do against deadlocks: a random part of the preferred velocity [m/s]."""
_HEADING_GAIN = 3.0
BARRIER = Barrier()
SETTINGS = SeparationSettings()


class NoFilter(Method):
    """Robots that drive as they want, through each other.

    Args:
        case: not used.
    """

    def __init__(self, case: Case) -> None: ...

    def step(self, robot: int, t: float, state: State, desired: Twist2, snapshot: Snapshot | None) -> Twist2:
        return desired


class Ours(Method):
    """The separation filter, one for each robot.

    Args:
        case: the robots' goals, the walls.
        settings: of the filter.
    """

    def __init__(self, case: Case, settings: SeparationSettings = SETTINGS) -> None:
        names = [f"r{i}" for i in range(len(case.starts))]
        self._goals = [(x, y) for x, y in case.goals.tolist()]
        self.filters = [
            Separation(me, BODY, {name: BODY for name in names if name != me}, case.arena, settings, case.walls)
            for me in names
        ]

    def hear(self, robot: int, t: float, snapshot: Snapshot) -> None:
        self.filters[robot].learn(t, snapshot)

    def step(self, robot: int, t: float, state: State, desired: Twist2, snapshot: Snapshot | None) -> Twist2:
        goal = self._goals[robot] if self._goals else None
        return self.filters[robot].step(t, state, desired, snapshot, goal).twist


class Orca(Method):
    """Optimal reciprocal collision avoidance (RVO2): ORCA chooses a velocity, the unicycle turns to it and follows.

    Each robot has a simulator of its own, with what it sees. It may drive at the robots' full speed, with which it does
    best.

    Args:
        case: the robots' goals, the walls.
    """

    def __init__(self, case: Case) -> None:
        self._case = case
        self._robots = len(case.starts)
        self._rng = np.random.default_rng(0)
        self._simulators = [self._simulator() for _ in case.starts]

    def _simulator(self) -> Any:
        radius = ROBOT.radius + _INFLATION
        simulator = pyrvo.RVOSimulator()
        simulator.set_time_step(PERIOD)
        simulator.set_agent_defaults(_RANGE, self._robots, _HORIZON, _WALL_HORIZON, radius, ROBOT.v_max)
        for x, y, _ in self._case.starts.tolist():
            simulator.add_agent((x, y))
        if self._case.arena is not OPEN:
            arena = self._case.arena
            # clockwise: the free side is the inside
            simulator.add_obstacle(
                [
                    (arena.x_min, arena.y_min),
                    (arena.x_min, arena.y_max),
                    (arena.x_max, arena.y_max),
                    (arena.x_max, arena.y_min),
                ]
            )
        for x, y, end_x, end_y in self._case.walls:
            simulator.add_obstacle([(x, y), (end_x, end_y)])
        simulator.process_obstacles()
        return simulator

    def step(self, robot: int, t: float, state: State, desired: Twist2, snapshot: Snapshot | None) -> Twist2:
        if snapshot is None:
            return STILL
        simulator = self._simulators[robot]
        for i, other in enumerate(snapshot.robots):
            if i == robot:  # its velocity is the one that ORCA chose last
                simulator.set_agent_position(i, (state.x, state.y))
            else:
                simulator.set_agent_position(i, (other.x, other.y))
                simulator.set_agent_velocity(i, (other.v * math.cos(other.theta), other.v * math.sin(other.theta)))
        x, y = way(self._case, robot, state)
        dx, dy = x - state.x, y - state.y
        distance = math.hypot(dx, dy)
        wish = min(ROBOT.v_max, distance) / max(distance, 1e-9)
        angle, nudge = self._rng.uniform(0.0, 2.0 * math.pi), self._rng.uniform(0.0, _NUDGE)
        wanted = wish * dx + nudge * math.cos(angle), wish * dy + nudge * math.sin(angle)
        simulator.set_agent_pref_velocity(robot, wanted)
        simulator.do_step()
        velocity = simulator.get_agent_velocity(robot)
        speed = math.hypot(velocity.x, velocity.y)
        if speed < 1e-3:
            return STILL
        alpha = wrap_to_pi(math.atan2(velocity.y, velocity.x) - state.theta)
        omega = min(max(_HEADING_GAIN * alpha, -ROBOT.omega_max), ROBOT.omega_max)
        return Twist2(speed * max(0.0, math.cos(alpha)), omega)


class BarrierCertificates(Method):
    """The classical barrier, with a bare daqp solve.

    Args:
        case: the robots' goals, the walls.
        law: the barrier.
    """

    def __init__(self, case: Case, law: Barrier = BARRIER) -> None:
        self._case = case
        self._law = law

    def step(self, robot: int, t: float, state: State, desired: Twist2, snapshot: Snapshot | None) -> Twist2:
        if snapshot is None:
            return STILL
        if self._case.walls:
            desired = DESIRED.twist(Pose2(state.x, state.y, state.theta), *way(self._case, robot, state))
        others = [
            (State(other.x, other.y, other.theta, other.v, other.omega), ROBOT.radius)
            for i, other in enumerate(snapshot.robots)
            if i != robot
        ]
        law = self._law
        rows = law.rows(state, BODY, others, self._case.arena)
        x, y = law.point(state)
        for wall in self._case.walls:
            wall_x, wall_y = wall.nearest(x, y)
            away = max(math.hypot(wall_x - x, wall_y - y), 1e-3)
            rows.append(law.wall((wall_x - x) / away, (wall_y - y) / away, away, BODY))
        return law.twist_for(state, *solve_with_daqp(rows, *law.velocity(state, desired)))


_EYE = np.eye(2)


def solve_with_daqp(rows: Sequence[Row], vx: float, vy: float) -> tuple[float, float]:
    """The velocity that satisfies all rows and is nearest to a preferred one, by daqp.

    Where none does (the flag says so; the solution then means nothing), robots are too close already: it is enough that
    they approach no further, which standing still always satisfies.
    """
    table = np.array(rows)
    normals, bounds = np.ascontiguousarray(table[:, :2]), np.ascontiguousarray(table[:, 2])
    for upper in (bounds, np.maximum(bounds, 0.0)):
        solution, _, flag, _ = daqp.solve(_EYE, np.array((-vx, -vy)), normals, upper)
        if flag == 1:
            return float(solution[0]), float(solution[1])
    return 0.0, 0.0


def way(case: Case, robot: int, state: State) -> tuple[float, float]:
    """Where a robot should head: its goal, or through the doorway when that is between them."""
    x, y = case.goals[robot]
    if not case.walls or (x * state.x > 0.0 and abs(state.x) > 2.0 * ROBOT.radius):
        return float(x), float(y)
    side = math.copysign(1.0, x)
    near = abs(state.y) < 0.5 * DOOR - ROBOT.radius
    return (side * 0.6, 0.0) if near else (-side * 0.5, 0.0)


METHODS: dict[str, Callable[[Case], Method]] = {
    "ours": Ours,
    "orca": Orca,
    "barrier": BarrierCertificates,
    "none": NoFilter,
}
