"""``muro goal``: what it prints for each answer, and for none."""

from __future__ import annotations

from typing import Any

import pytest
from muro_zenoh.cli.goal_order import send_goal

from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.errors import NoReply
from muro_zenoh.messages import Behaviour, Goal, Health, Reply
from muro_zenoh.transport import Bus, MemoryNetwork, make_bus
from tests.support.virtual_time import VirtualClock, run_virtually


def ordering(serve: Any) -> int:
    """The exit code of a goal to r1, on a network with what ``serve`` does."""

    async def main() -> int:
        network, clock = MemoryNetwork(), VirtualClock()
        async with (
            make_bus(network.link(), roles=[Role.AGENT, Role.BASESTATION], clock=clock) as other,
            make_bus(network.link(), roles=[Role.OPERATOR], clock=clock) as bus,
        ):
            serve(other)
            return await send_goal(bus, "r1", 0.5, -0.25, None)

    return run_virtually(main())


def test_a_goal_is_accepted(capsys: pytest.CaptureFixture[str]) -> None:
    goals: list[Goal] = []

    def serve(bus: Bus) -> None:
        bus.announce(Role.AGENT, "r1")
        bus.answer(channels.GOAL_ORDER, lambda goal: goals.append(goal) or Reply(accepted=True), name="r1")  # type: ignore[func-returns-value]

    assert ordering(serve) == 0
    assert [(goal.x, goal.y, goal.theta) for goal in goals] == [(0.5, -0.25, None)]
    assert capsys.readouterr().out == "r1: accepted\n"


def test_a_goal_is_refused_with_the_reason(capsys: pytest.CaptureFixture[str]) -> None:
    def serve(bus: Bus) -> None:
        bus.announce(Role.AGENT, "r1")
        bus.answer(channels.GOAL_ORDER, lambda goal: Reply(accepted=False, reason="outside the arena"), name="r1")

    assert ordering(serve) == 1
    assert capsys.readouterr().out == "r1: refused: outside the arena\n"


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
        match=r"goal/r1: nobody.*It is alive, runs the behaviour steer and stands still \(no fix, stop",
    ):
        ordering(serve)


def test_a_robot_that_says_nothing_at_all_is_said_to() -> None:
    with pytest.raises(NoReply, match="It is alive, has no behaviour yet and says nothing of its health"):
        ordering(lambda bus: bus.announce(Role.AGENT, "r1"))
