"""The goals of a robot: a list of its own, an operator's orders, and their answers."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from dataclasses import dataclass

import pytest
import pytest_asyncio

from agents.robot import Robot
from agents.tasks.drive import Drive
from agents.tasks.goals import GoalParameters, Goals
from agents.tasks.localize import Localize
from muro_zenoh import channels
from muro_zenoh.config import parse_scenario
from muro_zenoh.errors import ConfigError
from muro_zenoh.messages import Ack, Goal
from muro_zenoh.transport import MemoryNetwork, make_bus
from muro_zenoh.transport.bus import Publisher
from muro_zenoh.transport.mailboxes import Every
from tests.support.clock import ManualClock
from tests.support.waiting import within

ROOM = parse_scenario({"robots": 1}, "lab.toml", name="lab")


@dataclass
class Lab:
    """A robot and an operator."""

    robot: Robot
    clock: ManualClock
    out: Publisher[Goal]
    answers: Every[Ack]

    async def order(self, goals: Goals, goal: Goal) -> tuple[bool, Ack]:
        """What ``look`` says of an order, and its answer; a goal that can be gone to is."""
        sent = self.out.put(goal)
        new = False
        for _ in range(50):
            if goals.look():
                new = True
                goals.set_out()
            answers = self.answers.drain()
            if answers:
                ack = answers[0].message
                assert (ack.channel, ack.order_epoch, ack.order_seq) == ("goal", sent.epoch, sent.seq)
                return new, ack
            await asyncio.sleep(0)
        raise AssertionError("no answer")


@pytest_asyncio.fixture
async def lab() -> AsyncIterator[Lab]:
    network, clock = MemoryNetwork(), ManualClock()
    async with make_bus(network.link(), clock=clock) as bus, make_bus(network.link(), clock=clock) as operator:
        settings = ROOM.robot["r1"]
        localize = Localize(bus, "r1", settings, {})
        robot = Robot(bus, "r1", ROOM, localize, Drive(bus, "r1", settings, localize))
        yield Lab(robot, clock, operator.publisher(channels.GOAL, "r1"), operator.every(channels.ACK, "r1"))


def at(goals: Goals) -> tuple[float, float, float | None] | None:
    return (goals.current.x, goals.current.y, goals.current.theta) if goals.current is not None else None


def test_the_list_is_gone_to_one_after_the_other(lab: Lab) -> None:
    goals = Goals(lab.robot, GoalParameters(goals=((1.0, 0.5), (-1.0, 0.0, 1.57)), pause=2.0))
    assert goals.look()
    assert at(goals) == (1.0, 0.5, None)
    assert not goals.look()  # the same one
    goals.arrived()
    assert goals.waiting == "at goal 1, waiting before the next"
    assert not goals.look()
    lab.clock.advance(1.9)
    assert not goals.look()
    lab.clock.advance(0.2)
    assert goals.look()
    assert at(goals) == (-1.0, 0.0, 1.57)
    goals.arrived()
    lab.clock.advance(10.0)
    assert not goals.look()
    assert (goals.reached, goals.waiting) == (2, "all goals reached")


def test_without_goals_there_is_nothing_to_do(lab: Lab) -> None:
    goals = Goals(lab.robot, GoalParameters())
    assert not goals.look()
    assert (at(goals), goals.waiting) == (None, "no goal")


@pytest.mark.parametrize("row", [(1.0,), (1.0, 2.0, 3.0, 4.0), ()])
def test_a_row_that_is_no_goal_is_named(lab: Lab, row: tuple[float, ...]) -> None:
    with pytest.raises(ConfigError, match=r"behaviour\.goals\[1\]: got . numbers, expected x, y or x, y, theta"):
        Goals(lab.robot, GoalParameters(goals=((0.0, 0.0), row)))


async def test_an_order_replaces_the_goal_and_ends_the_list(lab: Lab) -> None:
    goals = Goals(lab.robot, GoalParameters(goals=((1.0, 0.5), (-1.0, 0.0)), pause=0.0))
    goals.look()
    new, ack = await lab.order(goals, Goal(x=0.3, y=-0.4, theta=0.1))
    assert new
    assert ack.accepted
    assert at(goals) == (0.3, -0.4, 0.1)
    goals.arrived()
    assert not goals.look()


@pytest.mark.parametrize("place", [(2.0, 0.0), (0.0, -1.4), (50.0, 0.0), (1e308, -1e308)])
async def test_an_order_outside_the_arena_is_refused_and_the_goal_stays(lab: Lab, place: tuple[float, float]) -> None:
    goals = Goals(lab.robot, GoalParameters(goals=((1.0, 0.5),)))
    goals.look()
    new, ack = await lab.order(goals, Goal(x=place[0], y=place[1]))
    assert not new
    assert not ack.accepted
    assert "arena" in ack.reason
    assert at(goals) == (1.0, 0.5, None)


async def taken(goals: Goals) -> bool:
    """Whether an order that is under way is taken as a new goal."""
    for _ in range(10):
        if goals.look():
            return True
        await asyncio.sleep(0)
    return False


async def test_a_goal_that_cannot_be_reached_is_refused_and_the_one_before_goes_on(lab: Lab) -> None:
    goals = Goals(lab.robot, GoalParameters(goals=((1.0, 0.5), (-1.0, 0.0)), pause=0.0))
    goals.look()
    goals.set_out()
    sent = lab.out.put(Goal(x=0.3, y=-0.4))
    assert await taken(goals)
    goals.give_up("no path keeps inside the arena")
    refusal = (await within(1, lab.answers.next(), "the refusal")).message
    assert (refusal.order_seq, refusal.accepted) == (sent.seq, False)
    assert refusal.reason == "no path keeps inside the arena"
    assert at(goals) == (1.0, 0.5, None)
    goals.arrived()
    assert goals.look()
    assert at(goals) == (-1.0, 0.0, None)


async def test_a_goal_that_becomes_unreachable_is_answered_a_second_time(lab: Lab) -> None:
    goals = Goals(lab.robot, GoalParameters())
    _, ack = await lab.order(goals, Goal(x=0.3, y=-0.4))
    assert ack.accepted
    goals.give_up("a wall has moved")
    refusal = (await within(1, lab.answers.next(), "the refusal")).message
    assert (refusal.order_seq, refusal.accepted) == (ack.order_seq, False)
    assert at(goals) is None
    assert goals.waiting == "goal (0.3, -0.4) given up: a wall has moved"


async def test_a_goal_of_the_list_that_is_given_up_is_said_and_the_next_is_gone_to(lab: Lab) -> None:
    goals = Goals(lab.robot, GoalParameters(goals=((1.0, 0.5), (-1.0, 0.0)), pause=2.0))
    goals.look()
    goals.give_up("no way")
    assert goals.waiting == "goal (1, 0.5) given up: no way"
    assert not goals.look()
    lab.clock.advance(2.1)
    assert goals.look()
    goals.arrived()
    assert (goals.reached, goals.waiting) == (1, "all goals reached")


async def test_a_goal_said_again_is_answered_and_is_no_new_one(lab: Lab) -> None:
    goals = Goals(lab.robot, GoalParameters())
    new, _ = await lab.order(goals, Goal(x=0.3, y=-0.4))
    assert new
    new, ack = await lab.order(goals, Goal(x=0.3, y=-0.4))
    assert (new, ack.accepted) == (False, True)


async def test_of_two_goals_at_once_the_newer_counts_and_both_are_answered(lab: Lab) -> None:
    goals = Goals(lab.robot, GoalParameters())
    first, second = lab.out.put(Goal(x=0.3, y=-0.4)), lab.out.put(Goal(x=-0.3, y=0.4))
    assert await taken(goals)
    goals.set_out()
    assert at(goals) == (-0.3, 0.4, None)
    answers = [(await within(1, lab.answers.next(), "an answer")).message for _ in range(2)]
    assert [(a.order_seq, a.accepted) for a in answers] == [(first.seq, False), (second.seq, True)]


async def test_who_is_there_already_accepts_the_goal(lab: Lab) -> None:
    goals = Goals(lab.robot, GoalParameters(), idle="at rest")
    assert goals.waiting == "at rest"
    lab.out.put(Goal(x=0.3, y=-0.4))
    assert await taken(goals)
    goals.arrived()
    assert (await within(1, lab.answers.next(), "the answer")).message.accepted
