"""The base and its dead-man: which commands reach the wheels, and which never do."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator, Coroutine
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

import msgspec
import pytest
import pytest_asyncio

from agents import simulator
from agents.base import run
from agents.base.base import DEAD_MAN, Base
from agents.base.run import run_base, run_base_process, run_bases
from agents.base.wheels import WheelReading
from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.config import parse_scenario
from muro_zenoh.errors import ConfigError
from muro_zenoh.messages import BaseState, Odometry, VelocityCommand
from muro_zenoh.runtime.virtual_time import InlineExecutor, VirtualClock, run_virtually
from muro_zenoh.transport import Bus, MemoryNetwork, Received, make_bus
from muro_zenoh.transport.mailboxes import Every
from tests.support.clock import ManualClock
from tests.support.leaks import no_task_left
from tests.support.waiting import within

__all__ = ["no_task_left"]


@dataclass
class Wheels:
    """Wheels that record their commands."""

    reading: WheelReading = field(default_factory=lambda: WheelReading(1.0, 2.0, 0.5, 0.1, -0.2, battery=0.7))
    commanded: list[tuple[float, float]] = field(default_factory=list)

    def command(self, v: float, omega: float) -> None:
        self.commanded.append((v, omega))

    def read(self) -> WheelReading:
        return self.reading

    @property
    def now(self) -> tuple[float, float] | None:
        """Their present command."""
        return self.commanded[-1] if self.commanded else None


@dataclass
class Lab:
    """A base that runs, and an agent's side of the bus."""

    bus: Bus
    network: MemoryNetwork
    clock: ManualClock
    wheels: Wheels
    odometry: Every[Odometry]
    states: Every[BaseState]
    task: asyncio.Task[None]

    async def beat(self, beats: int = 2) -> Odometry:
        """Let the base beat; its last odometry. Its beat is the loop's time, its ages are the clock's."""
        self.odometry.drain()
        for _ in range(beats):
            got = await within(5, self.odometry.next(), "an odometry")
        return got.message

    async def command(self, v: float, omega: float, stamp: float | None = None) -> None:
        """What an agent sends, and a beat of the base."""
        message = VelocityCommand(v=v, omega=omega, stamp=stamp if stamp is not None else self.clock.now())
        self._out.put(message)
        await self.beat()

    @property
    def _out(self) -> Any:
        if not hasattr(self, "_publisher"):
            self._publisher = self.bus.publisher(channels.CMD_VEL, "r1")
        return self._publisher

    async def state(self) -> BaseState:
        """The newest state that the base sent."""
        await self.beat()
        return self.states.drain()[-1].message


@pytest_asyncio.fixture
async def lab() -> AsyncIterator[Lab]:
    network, clock, wheels = MemoryNetwork(), ManualClock(), Wheels()
    async with make_bus(network.link(), clock=clock) as bus, make_bus(network.link(), clock=clock) as agent:
        odometry = agent.every(channels.ODOMETRY, "r1", depth=1024)
        states = agent.every(channels.BASE, "r1", depth=1024)
        task = asyncio.create_task(run_base(bus, "r1", wheels, clock))
        yield Lab(agent, network, clock, wheels, odometry, states, task)
        task.cancel()
        await asyncio.wait({task})


async def test_before_any_command_the_wheels_are_stationary(lab: Lab) -> None:
    await lab.beat()
    assert set(lab.wheels.commanded) == {(0.0, 0.0)}
    assert (await lab.state()).dead_man


async def test_a_fresh_command_is_obeyed(lab: Lab) -> None:
    await lab.command(0.2, -0.5)
    assert lab.wheels.now == (0.2, -0.5)
    assert not (await lab.state()).dead_man


async def test_the_newest_command_is_obeyed(lab: Lab) -> None:
    for speed in (0.1, 0.2, 0.3):
        lab._out.put(VelocityCommand(v=speed, omega=0.0))
    await lab.beat()
    assert lab.wheels.now == (0.3, 0.0)


async def test_a_command_is_followed_only_while_it_is_fresh(lab: Lab) -> None:
    await lab.command(0.2, 0.0)
    lab.clock.advance(DEAD_MAN - 0.01)
    await lab.beat()
    assert lab.wheels.now == (0.2, 0.0)
    lab.clock.advance(0.02)
    await lab.beat()
    assert lab.wheels.now == (0.0, 0.0)
    assert (await lab.state()).dead_man


async def test_the_dead_man_keeps_zeroing_until_the_next_command(lab: Lab) -> None:
    await lab.command(0.2, 0.0)
    lab.clock.advance(1.0)
    await lab.beat()
    before = len(lab.wheels.commanded)
    await lab.beat(3)
    assert lab.wheels.commanded[before:]
    assert set(lab.wheels.commanded[before:]) == {(0.0, 0.0)}
    await lab.command(0.15, 0.0)
    assert lab.wheels.now == (0.15, 0.0)
    assert not (await lab.state()).dead_man


async def test_the_dead_man_is_logged_once_an_episode(lab: Lab, caplog: pytest.LogCaptureFixture) -> None:
    for _ in range(2):
        await lab.command(0.2, 0.0)
        lab.clock.advance(1.0)
        await lab.beat(4)
    assert [r.message for r in caplog.records if r.levelname == "WARNING"] == [
        "r1: no fresh command for 0.3 s, wheels at zero"
    ] * 2


async def test_a_backlog_is_ignored(lab: Lab) -> None:
    await lab.command(0.2, 0.0)
    # The link was cut; what the agent sent meanwhile arrives all at once when it is back.
    began = lab.clock.now()
    lab.clock.advance(2.0)
    await lab.beat()
    for late in (0.1, 0.5, 1.0, 1.6):
        await lab.command(0.3, 0.0, stamp=began + late)
        assert lab.wheels.now == (0.0, 0.0)
    await lab.command(0.1, 0.0)
    assert lab.wheels.now == (0.1, 0.0)


@pytest.mark.parametrize(("late", "obeyed"), [(0.0, True), (0.29, True), (0.31, False), (2.0, False)])
async def test_a_stale_command_is_not_followed_even_for_a_moment(lab: Lab, late: float, obeyed: bool) -> None:
    await lab.command(0.2, 0.0)  # so that the minimum delay is known
    lab.clock.advance(5.0)
    await lab.beat()
    before = len(lab.wheels.commanded)
    await lab.command(0.3, 0.1, stamp=lab.clock.now() - late)
    assert ((0.3, 0.1) in lab.wheels.commanded[before:]) == obeyed


async def test_a_late_command_is_followed_only_for_the_rest_of_its_time(lab: Lab) -> None:
    await lab.command(0.2, 0.0)
    lab.clock.advance(0.5)
    await lab.beat()
    await lab.command(0.3, 0.0, stamp=lab.clock.now() - 0.2)
    assert lab.wheels.now == (0.3, 0.0)
    lab.clock.advance(0.15)
    await lab.beat()
    assert lab.wheels.now == (0.0, 0.0)


async def test_the_agents_clock_may_differ(lab: Lab) -> None:
    await lab.command(0.2, 0.0, stamp=5.0)
    assert lab.wheels.now == (0.2, 0.0)
    lab.clock.advance(0.1)
    await lab.command(0.25, 0.0, stamp=5.1)
    assert lab.wheels.now == (0.25, 0.0)


async def test_a_robot_that_two_processes_command_is_stationary(lab: Lab, caplog: pytest.LogCaptureFixture) -> None:
    async with make_bus(lab.network.link(), clock=lab.clock) as twin:
        other = twin.publisher(channels.CMD_VEL, "r1")
        await lab.command(0.2, 0.0)
        for _ in range(4):  # one has received a stop, the other has not
            lab.clock.advance(0.1)
            other.put(VelocityCommand(v=0.0, omega=0.0))
            await lab.beat()
            assert lab.wheels.now == (0.0, 0.0)
            lab.clock.advance(0.1)
            before = len(lab.wheels.commanded)
            await lab.command(0.2, 0.0)
            assert set(lab.wheels.commanded[before:]) == {(0.0, 0.0)}
    assert [r.message for r in caplog.records if "two processes" in r.message] == [
        "r1: two processes command these wheels, so they are stopped: is an agent running twice?"
    ]
    for _ in range(3):  # one alone is obeyed again
        lab.clock.advance(0.1)
        await lab.command(0.2, 0.0)
    assert lab.wheels.now == (0.2, 0.0)


async def test_a_restarted_agent_is_obeyed_once_the_old_ones_command_has_expired(lab: Lab) -> None:
    await lab.command(0.2, 0.0)
    lab.clock.advance(DEAD_MAN + 0.01)
    async with make_bus(lab.network.link(), clock=lab.clock) as again:
        again.publisher(channels.CMD_VEL, "r1").put(VelocityCommand(v=0.1, omega=0.0))
        await lab.beat()
        assert lab.wheels.now == (0.1, 0.0)


async def test_a_command_without_epoch_is_not_obeyed_alone_nor_beside_another(
    lab: Lab, caplog: pytest.LogCaptureFixture
) -> None:
    """Two writers that both omit it could not be distinguished: they would drive the wheels in turns."""

    async def unsigned(v: float) -> None:
        raw = msgspec.msgpack.encode({"stamp": lab.clock.now(), "v": v, "omega": 0.0})
        lab.network.put("muro/cmd_vel/r1", raw)
        await lab.beat()

    for _ in range(3):
        await unsigned(0.4)
        assert set(lab.wheels.commanded) == {(0.0, 0.0)}
    await lab.command(0.2, 0.0)
    assert lab.wheels.now == (0.2, 0.0)
    before = len(lab.wheels.commanded)
    for _ in range(3):
        lab.clock.advance(0.05)
        await unsigned(0.4)
        await lab.command(0.2, 0.0)
    assert set(lab.wheels.commanded[before:]) == {(0.2, 0.0)}
    for _ in range(4):  # nor does it keep the agent's last command alive
        lab.clock.advance(0.1)
        await unsigned(0.4)
    assert lab.wheels.now == (0.0, 0.0)
    assert sum("a command without `epoch`" in record.message for record in caplog.records) == 1


@pytest.mark.parametrize("hazard", ["bumper", "cliff", "wheel_drop"])
async def test_a_hazard_stops_the_wheels_at_once_and_while_it_lasts(lab: Lab, hazard: str) -> None:
    await lab.command(0.2, 0.1)
    lab.wheels.reading = lab.wheels.reading._replace(**{hazard: True})
    await lab.beat()
    assert lab.wheels.now == (0.0, 0.0)
    before = len(lab.wheels.commanded)
    await lab.command(0.2, 0.1)
    assert set(lab.wheels.commanded[before:]) == {(0.0, 0.0)}
    assert getattr(await lab.state(), hazard)
    lab.wheels.reading = lab.wheels.reading._replace(**{hazard: False})
    await lab.command(0.2, 0.1)
    assert lab.wheels.now == (0.2, 0.1)
    assert not getattr(await lab.state(), hazard)


async def test_charging_alone_does_not_stop_the_robot(lab: Lab) -> None:
    lab.wheels.reading = lab.wheels.reading._replace(charging=True)
    await lab.command(0.2, 0.1)
    assert lab.wheels.now == (0.2, 0.1)
    assert (await lab.state()).charging


@pytest.mark.parametrize(
    ("v", "omega", "reason"),
    [
        (None, None, "Expected `object`, got `int`"),
        (math.nan, 0.0, "v: got nan, expected a finite number"),
        (0.3, math.nan, "omega: got nan, expected a finite number"),
        (math.inf, 0.0, "v: got inf, expected a finite number"),
        (0.3, -math.inf, "omega: got -inf, expected a finite number"),
    ],
)
async def test_garbage_neither_drives_nor_keeps_a_command_alive(
    lab: Lab, v: float | None, omega: float | None, reason: str, caplog: pytest.LogCaptureFixture
) -> None:
    await lab.command(0.2, 0.0)
    began = len(lab.wheels.commanded)
    for _ in range(5):
        lab.clock.advance(0.1)
        # All else in it is as the agent sends it.
        good = {"stamp": lab.clock.now(), "seq": 9, "epoch": lab.bus.epoch, "v": v, "omega": omega}
        lab.network.put("muro/cmd_vel/r1", msgspec.msgpack.encode(good) if v is not None else b"garbage")
        await lab.beat()
    assert set(lab.wheels.commanded[began:]) == {(0.0, 0.0)}
    assert sum(reason in record.message for record in caplog.records if "dropped a message" in record.message) == 1


async def test_the_same_message_with_finite_numbers_is_a_command(lab: Lab) -> None:
    good = {"stamp": lab.clock.now(), "seq": 9, "epoch": lab.bus.epoch, "v": 0.3, "omega": 0.1}
    lab.network.put("muro/cmd_vel/r1", msgspec.msgpack.encode(good))
    await lab.beat()
    assert lab.wheels.now == (0.3, 0.1)


async def test_odometry_is_what_the_wheels_read_with_its_time(lab: Lab) -> None:
    lab.clock.advance(7.0)
    got = await lab.beat()
    assert (got.x, got.y, got.theta, got.v, got.omega) == (1.0, 2.0, 0.5, 0.1, -0.2)
    assert got.stamp == lab.clock.now()


async def test_the_state_is_sent_on_change_and_twice_a_second(lab: Lab) -> None:
    assert (await lab.state()).battery == 0.7
    await lab.beat(3)
    assert lab.states.drain() == []  # nothing has changed, and no time has passed
    lab.clock.advance(0.5)
    await lab.beat()
    assert len(lab.states.drain()) == 1
    lab.wheels.reading = lab.wheels.reading._replace(battery=0.5)
    await lab.beat()
    assert [state.message.battery for state in lab.states.drain()] == [0.5]


async def test_a_cancelled_base_sets_the_wheels_to_zero(lab: Lab) -> None:
    await lab.command(0.2, 0.1)
    lab.task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await within(1, lab.task, "the end")
    assert lab.wheels.now == (0.0, 0.0)


async def test_wheels_that_fail_end_the_base_with_the_wheels_at_zero(lab: Lab) -> None:
    await lab.command(0.2, 0.1)

    def broken() -> WheelReading:
        raise OSError("the serial line is gone")

    lab.wheels.read = broken  # type: ignore[method-assign]
    with pytest.raises(OSError, match="serial line"):
        await within(1, lab.task, "the end")
    assert lab.wheels.now == (0.0, 0.0)


async def test_a_timeout_error_from_the_wheels_is_not_swallowed(lab: Lab) -> None:
    await lab.command(0.2, 0.1)
    driven = lab.wheels.command

    def slow(v: float, omega: float) -> None:
        if v:
            raise TimeoutError("the serial line does not answer")
        driven(v, omega)

    lab.wheels.command = slow  # type: ignore[method-assign]
    lab._out.put(VelocityCommand(v=0.3, omega=0.0))
    await within(2, asyncio.wait({lab.task}), "the end")
    assert repr(lab.task.exception()) == "TimeoutError('the serial line does not answer')"
    assert lab.wheels.now == (0.0, 0.0)


@dataclass
class Several:
    """Bases r1, r2, r3 in one process, in virtual time, and an agent's side of the bus."""

    bus: Bus
    wheels: dict[str, Wheels]
    task: asyncio.Task[None]

    def command(self, name: str, v: float) -> None:
        self.bus.publisher(channels.CMD_VEL, name).put(VelocityCommand(v=v, omega=0.0))


@asynccontextmanager
async def several() -> AsyncIterator[Several]:
    network, clock = MemoryNetwork(), VirtualClock()
    async with make_bus(network.link(), clock=clock) as bus, make_bus(network.link(), clock=clock) as agent:
        wheels = {name: Wheels() for name in ("r1", "r2", "r3")}
        task = asyncio.create_task(run_bases(bus, wheels, clock))
        await asyncio.sleep(0.03)
        yield Several(agent, wheels, task)
        task.cancel()
        await asyncio.wait({task})


class TestSeveralBasesInOneProcess:
    def test_each_robot_follows_only_its_own_commands(self) -> None:
        async def main() -> None:
            async with several() as bases:
                for name, speed in (("r1", 0.1), ("r2", 0.2), ("r9", 0.9)):
                    bases.command(name, speed)
                await asyncio.sleep(0.03)
                assert [wheels.now for wheels in bases.wheels.values()] == [(0.1, 0.0), (0.2, 0.0), (0.0, 0.0)]

        run_virtually(main())

    def test_a_command_is_obeyed_when_it_comes_and_not_at_the_next_beat(self) -> None:
        async def main() -> None:
            async with several() as bases:
                for _ in range(20):  # at any time between two beats
                    for speed in (0.2, 0.0):
                        bases.command("r2", speed)
                        await asyncio.sleep(1e-4)
                        assert bases.wheels["r2"].now == (speed, 0.0)
                        await asyncio.sleep(3.3e-3)

        run_virtually(main())

    def test_the_dead_man_acts_within_a_beat_of_its_limit(self) -> None:
        async def main() -> None:
            async with several() as bases:
                for tenth in range(10):
                    await asyncio.sleep(2e-3 * tenth)
                    bases.command("r3", 0.2)
                    await asyncio.sleep(DEAD_MAN - 1e-3)
                    assert bases.wheels["r3"].now == (0.2, 0.0)
                    await asyncio.sleep(1e-3 + 0.02 + 1e-3)
                    assert bases.wheels["r3"].now == (0.0, 0.0)

        run_virtually(main())

    def test_odometry_comes_at_its_rate_and_from_all_robots_at_one_time(self) -> None:
        async def main() -> None:
            async with several() as bases:
                odometry = bases.bus.every(channels.ODOMETRY, "*", depth=1024)
                await asyncio.sleep(100.5 * channels.ODOMETRY.period)
                got = odometry.drain()
                stamps = sorted({received.message.stamp for received in got})
                assert len(got) == 3 * len(stamps)
                assert len(stamps) in (100, 101)
                assert stamps[-1] - stamps[0] == pytest.approx((len(stamps) - 1) * channels.ODOMETRY.period)

        run_virtually(main())

    def test_the_state_of_each_robot_comes_twice_a_second(self) -> None:
        async def main() -> None:
            async with several() as bases:
                states = bases.bus.every(channels.BASE, "*", depth=1024)
                await asyncio.sleep(2.03)
                names = [received.name for received in states.drain()]
                assert {name: names.count(name) for name in bases.wheels} == {"r1": 4, "r2": 4, "r3": 4}

        run_virtually(main())

    def test_a_timeout_error_of_the_wheels_is_no_end_of_a_beat(self) -> None:
        async def main() -> None:
            async with several() as bases:

                def slow(v: float, omega: float) -> None:
                    raise TimeoutError("the serial line does not answer")

                bases.wheels["r2"].command = slow  # type: ignore[method-assign]
                bases.command("r2", 0.3)
                with pytest.raises(TimeoutError, match="serial line"):
                    await bases.task

        run_virtually(main())

    def test_when_the_wheels_of_one_fail_all_are_stopped(self) -> None:
        async def main() -> None:
            async with several() as bases:

                def broken(v: float, omega: float) -> None:
                    raise OSError("the serial line is gone")

                for name in bases.wheels:
                    bases.command(name, 0.2)
                await asyncio.sleep(1e-3)
                assert [wheels.now for wheels in bases.wheels.values()] == [(0.2, 0.0)] * 3
                bases.wheels["r2"].command = broken  # type: ignore[method-assign]
                bases.command("r2", 0.3)
                with pytest.raises(OSError, match="serial line"):
                    await bases.task
                assert bases.wheels["r1"].now == bases.wheels["r3"].now == (0.0, 0.0)

        run_virtually(main())


async def test_a_flood_of_commands_does_not_keep_the_base_from_its_beats() -> None:
    async with make_bus(MemoryNetwork().link()) as bus:
        command, odometry = bus.publisher(channels.CMD_VEL, "r1"), bus.every(channels.ODOMETRY, "r1")
        left = 10**5

        class Flooding(Wheels):
            """Each command that is obeyed brings the next, so that the mailbox is never empty."""

            def command(self, v: float, omega: float) -> None:
                nonlocal left
                if (v, omega) != (0.0, 0.0) and left > 0:
                    left -= 1
                    command.put(VelocityCommand(v=v, omega=omega))

        task = asyncio.create_task(run_base(bus, "r1", Flooding(), bus.clock))
        await within(5, odometry.next(), "the first odometry")
        command.put(VelocityCommand(v=0.1, omega=0.0))
        for _ in range(3):
            await within(5, odometry.next(), "odometry during the flood")
        assert left > 0
        left = 0
        task.cancel()
        await asyncio.wait({task})


class TestTheProcess:
    """The process of one base, on the in-memory bus."""

    LAB = parse_scenario({"robots": 2, "all": {"base": "simulated"}}, "lab.toml", name="lab")

    async def test_a_base_alone_subscribes_to_its_own_commands_and_several_to_all(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        names: list[str] = []
        latest = Bus.latest
        monkeypatch.setattr(
            Bus, "latest", lambda bus, channel, name="": names.append(name) or latest(bus, channel, name)
        )
        for wheels in ({"r1": Wheels()}, {"r1": Wheels(), "r2": Wheels()}):
            async with make_bus(MemoryNetwork().link()) as bus:
                task = asyncio.create_task(run_bases(bus, wheels, bus.clock))
                await asyncio.sleep(0)
                task.cancel()
                await asyncio.wait({task})
        assert names == ["r1", "*"]

    async def test_a_robot_that_the_settings_do_not_have_is_refused(self) -> None:
        with pytest.raises(ConfigError, match=r"^base r9: got 'r9', expected one of r1, r2"):
            await run_base_process(self.LAB, "r9")

    async def test_wheels_that_are_not_there_are_refused(self) -> None:
        with pytest.raises(ConfigError, match="nosuch"):
            await run_base_process(
                parse_scenario({"robots": 1, "all": {"base": "nosuch"}}, "lab.toml", name="lab"), "r1"
            )

    async def test_it_announces_itself_says_that_it_is_ready_and_drives_its_wheels(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        network, wheels = MemoryNetwork(), Wheels()
        opened: list[object] = []
        said: list[tuple[str, ...]] = []
        made: list[object] = []

        def bus(*given: object) -> Bus:
            opened.extend(given)
            return make_bus(network.link(), roles=[Role.BASE])

        def find(word: str) -> Any:
            made.append(word)
            return lambda *given: made.extend(given) or wheels

        monkeypatch.setattr(run, "open_bus", bus)
        monkeypatch.setattr(run, "ready", lambda *given: said.append(given))
        monkeypatch.setattr(run, "check_base", lambda *given: said.append(given))
        monkeypatch.setattr(run, "find", find)
        async with make_bus(network.link()) as agent:
            states, roster = agent.latest(channels.BASE, "r2"), agent.roster()
            task = asyncio.create_task(run_base_process(self.LAB, "r2"))
            await within(5, states.next(), "the base's state")
            assert roster.of("base") == {"r2"}
            agent.publisher(channels.CMD_VEL, "r2").put(VelocityCommand(v=0.2, omega=0.1))
            state = await within(5, states.next(), "the state with a command")
            assert not state.message.dead_man
            assert wheels.now == (0.2, 0.1)
            task.cancel()
            await asyncio.wait({task})
        assert said == [(self.LAB, "r2", "lab"), ("base", "r2")]
        assert opened == [self.LAB.bus, Role.BASE]
        assert made[:2] == ["simulated", self.LAB.robot["r2"]]
        assert len(made) == 3


async def test_processes_give_their_bases_the_limit_of_the_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    lab = parse_scenario(
        {"robots": 1, "timeouts": {"command": 0.7}, "separation": {"enabled": False}}, "lab.toml", name="lab"
    )
    given: asyncio.Queue[float] = asyncio.Queue()

    async def run_them(bus: Bus, wheels: object, clock: object, dead_man: float, limits: object) -> None:
        given.put_nowait(dead_man)
        await asyncio.Event().wait()

    async def begin(process: Coroutine[object, object, None]) -> float:
        task = asyncio.create_task(process)
        limit = await within(5, given.get(), "the limit")
        task.cancel()
        await asyncio.wait({task})
        return limit

    monkeypatch.setattr(run, "run_bases", run_them)
    monkeypatch.setattr(run, "open_bus", lambda *_: make_bus(MemoryNetwork().link(), roles=[Role.BASE]))
    assert await begin(run_base_process(lab, "r1")) == 0.7
    monkeypatch.setattr(simulator, "run_bases", run_them)
    async with make_bus(MemoryNetwork().link()) as bus:
        room = simulator.Room(bus, lab, 1, InlineExecutor())
        assert room.floor._watchdog == 0.7
        assert await begin(room.run()) == 0.7


class TestClocksThatMakeNoSense:
    def received(self, arrival: float) -> Received[VelocityCommand]:
        return Received("r1", VelocityCommand(v=0.2, omega=0.1, stamp=1.0, epoch=7), arrival, 0.0, 0.0)

    def test_a_command_of_no_age_is_refused(self) -> None:
        wheels = Wheels()
        base = Base("r1", wheels)
        base.obey(self.received(math.nan), 5.0)
        base.obey(self.received(5.0), math.nan)
        assert wheels.commanded == []

    def test_a_clock_that_returns_nan_stops_the_wheels(self) -> None:
        wheels = Wheels()
        base = Base("r1", wheels)
        base.obey(self.received(5.0), 5.0)
        base.beat(5.1)
        assert wheels.now == (0.2, 0.1)
        base.beat(math.nan)
        assert wheels.now == (0.0, 0.0)

    @pytest.mark.parametrize("back", [0.02, 0.3, 4.0])
    def test_a_clock_that_was_set_back_stops_the_wheels_until_the_next_command(self, back: float) -> None:
        wheels = Wheels()
        base = Base("r1", wheels)
        base.obey(self.received(5.0), 5.0)
        base.beat(5.0 - back)
        assert wheels.now == (0.0, 0.0)
        base.obey(self.received(5.1 - back), 5.1 - back)
        assert wheels.now == (0.2, 0.1)
