"""The keys of the live view: what they order, and that no pressing does harm. In virtual time, with a base station."""

from __future__ import annotations

import asyncio
import random

from muro_zenoh import channels
from muro_zenoh.cli.desk import Desk
from muro_zenoh.messages import StopOrder
from muro_zenoh.orders.stop import stop_robots
from tests.support.stop_lab import Agent, Lab, cut_off, virtual


class Operator:
    """Presses keys, and reads what is shown."""

    def __init__(self, there: Lab) -> None:
        self.shown: list[str] = []
        self.desk = Desk(there.operator, self.shown.append)

    async def press(self, keys: str, pause: float = 0.0) -> None:
        """Press keys one after the other, a pause after each [s]."""
        for key in keys:
            self.desk.press(key)
            await asyncio.sleep(pause)


def stopped(agents: dict[str, Agent]) -> set[str]:
    return {name for name, agent in agents.items() if agent.latch.stopped}


@virtual
async def test_the_space_bar_stops_everybody_at_once_and_shows_the_receipt(there: Lab) -> None:
    agents = await there.agents("r1", "r2")
    await there.base_station()
    operator = Operator(there)
    await operator.press(" ", 0.001)
    assert stopped(agents) == {"r1", "r2"}
    assert operator.shown == []
    await asyncio.sleep(1.0)
    (receipt,) = operator.shown
    assert receipt.splitlines()[-1] == "2 of 2 robots stopped"


@virtual
async def test_r_and_y_resume_everybody(there: Lab) -> None:
    agents = await there.agents("r1", "r2")
    await there.base_station()
    operator = Operator(there)
    await operator.press(" ", 1.0)
    await operator.press("r", 3.0)
    assert stopped(agents) == {"r1", "r2"}
    assert operator.shown[-1].startswith("resume every robot? Press y within 5 s")
    await operator.press("y", 1.0)
    assert stopped(agents) == set()
    assert operator.shown[-1].startswith("resume: base station: accepted, revision")


@virtual
async def test_nothing_but_y_within_5_s_after_r_resumes(there: Lab) -> None:
    agents = await there.agents("r1")
    await there.base_station()
    operator = Operator(there)
    await operator.press(" ", 1.0)
    for keys in ("y", "rxy", "r", "r\ny", "rY", "\x1b[A"):
        await operator.press(keys, 0.1)
        await operator.press("n", 0.5)
        assert stopped(agents) == {"r1"}, repr(keys)
    await operator.press("r", 5.1)
    await operator.press("y", 1.0)
    assert stopped(agents) == {"r1"}


@virtual
async def test_a_stop_that_somebody_else_gives_between_r_and_y_is_not_lifted(there: Lab) -> None:
    agents = await there.agents("r1")
    await there.base_station()
    operator = Operator(there)
    await operator.press(" ", 1.0)
    await operator.press("r", 0.5)
    await stop_robots(there.operator, ())
    await operator.press("y", 1.0)
    assert stopped(agents) == {"r1"}
    assert "refused" in operator.shown[-1]
    await operator.press("ry", 1.0)
    assert stopped(agents) == set()


@virtual
async def test_the_space_bar_between_r_and_y_stops(there: Lab) -> None:
    agents = await there.agents("r1")
    await there.base_station()
    operator = Operator(there)
    await operator.press(" ", 1.0)
    await operator.press("r y", 0.0)
    await asyncio.sleep(1.0)
    assert stopped(agents) == {"r1"}
    await operator.press("ry ", 0.0)  # ... and after both, a resume that is under way
    await asyncio.sleep(2.0)
    assert stopped(agents) == {"r1"}


@virtual
async def test_a_resume_ends_no_stop_that_has_not_arrived_yet(there: Lab) -> None:
    agents = await there.agents("r1")
    await there.base_station()
    operator = Operator(there)
    await operator.press(" ", 1.0)
    await operator.press("ry", 1.0)
    assert stopped(agents) == set()
    async with cut_off(there.operator):
        await operator.press(" ", 0.7)
        await operator.press("ry", 0.1)
        assert "still sent" in operator.shown[-1]
        await asyncio.sleep(0.5)
    await asyncio.sleep(0.2)
    assert stopped(agents) == {"r1"}
    await operator.press("ry", 1.0)
    assert stopped(agents) == set()
    async with cut_off(there.operator):
        await operator.press(" ", 3.3)  # it is given up
        await operator.press("ry", 2.0)
        assert "the base station is silent" in operator.shown[-1]


@virtual
async def test_resume_without_a_base_station_says_why_not(there: Lab) -> None:
    await there.agents("r1")
    operator = Operator(there)
    await operator.press("ry", 2.0)
    assert "the base station is silent" in operator.shown[-1]


@virtual
async def test_a_thousand_double_presses_at_random_moments_do_no_harm(there: Lab) -> None:
    """Among them now and then a resume."""
    rng = random.Random(1)
    agents = await there.agents("r1", "r2", "r3")
    store = await there.base_station()
    operator = Operator(there)
    first, resumes = store.stop.revision, 0
    there.operator.roster().close()  # the first one declares the watch of tokens, which stays
    declared = len(there.operator._open)
    for k in range(1000):
        await operator.press("  ", rng.choice([0.0, 1e-4, 0.01, 0.1]))
        await asyncio.sleep(rng.expovariate(20.0) + 0.002)
        assert stopped(agents) == {"r1", "r2", "r3"}, k
        if rng.random() < 0.05:
            resumes += 1
            await operator.press("ry", rng.choice([0.0, 0.05, 0.3]))
    await operator.press("  ", 0.05)
    await asyncio.sleep(4.0)
    assert stopped(agents) == {"r1", "r2", "r3"}
    assert store.stop.all
    # One for each order; and the first stop after a resume may be adopted from a robot before its order is there.
    assert store.stop.revision <= first + 2002 + 2 * resumes + 3
    assert operator.shown[-1].splitlines()[-1] == "3 of 3 robots stopped"
    assert len(there.operator._open) == declared
    await operator.press("ry", 1.0)
    assert stopped(agents) == set()
    assert store.stop == StopOrder(all=False, names=(), revision=store.stop.revision)
    await asyncio.sleep(3.0)
    assert stopped(agents) == set()
    sent = there.observer.every(channels.STOP)
    sent.drain()
    await asyncio.sleep(2.0)
    assert {order.message.all for order in sent.drain()} == {False}


@virtual
async def test_a_stop_that_is_pressed_as_the_view_ends_is_sent(there: Lab) -> None:
    agents = await there.agents("r1", "r2")
    await there.base_station()
    operator = Operator(there)
    operator.desk.press(" ")
    operator.desk.close()
    await asyncio.sleep(0.1)
    assert stopped(agents) == {"r1", "r2"}
