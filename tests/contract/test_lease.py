"""Robots are held over the bus: taken, renewed, given back, lost. On the in-memory bus and on Zenoh alike."""

from __future__ import annotations

import asyncio

import pytest

from basestation.fleet.leases import Leases
from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.errors import NoReply, OrderRefused
from muro_zenoh.messages import Lease, Reply, TakeLease
from muro_zenoh.orders.lease import holding
from muro_zenoh.transport import Bus
from tests.contract.conftest import Network
from tests.contract.helpers import until
from tests.support.clock import ManualClock
from tests.support.waiting import seconds, within


class Station:
    """The base station's side, with a clock that is moved by hand."""

    def __init__(self, bus: Bus) -> None:
        self.clock = ManualClock()
        self.kept: tuple[Lease, ...] = ()
        self.taken = 0
        self._leases = Leases((), self.clock.now(), self._keep)
        bus.answer(channels.TAKE_LEASE, self._take)

    def _keep(self, leases: tuple[Lease, ...]) -> None:
        self.kept = leases

    def _take(self, order: TakeLease) -> Reply:
        self._leases.take(order, ("r1", "r2"), self.clock.now())
        self.taken += 1
        return Reply(accepted=True)


def nothing_lost(reason: str) -> None:
    raise AssertionError(reason)


async def test_robots_are_held_within_a_block(network: Network) -> None:
    station = Station(await network.open(roles=[Role.BASESTATION]))
    one, other = await network.open(roles=[Role.OPERATOR]), await network.open(roles=[Role.OPERATOR])
    async with holding(one, "muro run", ("r1", "r2"), lost=nothing_lost, patience=seconds(5)):
        (lease,) = station.kept
        assert (lease.epoch, lease.names, lease.operator) == (one.epoch, ("r1", "r2"), one.operator)
        with pytest.raises(OrderRefused, match=r"held by muro run of .* since \d\d:\d\d \(r1 r2\)"):
            async with holding(other, "muro run", ("r2",), lost=nothing_lost, patience=seconds(5)):
                pass
    assert station.kept == ()
    async with holding(other, "muro run", ("r2",), lost=nothing_lost):
        assert station.kept[0].epoch == other.epoch


async def test_a_lease_is_renewed_and_its_loss_is_said_once(network: Network) -> None:
    station = Station(await network.open(roles=[Role.BASESTATION]))
    one, other = await network.open(roles=[Role.OPERATOR]), await network.open(roles=[Role.OPERATOR])
    lost: list[str] = []
    async with holding(one, "muro run", ("r1",), lost=lost.append, patience=seconds(5)):
        taken = station.taken
        await until(lambda: station.taken > taken, "a renewal")
        station.clock.advance(3.1)  # it could not be renewed for so long
        async with holding(other, "a test", ("r1",), lost=nothing_lost, patience=seconds(5)):
            await until(lambda: bool(lost), "the loss")
            assert lost[0].startswith("held by a test of ")
            await asyncio.sleep(1.2)
            assert len(lost) == 1


async def test_without_a_base_station_nothing_is_held(network: Network) -> None:
    bus = await network.open(roles=[Role.OPERATOR])
    with pytest.raises(NoReply, match="basestation/lease: nobody answered"):
        await within(5, holding(bus, "muro run", (), lost=nothing_lost).__aenter__(), "the answer")
