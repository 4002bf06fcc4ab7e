"""Clocks are compared with the base station's. On the in-memory bus and on Zenoh alike."""

from __future__ import annotations

import asyncio

import pytest

from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.config import ClockSettings
from muro_zenoh.messages import FleetSnapshot, Odometry
from muro_zenoh.transport.measured_clock import MeasuredClock, StationClock, answer_time
from tests.contract.conftest import Network
from tests.contract.helpers import until
from tests.support.clock import ManualClock
from tests.support.waiting import within


@pytest.mark.parametrize(("ahead", "complaints"), [(0.0, 0), (5000.0, 1), (-5000.0, 1)])
async def test_a_clock_is_measured_and_judges_what_the_base_station_sends(
    network: Network, ahead: float, complaints: int
) -> None:
    theirs, ours = ManualClock(10_000.0), ManualClock(10_000.0 + ahead)
    station = await network.open(theirs, roles=[Role.BASESTATION])
    agent = await network.open(ours, roles=[Role.AGENT])
    box, out = agent.every(channels.ALL_POSITIONS), station.publisher(channels.ALL_POSITIONS)
    answer_time(station)
    clock = StationClock(agent, ClockSettings())
    measuring = asyncio.create_task(clock.run())
    await until(lambda: bool(clock.numbers()), "a measurement")
    assert clock.numbers()["clock_offset_s"] == pytest.approx(-ahead)
    assert clock.numbers()["clock_round_trip_s"] == 0.0
    assert len(clock.complaints()) == complaints
    sent = out.put(FleetSnapshot(robots=(), stamp=theirs.now() - 0.3))  # its first, and already late
    while True:
        received = await within(5, box.next(), "a snapshot")
        if received.message.seq >= sent.seq:
            break
    assert received.age(ours.now()) == pytest.approx(0.3)
    assert received.captured() == pytest.approx(ours.now() - 0.3)
    # The base station has our clock from the second question on.
    await until(lambda: station.clocks.offset(agent.epoch, theirs.now()) == pytest.approx(-ahead), "our clock there")
    measuring.cancel()


async def test_when_one_clock_was_set_both_ends_count_it(network: Network) -> None:
    theirs, ours = ManualClock(10_000.0), ManualClock(10_000.0)
    station = await network.open(theirs, roles=[Role.BASESTATION])
    agent = await network.open(ours, roles=[Role.AGENT])
    answer_time(station)
    measuring = asyncio.create_task(StationClock(agent, ClockSettings()).run())
    await until(lambda: station.clocks.offset(agent.epoch, theirs.now()) == pytest.approx(0.0), "our clock there")
    assert (agent.clocks.steps(station.epoch), station.clocks.steps(agent.epoch)) == (0, 0)
    theirs.advance(2.0)
    await until(lambda: station.clocks.steps(agent.epoch) == 1, "it was set")
    assert agent.clocks.steps(station.epoch) == 1
    assert station.clocks.offset(agent.epoch, theirs.now()) == pytest.approx(2.0)
    measuring.cancel()


async def test_an_agent_measures_its_own_base(network: Network) -> None:
    theirs, ours = ManualClock(10_000.0), ManualClock(9_000.0)
    bases = await network.open(theirs, roles=[Role.BASE])
    agent = await network.open(ours, roles=[Role.AGENT])
    odometry, out = agent.every(channels.ODOMETRY, "r2"), bases.publisher(channels.ODOMETRY, "r2")
    answer_time(bases, channels.BASE_TIME, "r2")
    measuring = [asyncio.create_task(MeasuredClock(agent, channels.BASE_TIME, name).run()) for name in ("r1", "r2")]
    await until(lambda: agent.clocks.offset(bases.epoch, ours.now()) == pytest.approx(-1000.0), "the base's clock")
    late = theirs.now() - 0.1  # its first, and already late
    out.put(Odometry(x=0.0, y=0.0, theta=0.0, v=0.1, omega=0.0, stamp=late))
    received = await within(5, odometry.next(), "odometry")
    assert received.captured() == pytest.approx(ours.now() - 0.1)
    await until(lambda: bases.clocks.offset(agent.epoch, theirs.now()) == pytest.approx(1000.0), "our clock there")
    for task in measuring:
        task.cancel()


async def test_without_a_base_station_nothing_is_measured_and_that_is_a_complaint(network: Network) -> None:
    ours = ManualClock()
    agent = await network.open(ours, roles=[Role.AGENT])
    clock = StationClock(agent, ClockSettings())
    measuring = asyncio.create_task(clock.run())
    await asyncio.sleep(0.05)
    ours.advance(4.9)
    assert (clock.numbers(), clock.complaints()) == ({}, ())
    ours.advance(0.2)
    (complaint,) = clock.complaints()
    assert complaint == "clock not compared: the base station has not answered for 5 s"
    assert not measuring.done()
    measuring.cancel()
