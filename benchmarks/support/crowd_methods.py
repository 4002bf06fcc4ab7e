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

from benchmarks.support.crowd import CRUISE, DESIRED, DOOR, OPEN, PERIOD, ROBOT, Case, Method, nearest_on_walls
from muro_zenoh.behaviours.interface import Snapshot
from muro_zenoh.control.point_forward import steer_to_angle
from muro_zenoh.geometry import STILL, Pose2, State, Twist2
from muro_zenoh.safety.barrier import Barrier, filter_twist
from muro_zenoh.safety.half_planes import HalfPlane
from muro_zenoh.safety.separation import Body, Separation, SeparationSettings

BODY = Body(ROBOT.radius, ROBOT.v_max, ROBOT.omega_max, ROBOT.a_max, ROBOT.alpha_max, ROBOT.brake, ROBOT.lag)
_INFLATION = 0.05
_HORIZON = 5.0
_RANGE = 3.0
_AHEAD = 0.15
SETTINGS = SeparationSettings()


class Ours:
    """The separation filter, one for each robot.

    Args:
        case: the robots' goals, the walls.
        settings: of the filter.
    """

    def __init__(self, case: Case, settings: SeparationSettings = SETTINGS) -> None:
        names = [f"r{i}" for i in range(len(case.starts))]
        walls = [(x, y, end_x, end_y) for x, y, end_x, end_y in case.walls.tolist()]
        self._goals = [(x, y) for x, y in case.goals.tolist()]
        self.filters = [
            Separation(me, BODY, {name: BODY for name in names if name != me}, case.arena, settings, walls)
            for me in names
        ]

    def step(self, robot: int, t: float, state: State, desired: Twist2, snapshot: Snapshot | None) -> Twist2:
        return self.filters[robot].step(t, state, desired, snapshot, self._goals[robot]).twist


class Orca:
    """Optimal reciprocal collision avoidance (RVO2), followed by point-forward steering.

    Each robot has a simulator of its own, with what it sees: ORCA chooses a velocity, the unicycle follows it.

    Args:
        case: the robots' goals, the walls.
    """

    def __init__(self, case: Case) -> None:
        self._case = case
        self._robots = len(case.starts)
        self._simulators = [self._simulator() for _ in case.starts]

    def _simulator(self) -> Any:
        radius = ROBOT.radius + _INFLATION
        simulator = pyrvo.RVOSimulator()
        simulator.set_time_step(PERIOD)
        simulator.set_agent_defaults(_RANGE, self._robots, _HORIZON, 1.0, radius, CRUISE)
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
        for x, y, end_x, end_y in self._case.walls.tolist():
            simulator.add_obstacle([(x, y), (end_x, end_y)])
        simulator.process_obstacles()
        return simulator

    def step(self, robot: int, t: float, state: State, desired: Twist2, snapshot: Snapshot | None) -> Twist2:
        if snapshot is None:
            return STILL
        simulator = self._simulators[robot]
        for i, other in enumerate(snapshot.robots[: self._robots]):
            seen = state if i == robot else other
            simulator.set_agent_position(i, (seen.x, seen.y))
            simulator.set_agent_velocity(i, (seen.v * math.cos(seen.theta), seen.v * math.sin(seen.theta)))
        x, y = way(self._case, robot, state)
        dx, dy = x - state.x, y - state.y
        distance = math.hypot(dx, dy)
        speed = min(CRUISE, distance) / max(distance, 1e-9)
        simulator.set_agent_pref_velocity(robot, (speed * dx, speed * dy))
        simulator.do_step()
        velocity = simulator.get_agent_velocity(robot)
        vx, vy = velocity.x, velocity.y
        speed = math.hypot(vx, vy)
        if speed < 1e-3:
            return STILL
        return Twist2(*steer_to_angle(state.theta, math.atan2(vy, vx), speed, _AHEAD, math.pi))


class BarrierCertificates:
    """The classical barrier, with a bare daqp solve.

    Args:
        case: the robots' goals, the walls.
    """

    def __init__(self, case: Case) -> None:
        self._case = case
        self._law = Barrier()

    def step(self, robot: int, t: float, state: State, desired: Twist2, snapshot: Snapshot | None) -> Twist2:
        if snapshot is None:
            return STILL
        if len(self._case.walls):
            desired = DESIRED.twist(Pose2(state.x, state.y, state.theta), *way(self._case, robot, state))
        others = [
            (State(other.x, other.y, other.theta, other.v, other.omega), ROBOT.radius)
            for i, other in enumerate(snapshot.robots)
            if i != robot
        ]
        rows = self._law.rows(state, ROBOT.radius, others, self._case.arena, ROBOT.v_max, ROBOT.omega_max)
        x, y = self._law.point(state)
        for wall_x, wall_y in zip(*nearest_on_walls(self._case.walls, x, y), strict=True):
            distance = max(math.hypot(wall_x - x, wall_y - y), 1e-3)
            room = self._law.wall_gain * (distance - ROBOT.radius) ** 3
            rows.append(HalfPlane((wall_x - x) / distance, (wall_y - y) / distance, room))
        return filter_twist(desired, state, self._law.ahead, rows, solve_daqp)


_EYE = np.eye(2)


def solve_daqp(x: float, y: float, rows: Sequence[HalfPlane]) -> tuple[float, float] | None:
    """The point nearest to (x, y) in all half-planes, by daqp; None when it reports none."""
    table = np.array(rows)
    count = len(table)
    solution, _, flag, _ = daqp.solve(
        _EYE,
        np.array((-x, -y)),
        np.ascontiguousarray(table[:, :2]),
        np.ascontiguousarray(table[:, 2]),
        np.full(count, -1e30),
        np.zeros(count, dtype=np.int32),
    )
    return (float(solution[0]), float(solution[1])) if flag == 1 else None


def way(case: Case, robot: int, state: State) -> tuple[float, float]:
    """Where a robot should head: its goal, or through the doorway when that is between them."""
    x, y = case.goals[robot]
    if not len(case.walls) or (x * state.x > 0.0 and abs(state.x) > 2.0 * ROBOT.radius):
        return float(x), float(y)
    side = math.copysign(1.0, x)
    near = abs(state.y) < 0.5 * DOOR - ROBOT.radius
    return (side * 0.6, 0.0) if near else (-side * 0.5, 0.0)


METHODS: dict[str, Callable[[Case], Method]] = {"ours": Ours, "orca": Orca, "barrier": BarrierCertificates}
