"""Real agents that drive to goals, on the in-memory bus in virtual time."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable

from muro_zenoh import channels
from muro_zenoh.behaviours.interface import Deployment
from muro_zenoh.messages import Goal, PlannedPath, Reply, SetBehaviour, Stop
from muro_zenoh.scoring.deployment import score_deployment
from muro_zenoh.scoring.observed import Body
from muro_zenoh.transport import Bus
from tests.support.memory_fleet import MemoryFleet, memory_fleet, scenario
from tests.support.virtual import virtual


def distance(fleet: MemoryFleet, x: float, y: float, robot: int = 0) -> float:
    """True distance of a robot from a position [m]."""
    return math.hypot(fleet.plant.pose[robot, 0] - x, fleet.plant.pose[robot, 1] - y)


def stands_at(fleet: MemoryFleet, x: float, y: float) -> Callable[[], bool]:
    """Whether the first robot is stationary at a position."""
    return lambda: distance(fleet, x, y) < 0.05 and abs(fleet.plant.twist[0]).max() < 0.01


async def order(operator: Bus, goal: Goal) -> Reply:
    """The robot's answer to a goal."""
    return await operator.ask(channels.GOAL_ORDER, goal, name="r1")


@virtual
async def test_an_operators_goals_are_answered_reached_and_replaced() -> None:
    async with memory_fleet(scenario(1, "dubins")) as fleet:
        operator = await fleet.bus()
        paths = operator.every(channels.PATH, "r1")
        await fleet.until(lambda: fleet.holds("r1", "no goal"), 3, "it waits for a goal")
        assert (await order(operator, Goal(x=0.8, y=0.5, theta=1.0))).accepted
        await fleet.until(lambda: bool(fleet.driving), 1, "it drives")
        await asyncio.sleep(1.0)
        # The goal is replaced; then one is refused, and the robot drives on.
        assert (await order(operator, Goal(x=-0.6, y=-0.4, theta=-2.0))).accepted
        refusal = await order(operator, Goal(x=-0.6, y=-1.4))
        assert not refusal.accepted
        assert "outside the arena" in refusal.reason
        # It would have to come out of the corner.
        refusal = await order(operator, Goal(x=1.9, y=1.3, theta=-2.4))
        assert not refusal.accepted
        assert "leaves the arena" in refusal.reason
        await fleet.until(stands_at(fleet, -0.6, -0.4), 40, "it is at the goal that moved")
        await fleet.until(lambda: fleet.holds("r1", "all goals reached"), 2, "and reports it")
        assert abs(math.remainder(fleet.plant.pose[0, 2] + 2.0, math.tau)) < 0.17
        shown: list[PlannedPath] = [received.message for received in paths.drain()]
        assert shown.pop().segments == (), "it has arrived"
        assert len(shown) >= 2
        assert shown[-1].goal_theta


@virtual
async def test_a_stopped_robot_accepts_a_goal_and_says_that_it_is_stopped() -> None:
    async with memory_fleet(scenario(1, "dubins")) as fleet:
        operator = await fleet.bus()
        await fleet.until(lambda: fleet.holds("r1", "no goal"), 3, "it waits for a goal")
        assert (await order(operator, Goal(x=0.8, y=0.5))).reason == ""
        await fleet.order(channels.STOP_ORDER, Stop(names=("r1",)))
        await fleet.until(lambda: fleet.holds("r1", "stopped by order"), 2, "it is stopped")
        answer = await order(operator, Goal(x=0.8, y=-0.5))
        assert (answer.accepted, answer.reason) == (True, "stopped by order")
        refusal = await order(operator, Goal(x=9.0, y=0.0))
        assert (refusal.accepted, "arena" in refusal.reason) == (False, True)


@virtual
async def test_a_goal_that_becomes_the_current_one_again_changes_nothing() -> None:
    async with memory_fleet(scenario(1, "dubins")) as fleet:
        operator = await fleet.bus()
        paths = operator.every(channels.PATH, "r1")
        await fleet.until(lambda: fleet.holds("r1", "no goal"), 3, "it waits for a goal")
        goal, began = Goal(x=0.8, y=0.5, theta=1.0), asyncio.get_running_loop().time()
        assert (await order(operator, goal)).accepted
        assert asyncio.get_running_loop().time() - began < 0.3, "it waits for nothing that is there already"
        await asyncio.sleep(1.0)
        assert (await order(operator, goal)).accepted
        await asyncio.sleep(1.0)
        assert len(paths.drain()) == 1  # it drives on along the path that it has


@virtual
async def test_a_behaviour_without_goals_refuses_them_and_so_does_a_robot_without_a_pose() -> None:
    async with memory_fleet(scenario(1, "circle"), agents=False) as fleet:
        operator = await fleet.bus()
        fleet.seeing = False
        await fleet.start_agent("r1")
        await asyncio.sleep(1.0)
        refusal = await order(operator, Goal(x=0.5, y=0.0))
        assert (refusal.accepted, refusal.reason) == (False, "r1 has no pose yet, so it cannot plan")
        fleet.seeing = True
        await fleet.until(lambda: bool(fleet.driving), 3, "it drives")
        refusal = await order(operator, Goal(x=0.5, y=0.0))
        assert (refusal.accepted, refusal.reason) == (False, "the behaviour circle takes no goals")
        await fleet.order(channels.SET_BEHAVIOUR, SetBehaviour(behaviour="steer"))
        await fleet.until(lambda: fleet.holds("r1", "no goal"), 3, "it waits for a goal")
        refusal = await order(operator, Goal(x=5.0, y=0.0))
        assert "outside the arena" in refusal.reason
        assert (await order(operator, Goal(x=0.5, y=0.0))).accepted
        await fleet.until(stands_at(fleet, 0.5, 0.0), 30, "it is at the goal")


@virtual
async def test_a_robot_that_is_carried_away_plans_again() -> None:
    async with memory_fleet(scenario(1, "dubins", goals=((1.2, 0.7),))) as fleet:
        await fleet.until(lambda: bool(fleet.driving), 3, "it drives")
        await asyncio.sleep(1.0)
        fleet.plant.place(0, -1.0, -0.6, 0.5)
        await fleet.until(stands_at(fleet, 1.2, 0.7), 60, "it is at the goal")


@virtual
async def test_an_unreachable_goal_of_the_list_is_reported_and_skipped() -> None:
    goals = ((1.9, 1.3, -2.4), (0.5, 0.3))
    async with memory_fleet(scenario(1, "dubins", goals=goals, pause=1.0)) as fleet:
        await fleet.until(lambda: fleet.holds("r1", "goal (1.9, 1.3) given up: path from"), 3, "it reports the reason")
        await fleet.until(stands_at(fleet, 0.5, 0.3), 60, "it is at the next")


@virtual
async def test_a_robot_that_faces_a_wall_gets_away() -> None:
    async with memory_fleet(scenario(1, "dubins", goals=((0.0, 0.3),)), agents=False) as fleet:
        fleet.plant.place(0, 1.9, 0.0, 0.1)
        await fleet.start_agent("r1")
        await fleet.until(stands_at(fleet, 0.0, 0.3), 60, "it is at the goal")
        assert fleet.plant.pose[0, 0] < 0.1


@virtual
async def test_steer_drives_to_its_goals_in_order_and_pauses() -> None:
    goals = ((0.9, 0.5), (-0.8, 0.2))
    async with memory_fleet(scenario(1, "steer", goals=goals, pause=1.0)) as fleet:
        await fleet.until(stands_at(fleet, 0.9, 0.5), 30, "the first")
        await fleet.until(lambda: fleet.holds("r1", "at goal 1, pausing"), 2, "it waits")
        await fleet.until(stands_at(fleet, -0.8, 0.2), 30, "the second")
        await fleet.until(lambda: fleet.holds("r1", "all goals reached"), 2, "all")


@virtual
async def test_coverage_ends_at_the_centroids_in_common_rounds() -> None:
    lab = scenario(4, "coverage", hold_time=1.0, stay_within=0.025, turning_radius=0.1, v_min=0.1)
    async with memory_fleet(lab, seed=2) as fleet:
        watcher = await fleet.bus()
        paths = watcher.every(channels.PATH, "*", depth=1000)
        seen: list[tuple[float, dict[str, Body]]] = []
        for k in range(1200):
            await asyncio.sleep(0.1)
            rows = zip(lab.robots, fleet.plant.pose.tolist(), fleet.plant.twist.tolist(), strict=True)
            seen.append((k / 10, {name: Body(*pose, *twist) for name, pose, twist in rows}))
        found = score_deployment(Deployment(lab.arena, None, 1.0), seen, 4)
        assert found.rounds > 3
        assert found.distance is not None
        assert found.distance <= 0.03
        assert found.gain is not None
        assert found.gain < 0.02
        assert found.rise is not None
        assert found.rise <= 0.02
        # A round begins with the same snapshot for all robots that move.
        times = sorted(received.message.stamp for received in paths.drain() if received.message.segments)
        begun = [times[0]]
        for t in times:
            assert t - begun[-1] < 0.02 or t - begun[-1] > 1.0
            if t - begun[-1] > 1.0:
                begun.append(t)
        assert len(begun) >= found.rounds - 2
