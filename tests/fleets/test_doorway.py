"""Whole fleets on a floor with walls: the built-in scenario ``doorway``, and what an operator may not order there."""

from __future__ import annotations

import asyncio

import numpy as np
import pytest

from agents.simulator import Room
from muro_zenoh import channels
from muro_zenoh.checking.trial import run_trial
from muro_zenoh.config import find_scenario, parse_scenario
from muro_zenoh.messages import Goal, SetBehaviour, SetCircle
from muro_zenoh.runtime.virtual_time import InlineExecutor, VirtualClock
from muro_zenoh.transport import MemoryNetwork, make_bus
from tests.support.memory_fleet import memory_fleet
from tests.support.virtual import virtual

WALLS = [{"start": [0.0, -1.5], "end": [0.0, -0.4]}, {"start": [0.0, 0.4], "end": [0.0, 1.5]}]


@pytest.mark.slow
def test_robots_swap_sides_through_the_doorway_and_touch_neither_each_other_nor_a_wall() -> None:
    doorway = find_scenario("doorway", overrides={"duration": 60.0})
    record, result = run_trial(doorway, 1)
    assert not result.breaches
    goals = np.array([doorway.goals[name][-1] for name in doorway.robots])
    assert np.hypot(*(record.pose[-1, :, :2] - goals).T).max() < 0.05
    assert (np.sign(record.pose[0, :, 0]) == -np.sign(record.pose[-1, :, 0])).all()


@virtual
async def test_what_walls_forbid_is_refused_with_the_reason() -> None:
    lab = {"robots": 1, "wall": WALLS, "starts": {"r1": [-1.3, 0.8, 0.0]}, "behaviour": {"name": "dubins"}}
    async with memory_fleet(parse_scenario(lab, "lab.toml", name="lab")) as fleet:
        await fleet.until(lambda: fleet.holds("r1", "no goal"), 3, "it waits for a goal")
        operator = await fleet.bus()
        for goal, reason in (
            (Goal(x=0.1, y=0.8), "0.100 m from the wall from (0, 0.4) to (0, 1.5)"),
            (Goal(x=1.3, y=0.8), "crosses the wall from (0, 0.4) to (0, 1.5)"),
        ):
            reply = await operator.ask(channels.GOAL_ORDER, goal, name="r1")
            assert not reply.accepted
            assert reason in reply.reason
        for behaviour in ("steer", "dubins"):
            await fleet.order(channels.SET_BEHAVIOUR, SetBehaviour(behaviour=behaviour))
            await fleet.until(lambda: fleet.holds("r1", "no goal"), 3, "it waits for a goal")
            reply = await operator.ask(channels.GOAL_ORDER, Goal(x=0.1, y=0.8), name="r1")
            assert "0.100 m from the wall" in reply.reason, behaviour
        for order, reason in (
            (SetBehaviour(behaviour="coverage"), "Voronoi cells go through walls"),
            (SetBehaviour(behaviour="circle"), "0.8 m around (0, 0), 0.000 m from the wall"),
        ):
            assert reason in await fleet.refusal(channels.SET_BEHAVIOUR, order)
        circle = SetCircle(x=-1.0, y=0.0, radius=0.9)
        assert "0.177 m from the wall from (0, -1.5)" in await fleet.refusal(channels.SET_CIRCLE, circle)
        reply = await operator.ask(channels.GOAL_ORDER, Goal(x=-0.6, y=0.0, theta=0.0), name="r1")
        assert reply.accepted, reply.reason


@virtual
async def test_the_simulator_reports_contacts_with_walls() -> None:
    lab = {"robots": 1, "wall": WALLS, "starts": {"r1": [-1.3, 0.8, 0.0]}}
    network = MemoryNetwork()
    async with make_bus(network.link(), clock=VirtualClock()) as bus, make_bus(network.link()) as observer:
        room = Room(bus, parse_scenario(lab, "lab.toml", name="lab"), 1, InlineExecutor())
        health = observer.every(channels.HEALTH, "simulator")
        running = asyncio.create_task(room.run())
        try:
            await asyncio.sleep(1.5)
            room.plant.place(0, 0.1, 0.8, 0.0)
            await asyncio.sleep(1.5)
        finally:
            running.cancel()
            await asyncio.wait({running})
        counts = [received.message.numbers["wall_contacts"] for received in health.drain()]
        assert (counts[0], counts[-1]) == (0.0, 1.0)
