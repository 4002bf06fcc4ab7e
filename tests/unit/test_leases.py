"""Leases: what the base station grants, and whose orders and velocities a robot takes."""

from __future__ import annotations

import asyncio
import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import pytest

from agents.master import Master, Writers
from basestation.fleet.kept_state import KeptState
from basestation.fleet.leases import Leases
from basestation.fleet.state_store import StateStore
from muro_zenoh import channels
from muro_zenoh.config import parse_scenario
from muro_zenoh.errors import ConfigError, OrderRefused
from muro_zenoh.messages import Goal, Lease, LeaseState, SetBehaviour, SpeedReference, TakeLease, encode
from muro_zenoh.transport import Bus, MemoryNetwork, make_bus
from tests.support.clock import ManualClock

ROBOTS = ("r1", "r2", "r3")
LAB = parse_scenario({"robots": 3, "behaviour": {"name": "circle"}}, "lab.toml", name="lab")


@dataclass
class Station:
    """The leases of a base station, and what it has kept."""

    kept: list[tuple[Lease, ...]] = field(default_factory=list)
    leases: Leases = field(init=False)

    def __post_init__(self) -> None:
        self.leases = Leases((), 0.0, self.kept.append)

    def take(
        self, epoch: int, *names: str, at: float = 0.0, operator: str = "alice@lab", release: bool = False
    ) -> None:
        order = TakeLease(program="muro run", operator=operator, names=names, epoch=epoch, release=release)
        self.leases.take(order, ROBOTS, at)

    def may(self, epoch: int, *names: str, at: float = 0.0, operator: str = "") -> bool:
        """Whether a process may order robots."""
        try:
            self.leases.check(SetBehaviour(behaviour="hold", names=names, epoch=epoch, operator=operator), names, at)
        except OrderRefused:
            return False
        return True


def test_where_nobody_holds_a_robot_everybody_may_order_it() -> None:
    station = Station()
    assert station.may(1, "r1")
    assert station.may(2)


def test_a_lease_refuses_everybody_else_and_says_whose_it_is() -> None:
    station = Station()
    station.take(1, "r1", "r2", at=1700000000.0)
    assert station.may(1, "r1", at=1700000000.0)
    assert station.may(2, "r3", at=1700000000.0)
    assert not station.may(2, "r3", "r1", at=1700000000.0)
    assert not station.may(2, at=1700000000.0), "an order to all is one to r1"
    with pytest.raises(OrderRefused, match=r"^held by muro run of alice@lab since \d\d:\d\d \(r1 r2\)$"):
        station.take(2, "r2", at=1700000000.0)
    station.take(2, "r3", at=1700000000.0, operator="bob@lab")
    with pytest.raises(OrderRefused, match="alice"):
        station.take(3, at=1700000000.0)


def test_the_holders_other_programs_may_order_and_not_take_it_over() -> None:
    """`muro set` beside `muro run`, by the same operator."""
    station = Station()
    station.take(1, "r1")
    assert station.may(2, "r1", operator="alice@lab")
    assert not station.may(2, "r1", operator="bob@lab")
    assert not station.may(2, "r1", operator="")
    with pytest.raises(OrderRefused, match="held by"):
        station.take(2, "r1", operator="alice@lab")


def test_a_robot_that_is_named_often_is_held_once() -> None:
    station = Station()
    station.take(1, *("r1", "r2") * 10_000)
    assert station.kept[-1][0].names == ("r1", "r2")
    station.take(1, *("r1", "r2") * 10_000)
    assert len(station.kept) == 1


def test_a_lease_without_an_operator_admits_nobody_without_one() -> None:
    lease = Lease(program="x", operator="", epoch=1, since=0.0)
    assert not lease.admits(Goal(x=0.0, y=0.0, epoch=2))
    assert lease.admits(Goal(x=0.0, y=0.0, epoch=1))


def test_a_lease_ends_3_s_after_its_last_renewal() -> None:
    station = Station()
    station.take(1, "r1", at=0.0)
    station.take(1, "r1", at=2.9)
    assert not station.may(2, "r1", at=5.8)
    assert station.leases.state(5.8).leases[0].left == pytest.approx(0.1)
    assert station.may(2, "r1", at=6.0)
    station.take(2, "r1", at=6.0)
    with pytest.raises(OrderRefused, match="held by"):
        station.take(1, "r1", at=6.1)


def test_a_time_that_is_no_number_ends_leases() -> None:
    station = Station()
    station.take(1, "r1")
    assert station.may(2, "r1", at=float("nan"))


def test_a_lease_is_given_back_by_its_holder_only() -> None:
    station = Station()
    station.take(1, "r1")
    station.take(2, "r1", release=True)
    assert not station.may(2, "r1")
    station.take(1, "r1", release=True)
    assert station.may(2, "r1")
    assert station.kept[-1] == ()


def test_what_is_not_renewed_but_changed_is_kept() -> None:
    station = Station()
    station.take(1, "r1", at=5.0)
    station.take(1, "r1", at=6.0)
    assert len(station.kept) == 1
    station.take(1, "r1", "r2", at=7.0)
    assert [lease.names for lease in station.kept[-1]] == [("r1", "r2")]
    assert station.kept[-1][0].since == 5.0
    station.leases.state(11.0)
    assert station.kept[-1] == ()


def test_unknown_robots_strangers_without_epoch_and_too_many_are_refused() -> None:
    station = Station()
    with pytest.raises(OrderRefused, match="robot r9: expected names out of r1, r2, r3"):
        station.take(1, "r9")
    with pytest.raises(OrderRefused, match="got no `epoch`"):
        station.take(0, "r1")
    robots = [f"r{k}" for k in range(70)]
    for k in range(64):
        station.leases.take(TakeLease(program="x", operator="y", names=(robots[k],), epoch=k + 1), robots, 0.0)
    with pytest.raises(OrderRefused, match="at most 64"):
        station.leases.take(TakeLease(program="x", operator="y", names=(robots[65],), epoch=99), robots, 0.0)


async def test_leases_are_saved_one_after_the_other_and_only_the_newest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A program that asks for ever other robots must not fill the memory with writes, while the disk is slow."""
    store = StateStore(LAB, tmp_path / "state.json")
    writes: list[tuple[int, asyncio.Future[None]]] = []

    def write(state: KeptState) -> asyncio.Future[None]:
        writes.append((state.leases[0].epoch, asyncio.get_running_loop().create_future()))
        return writes[-1][1]

    monkeypatch.setattr(store._file, "write", write)
    for epoch in range(1, 1001):
        store.keep_leases((Lease(program="muro run", operator="alice@lab", epoch=epoch, since=0.0),))
        await asyncio.sleep(0)
    assert [epoch for epoch, _ in writes] == [1]
    writes[0][1].set_exception(ConfigError("state.json", got="a full disk", expected="a file"))
    for _ in range(3):
        await asyncio.sleep(0)
    assert [epoch for epoch, _ in writes] == [1, 1000]
    writes[1][1].set_result(None)
    for _ in range(3):
        await asyncio.sleep(0)
    store.keep_leases((Lease(program="muro run", operator="alice@lab", epoch=2, since=0.0),))
    await asyncio.sleep(0)
    assert [epoch for epoch, _ in writes] == [1, 1000, 2]
    store.close()


async def test_a_base_station_that_restarts_remembers_a_lease_for_3_s(tmp_path: Path) -> None:
    path = tmp_path / "state.json"
    store = StateStore(LAB, path)
    before = Leases((), 0.0, store.keep_leases)
    before.take(TakeLease(program="muro run", operator="alice@lab", names=("r1",), epoch=7), ROBOTS, 0.0)
    while not path.exists() or b"alice@lab" not in path.read_bytes():  # noqa: ASYNC110 - a file
        await asyncio.sleep(0.005)
    store.close()
    again = StateStore(LAB, path)
    after = Leases(again.state.leases, 100.0, again.keep_leases)
    order = SetBehaviour(behaviour="hold", epoch=8)
    with pytest.raises(OrderRefused, match=r"held by muro run of alice@lab since \d\d:\d\d \(r1\)"):
        after.check(order, ("r1",), 102.9)
    after.take(TakeLease(program="muro run", operator="alice@lab", names=("r1",), epoch=7), ROBOTS, 102.9)
    with pytest.raises(OrderRefused, match="held by"):
        after.check(order, ("r1",), 105.8)
    after.check(order, ("r1",), 106.0)  # its holder is gone
    assert again.state.leases == ()
    again.close()


# ---- at the robot


@dataclass
class Robot:
    """What the agent of r1 takes."""

    bus: Bus
    other: Bus
    network: MemoryNetwork
    clock: ManualClock
    master: Master
    speeds: Writers[SpeedReference]

    def speed(self) -> float | None:
        """The velocity that is followed."""
        followed, _ = self.speeds.followed(self.clock.now())
        return followed.message.speed if followed is not None else None

    def write(self, speed: float, epoch: int, operator: str = "") -> None:
        """As a program of others publishes it."""
        message = SpeedReference(speed=speed, stamp=self.clock.now(), epoch=epoch, operator=operator)
        self.network.put("muro/velocity/r1", encode(message))

    def held(self, *names: str, left: float = 3.0, epoch: int = 7) -> None:
        """As the base station says."""
        lease = Lease(program="muro run", operator="alice@lab", epoch=epoch, names=names, since=0.0, left=left)
        state = LeaseState(leases=(lease,), stamp=self.clock.now(), epoch=99)
        self.network.put("muro/lease", encode(state))


@asynccontextmanager
async def robot() -> AsyncIterator[Robot]:
    network, clock = MemoryNetwork(), ManualClock()
    async with make_bus(network.link(), clock=clock) as bus, make_bus(network.link(), clock=clock) as other:
        master = Master(bus, "r1")
        yield Robot(bus, other, network, clock, master, Writers(bus, channels.VELOCITY, "r1", master))


async def test_the_first_writer_of_a_velocity_is_followed_for_as_long_as_it_is_fresh() -> None:
    async with robot() as r:
        for _ in range(50):
            r.write(0.1, epoch=1)
            assert r.speed() == 0.1
            r.write(0.2, epoch=2)
            assert r.speed() == 0.1
            assert r.speeds.complaint == "a velocity is not followed: another program's came first"
            r.clock.advance(0.1)
        r.clock.advance(0.35)
        r.write(0.2, epoch=2)
        assert r.speed() == 0.1  # 0.45 s old
        r.clock.advance(0.1)
        assert r.speed() == 0.2
        assert r.speeds.complaint == ""
        r.write(0.1, epoch=1)
        assert r.speed() == 0.2, "who comes back has to wait, too"


async def test_a_held_robot_follows_its_holders_velocity_only() -> None:
    async with robot() as r:
        r.write(0.1, epoch=1)
        assert r.speed() == 0.1
        r.held("r1", "r2")
        assert r.speed() is None
        assert re.match(
            r"a velocity is not followed: held by muro run of alice@lab since .* \(r1 r2\)", r.speeds.complaint
        )
        r.write(0.3, epoch=7)
        assert r.speed() == 0.3
        r.clock.advance(0.6)
        r.write(0.4, epoch=8, operator="alice@lab")
        assert r.speed() == 0.4
        r.held("r2")
        r.clock.advance(0.6)
        r.write(0.1, epoch=1)
        assert r.speed() == 0.1


async def test_a_lease_ends_at_the_robot_too_when_the_base_station_is_silent() -> None:
    async with robot() as r:
        r.held("r1", left=2.0)
        goal = Goal(x=0.0, y=0.0, epoch=1)
        assert r.master.refusal(goal).startswith("held by muro run of alice@lab since")
        assert r.master.refusal(msgspec.structs.replace(goal, operator="alice@lab")) == ""
        assert r.master.refusal(msgspec.structs.replace(goal, epoch=7)) == ""
        r.clock.advance(1.9)
        assert r.master.refusal(goal)
        r.clock.advance(0.2)
        assert r.master.refusal(goal) == ""


async def test_the_robots_own_velocity_counts_only_where_nobody_elses_does() -> None:
    async with robot() as r:
        own = r.bus.publisher(channels.VELOCITY, "r1")
        own.put(SpeedReference(speed=0.5))
        assert r.speed() == 0.5
        r.write(0.1, epoch=1)
        own.put(SpeedReference(speed=0.5))
        assert r.speed() == 0.1
        assert r.speeds.complaint == ""
        r.held("r1")
        assert r.speed() == 0.5


async def test_ever_new_writers_fill_no_memory_and_do_not_displace_the_one_that_is_followed() -> None:
    async with robot() as r:
        r.write(0.1, epoch=1)
        assert r.speed() == 0.1
        for epoch in range(2, 50):
            r.write(0.9, epoch=epoch)
            assert r.speed() == 0.1
        assert len(r.speeds._newest) == 8


async def test_a_program_of_ours_says_whose_it_is() -> None:
    async with robot() as r:
        assert r.other.operator
        seen = r.bus.latest(channels.VELOCITY, "r1")
        r.other.publisher(channels.VELOCITY, "r1").put(SpeedReference(speed=0.2))
        received = seen.get()
        assert received is not None
        assert received.message.operator == r.other.operator


@pytest.mark.parametrize(("given", "expected"), [("bob", "bob"), ("x" * 300, "x" * 128)])
async def test_the_operators_name_can_be_given(given: str, expected: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MURO_OPERATOR", given)
    async with robot() as r:
        assert r.bus.operator == expected
