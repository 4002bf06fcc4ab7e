"""The agent's control loop and the lock-step rollout, driven through one sequence of inputs, command the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from agents.control_loop import ControlLoop, Surroundings
from muro_zenoh import channels
from muro_zenoh.behaviours import table
from muro_zenoh.behaviours.interface import Behaviour, BehaviourKind, Seen
from muro_zenoh.config import RobotSettings, Scenario, make_behaviour, parse_scenario
from muro_zenoh.geometry import STILL, Circle, State, Twist2
from muro_zenoh.messages import PoseFix, StopOrder
from muro_zenoh.simulation.rollout.behave import rows_of, snapshot_of
from muro_zenoh.simulation.rollout.fleet import Fleet
from muro_zenoh.simulation.rollout.settings import NOISY

CIRCLE = Circle(0.1, -0.1, 0.7, clockwise=True)
LOOP = replace(NOISY, omega_max=1.5)
T0 = 1000.0
"""The agent's clock when the rollout's is 0 [s]."""

GOALS = ((0.9, 0.5, 1.0), (-0.8, 0.2))


def lab(behaviour: str) -> Scenario:
    table_ = {"robots": 3, "behaviour": {"name": behaviour}}
    return parse_scenario(table_, "lab.toml", name="lab")


def behaviour_of(scenario: Scenario, name: str) -> Behaviour:
    kind = table.find(scenario.behaviour.name)
    assert isinstance(kind, BehaviourKind)
    goals = {"goals": GOALS} if kind.parameters.__dataclass_fields__.keys() & {"targets"} else {}
    return make_behaviour(kind, goals, scenario.vehicle(name), "test")


class Agent:
    """A control loop that is fed with what one robot of a rollout measures."""

    def __init__(self, robot: RobotSettings, name: str, behaviour: Behaviour) -> None:
        self.loop = ControlLoop(name, robot)
        self.loop.take_stop(T0 - 1.0, StopOrder(all=False, revision=1))
        self.loop.behave(behaviour)
        self.odometry: list[tuple[float, float, float]] = [(T0, 0.0, 0.0)]
        self._fix: object = None

    def command(self, t: float, fleet: Fleet, row: int, around: Surroundings) -> tuple[float, float]:
        fixes = []
        z = fleet.newest_fix
        assert z is not None
        if z is not self._fix:
            self._fix = z
            place, heading = LOOP.fix_sigma**2, LOOP.fix_sigma_theta**2
            covariance = (place, 0.0, 0.0, 0.0, place, 0.0, 0.0, 0.0, heading)
            fix = PoseFix(
                x=float(z.x[row]), y=float(z.y[row]), theta=float(z.theta[row]), covariance=covariance, camera="c",
                age=LOOP.delay,
            )  # fmt: skip
            fixes = [(T0 + t - fleet.fix_age, fix)]
        odometry, self.odometry = self.odometry, []
        out = self.loop.update(T0 + t, fixes, odometry, around)
        (command,) = [message for channel, message in out if channel is channels.CMD_VEL]
        return command.v, command.omega


@pytest.mark.parametrize("name", [n for n in table.names() if n != table.DEFAULT])
def test_agent_and_rollout_give_the_same_commands(name: str) -> None:
    scenario = lab(name)
    names = scenario.robots
    rng = np.random.default_rng(5)
    starts = np.array([[0.9, 0.0, 1.0], [-0.6, 0.6, 2.5], [0.0, -1.0, 0.2]])
    fleet = Fleet(starts, LOOP, rng)
    behaviours = [behaviour_of(scenario, n) for n in names]
    agents = [Agent(scenario.robot[n], n, behaviour_of(scenario, n)) for n in names]
    worst = 0.0
    moved = False

    def policy(t: float, ahead: State) -> tuple[object, object]:
        nonlocal worst, moved
        states = rows_of(fleet.state())
        snapshot = snapshot_of(fleet, names, states)
        wanted = []
        assert fleet.filter is not None
        for k, (behaviour, now, then) in enumerate(zip(behaviours, states, rows_of(ahead), strict=True)):
            around = Surroundings(CIRCLE, snapshot=snapshot, snapshot_age=0.0, wish=Twist2(0.1, 0.2), wish_age=0.0)
            twist = behaviour.step(Seen(T0 + t, now, then, *around)).twist or STILL
            wanted.append(twist)
            v = min(max(twist.v / float(fleet.filter.mean.s_v[k]), -LOOP.v_max), LOOP.v_max)
            omega = min(max(twist.omega / float(fleet.filter.mean.s_omega[k]), -LOOP.omega_max), LOOP.omega_max)
            commanded = agents[k].command(t, fleet, k, around)
            worst = max(worst, abs(v - commanded[0]), abs(omega - commanded[1]))
            moved = moved or v > 0.05
        v_all, omega_all = np.array(wanted).T
        return v_all, omega_all

    def watch(t: float, pose: np.ndarray) -> None:
        for k, agent in enumerate(agents):
            v, omega = fleet.plant.odometry_twist[k].tolist()
            agent.odometry.append((T0 + t, v, omega))

    for _ in range(300):
        fleet.step(policy, watch)
    assert moved
    assert worst < 1e-6
