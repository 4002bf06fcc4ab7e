"""A process writes, answers and announces what its roles do, and nothing else. On the in-memory bus and on Zenoh."""

from __future__ import annotations

import pytest

from muro_zenoh import channels
from muro_zenoh.channels import CHANNELS, VERBS, Role
from muro_zenoh.errors import ConfigError
from muro_zenoh.messages import Reply, SetCircle
from muro_zenoh.transport import MemoryNetwork, make_bus
from tests.contract.conftest import Network


async def test_a_role_that_does_not_write_a_channel_is_refused(network: Network) -> None:
    agent = await network.open(roles=[Role.AGENT])
    with pytest.raises(
        ConfigError,
        match=r"channel pose: got a process with the role agent to publish on it, expected .* basestation",
    ):
        agent.publisher(channels.POSE, "r1")
    agent.publisher(channels.CMD_VEL, "r1")
    agent.every(channels.POSE, "r1")


@pytest.mark.parametrize("role", Role)
async def test_every_role_may_publish_what_the_table_says(role: Role) -> None:
    async with make_bus(MemoryNetwork().link(), roles=[role]) as bus:
        for channel in CHANNELS:
            name = "x1" if channel.named else ""
            if role in {party.role for party in channel.writers}:
                bus.publisher(channel, name)
            else:
                with pytest.raises(ConfigError, match=f"channel {channel.word}: got a process with the role {role}"):
                    bus.publisher(channel, name)


async def test_a_process_with_several_roles_may_do_what_each_of_them_may(network: Network) -> None:
    simulator = await network.open(roles=[Role.SIMULATOR, Role.BASE])
    simulator.publisher(channels.TRUTH, "r1")
    simulator.publisher(channels.ODOMETRY, "r1")
    with pytest.raises(ConfigError, match="got a process with the role base or simulator to publish on it"):
        simulator.publisher(channels.CAMERA, "north")


async def test_a_role_that_a_process_does_not_have_is_not_announced(network: Network) -> None:
    agent = await network.open(roles=[Role.AGENT])
    agent.announce(Role.AGENT, "r1")
    with pytest.raises(ConfigError, match=r"presence of r1: got a process with the role agent.*expected .* base"):
        agent.announce(Role.BASE, "r1")


async def test_orders_are_given_and_taken_by_their_roles(network: Network) -> None:
    agent, station = await network.open(roles=[Role.AGENT]), await network.open(roles=[Role.BASESTATION])
    for verb in VERBS:
        if verb.answered_by is not Role.AGENT:
            with pytest.raises(ConfigError, match=f"order {verb.word}: .* role agent to answer it"):
                agent.answer(verb, lambda order: Reply(accepted=True))
    station.answer(channels.SET_CIRCLE, lambda order: Reply(accepted=True))
    with pytest.raises(ConfigError, match=r"order set_circle: .* role agent to give it, expected .* operator"):
        await agent.ask(channels.SET_CIRCLE, SetCircle(radius=1.0))
