"""What a run that joins a fleet finds there."""

from __future__ import annotations

import asyncio
import random

import pytest

from muro_zenoh.channels import ALL_ROLES, Role
from muro_zenoh.errors import NoReply
from muro_zenoh.supervision import joining
from muro_zenoh.supervision.joining import There
from muro_zenoh.transport import MemoryNetwork, make_bus
from muro_zenoh.transport.memory_faults import Cut, Delay
from tests.support.virtual import virtual

ROBOTS = ("r1", "r2")
AGENTS = [(Role.AGENT, name) for name in ROBOTS]
STATION, SIMULATOR = (Role.BASESTATION, "basestation"), (Role.SIMULATOR, "simulator")


class Floor:
    """A network on which some are alive, and the run that joins it."""

    def __init__(self, *alive: tuple[Role, str]) -> None:
        self._network = MemoryNetwork()
        for role, name in alive:
            self.come(role, name)
        self.link = self._network.link("operator")
        self.bus = make_bus(self.link, "lab", roles=ALL_ROLES)

    def come(self, role: Role, name: str) -> None:
        """Somebody is alive from now on."""
        make_bus(self._network.link(name), "lab", roles=ALL_ROLES).announce(role, name)


@pytest.mark.parametrize(
    ("alive", "found"),
    [
        ([], There()),
        ([*AGENTS, STATION, SIMULATOR], There(frozenset({"r1", "r2", "basestation", "simulator"}), ROBOTS)),
        ([AGENTS[1], (Role.AGENT, "r7")], There(frozenset({"r2"}), ("r2",))),
        # Beside the base of one robot, a simulator would be a second one of it.
        ([STATION, (Role.BASE, "r1")], There(frozenset({"basestation", "simulator"}))),
    ],
)
def test_what_is_alive_need_not_be_started(alive: list[tuple[Role, str]], found: There) -> None:
    @virtual
    async def test() -> None:
        assert await joining.look(Floor(*alive).bus, ROBOTS) == found

    test()


@pytest.mark.parametrize("seed", range(10))
def test_the_simulator_is_found_whatever_is_heard_first(seed: int) -> None:
    """A second one would be a second body of each robot."""

    @virtual
    async def test() -> None:
        floor = Floor(*AGENTS, STATION, SIMULATOR)
        floor.link.begin(Delay(random.Random(seed), 0.05, 0.2))
        assert "simulator" in (await joining.look(floor.bus, ROBOTS)).processes

    test()


@virtual
async def test_a_simulator_that_is_restarting_is_waited_for() -> None:
    floor = Floor(*AGENTS, STATION)
    looking = asyncio.create_task(joining.look(floor.bus, ROBOTS))
    await asyncio.sleep(1.5)
    floor.come(*SIMULATOR)
    assert "simulator" in (await looking).processes


@virtual
async def test_nothing_is_known_of_a_floor_behind_a_cut_link() -> None:
    floor = Floor(*AGENTS, STATION, SIMULATOR)
    floor.link.begin(Cut())
    with pytest.raises(NoReply, match="who is alive is not known"):
        await joining.look(floor.bus, ROBOTS)
