"""Who is there. On the in-memory bus and on Zenoh alike."""

from __future__ import annotations

import asyncio

from muro_zenoh.channels import Role
from muro_zenoh.transport import Roster
from tests.contract.conftest import Network
from tests.support.waiting import seconds, within


async def test_presence_comes_and_goes(network: Network) -> None:
    watcher, agent = await network.open(), await network.open()
    agent.announce(Role.AGENT, "r1")
    roster = watcher.roster()
    await within(2, roster.until(lambda r: r.of("agent") == {"r1"}), "who was there first")
    late = await network.open()
    late.announce(Role.AGENT, "r2")
    late.announce(Role.BASE, "r2")
    await within(2, roster.until(lambda r: r.alive == {("agent", "r1"), ("agent", "r2"), ("base", "r2")}), "r2")
    await late.close()
    await within(2, roster.until(lambda r: r.alive == {("agent", "r1")}), "r2 to have gone")


async def test_a_complete_roster_has_everybody(network: Network) -> None:
    fleet = {("agent", f"r{i}") for i in range(40)} | {("simulator", "simulator")}
    one, other = await network.open(), await network.open()
    for i, (role, name) in enumerate(sorted(fleet)):
        (one, other)[i % 2].announce(Role(role), name)
    first = await network.open()
    await within(2, first.roster().until(lambda r: r.alive == fleet), "all of them at the router")
    for bus in (await network.open(), one, other, first):
        roster = bus.roster()
        await roster.complete(timeout=seconds(2))
        assert roster.alive == fleet


async def test_who_goes_while_a_roster_is_completed_is_gone(network: Network) -> None:
    """Zenoh answers a question about tokens from what a session knew, a moment after it has told it of their end."""
    watcher = await network.open()
    roster = watcher.roster()
    for _ in range(20):
        leaving = await network.open()
        for i in range(20):
            leaving.announce(Role.AGENT, f"r{i}")
        await within(2, roster.until(lambda r: len(r.of("agent")) == 20), "all of them")
        closing = asyncio.create_task(leaving.close())
        while not closing.done():
            await roster.complete(timeout=seconds(2))
        await within(2, roster.until(lambda r: not r.alive), "the end of all of them")


async def test_the_rosters_of_a_bus_share_one_watch_of_tokens(network: Network) -> None:
    """Zenoh loses some for a session that undeclares its subscriber and declares it again."""
    agent, watcher = await network.open(), await network.open()
    for i in range(40):
        agent.announce(Role.AGENT, f"r{i}")
    first = watcher.roster()
    await within(2, first.until(lambda r: len(r.of("agent")) == 40), "all of them at the router")
    first.close()
    for _ in range(5):
        roster = watcher.roster()
        assert len(roster.of("agent")) == 40
        roster.close()


async def test_one_of_two_processes_with_the_same_name_may_leave(network: Network) -> None:
    watcher, first, second = await network.open(), await network.open(), await network.open()
    roster: Roster = watcher.roster()
    first.announce(Role.AGENT, "r1")
    await within(2, roster.until(lambda r: r.of("agent") == {"r1"}), "r1")
    second.announce(Role.AGENT, "r1")  # restarted, before the first one's end was noticed
    second.announce(Role.BASE, "r1")
    await within(2, roster.until(lambda r: r.of("base") == {"r1"}), "its base")
    await first.close()
    third = await network.open()
    third.announce(Role.BASE, "r3")  # after the first one's end
    await within(2, roster.until(lambda r: "r3" in r.of("base")), "r3")
    assert roster.of("agent") == {"r1"}
    await second.close()
    await within(2, roster.until(lambda r: not r.of("agent")), "r1 to have gone")
