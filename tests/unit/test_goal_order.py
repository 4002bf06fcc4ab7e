"""A goal ordered from a robot: its answer, or why there is none."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

import pytest

from agents.tasks.control import Signals
from agents.tasks.orders import answer_goals
from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.errors import NoReply
from muro_zenoh.messages import Behaviour, Goal, Health, Reply
from muro_zenoh.orders.goal import send_goal
from muro_zenoh.runtime.virtual_time import VirtualClock, run_virtually
from muro_zenoh.transport import Bus, MemoryNetwork, make_bus


def ordering(serve: Any) -> Reply:
    """The answer to a goal of r1, on a network with what ``serve`` does."""

    async def main() -> Reply:
        network, clock = MemoryNetwork(), VirtualClock()
        async with (
            make_bus(network.link(), roles=[Role.AGENT, Role.BASESTATION], clock=clock) as other,
            make_bus(network.link(), roles=[Role.OPERATOR], clock=clock) as bus,
        ):
            serve(other)
            return await send_goal(bus, "r1", Goal(x=0.5, y=-0.25))

    return run_virtually(main())


def test_a_goal_is_accepted() -> None:
    goals: list[Goal] = []

    def serve(bus: Bus) -> None:
        bus.announce(Role.AGENT, "r1")
        bus.answer(channels.GOAL_ORDER, lambda goal: goals.append(goal) or Reply(accepted=True), name="r1")  # type: ignore[func-returns-value]

    assert ordering(serve).accepted
    assert [(goal.x, goal.y, goal.theta) for goal in goals] == [(0.5, -0.25, None)]


def test_a_goal_is_refused_with_the_reason() -> None:
    def serve(bus: Bus) -> None:
        bus.announce(Role.AGENT, "r1")
        bus.answer(channels.GOAL_ORDER, lambda goal: Reply(accepted=False, reason="outside the arena"), name="r1")

    reply = ordering(serve)
    assert (reply.accepted, reply.reason) == (False, "outside the arena")


def test_a_robot_that_is_not_alive_is_named_with_those_that_are() -> None:
    with pytest.raises(NoReply, match="r1 is not alive; the robots that are: r2, r3"):
        ordering(lambda bus: (bus.announce(Role.AGENT, "r3"), bus.announce(Role.AGENT, "r2")))


def test_a_robot_that_does_not_answer_is_said_with_what_it_runs() -> None:
    def serve(bus: Bus) -> None:
        bus.announce(Role.AGENT, "r1")
        bus.publisher(channels.BEHAVIOUR, "r1").put(Behaviour(behaviour="steer"))
        bus.publisher(channels.HEALTH, "r1").put(Health(role="agent", state="holding", reasons=("no fix", "stopped")))

    with pytest.raises(
        NoReply,
        match=r"goal/r1: nobody answered.*r1 is alive, runs the behaviour steer and stands still \(no fix, stopped\)",
    ):
        ordering(serve)


def test_a_robot_that_says_nothing_at_all_is_said_to() -> None:
    with pytest.raises(NoReply, match="r1 is alive, has no behaviour yet"):
        ordering(lambda bus: bus.announce(Role.AGENT, "r1"))


def test_a_goal_waits_for_the_first_pose_and_the_first_behaviour_of_an_agent_that_has_just_started() -> None:
    def serve(bus: Bus) -> None:
        bus.announce(Role.AGENT, "r1")
        runner, signals = SimpleNamespace(begun=asyncio.Event()), Signals()
        runner.go_to = lambda goal, seen: "" if runner.begun.is_set() else "no behaviour yet"
        loop = SimpleNamespace(seen="a pose", latch=SimpleNamespace(reason=""))
        master = SimpleNamespace(refusal=lambda goal: "")
        answer_goals(bus, "r1", loop, runner, master, signals)  # type: ignore[arg-type]
        asyncio.get_running_loop().call_later(0.2, signals.located.set)
        asyncio.get_running_loop().call_later(0.4, runner.begun.set)

    assert ordering(serve).accepted
