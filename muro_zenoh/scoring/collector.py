"""Collects data of a run from the bus, for the live table and the score sheet."""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Mapping, Sequence
from typing import Final

from muro_zenoh import channels
from muro_zenoh.config import Scenario
from muro_zenoh.geometry import Circle, Pose2
from muro_zenoh.messages import Health, VelocityCommand
from muro_zenoh.planning.path import Path, Segment
from muro_zenoh.scoring.circle import RADIUS_BAND, radius_error
from muro_zenoh.scoring.expectations import expectation_of
from muro_zenoh.scoring.observed import SAMPLE_PERIOD, Body, Calibrated, FaultSeen, Observed, Planned, Sample
from muro_zenoh.scoring.reports import AgentReports, SimulatorReports, keep_newest
from muro_zenoh.scoring.sheet import ProcessUse
from muro_zenoh.transport import Bus, Every, Received

log = logging.getLogger(__name__)

TRUTH_TIMEOUT: Final = 0.5
"""Maximum age of a truth message [s]; the simulator sends 20 a second."""

_MAX_PATHS: Final = 10_000
_MAX_SAMPLES: Final = 24 * 36_000
"""Number of samples kept: those of the last day."""

_CIRCLING: Final = 10.0
"""Calibrations are evaluated after this time on the circle [s]."""


class Collector:
    """Subscribes when it is created, and collects from :meth:`begin` on.

    Args:
        bus: the bus.
        scenario: the scenario whose robots are observed.

    Attributes:
        expected: what the robots should achieve.
        health: the newest health of each process, as it was received.
        latest: the newest sample.
    """

    def __init__(self, bus: Bus, scenario: Scenario) -> None:
        self._bus = bus
        self._scenario = scenario
        self._robots = scenario.robots
        self._health = bus.every(channels.HEALTH, "*", depth=4096)
        self._truth = bus.latest(channels.TRUTH, "*")
        self._bases = bus.latest(channels.BASE, "*")
        self._circle = bus.latest(channels.CIRCLE)
        self._cal_omega = bus.latest(channels.CAL_OMEGA, "*")
        self._cal_v = bus.latest(channels.CAL_V, "*")
        self._positions = bus.latest(channels.ALL_POSITIONS)
        self._paths = bus.every(channels.PATH, "*", depth=4096)
        # Recorded only when a check needs it, because these are many messages.
        self._commands = (
            bus.every(channels.CMD_VEL, "*", depth=4096) if scenario.checks.command_ratio is not None else None
        )
        self.expected = expectation_of(scenario)
        self._planned: dict[str, list[Planned]] = {name: [] for name in scenario.robots}
        self._command_ratio: float | None = None
        self._agents = AgentReports()
        self._simulator = SimulatorReports()
        self._samples: list[Sample] = []
        self._began: float | None = None
        self._on_circle_since: dict[str, float] = {}
        self._error_after: dict[str, float | None] = {}
        self._seen: set[str] = set()
        self._failures: dict[str, str] = {}
        self.health: dict[str, Received[Health]] = {}
        self.latest = Sample(0.0, {}, scenario.circle)

    @property
    def elapsed(self) -> float:
        """Scenario time [s]; 0 before it begins."""
        return self._bus.clock.now() - self._began if self._began is not None else 0.0

    @property
    def samples(self) -> list[Sample]:
        """Samples of the fleet so far, at 10 Hz."""
        return self._samples

    def begin(self) -> None:
        """Start scenario time at 0."""
        self._began = self._bus.clock.now()
        self._agents.begin(self._began, {name: health.message.epoch for name, health in self.health.items()})

    async def run(self) -> None:
        """Collect until cancelled."""
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self.collect_health(), name="collect health")
            tasks.create_task(self._sample_at_10_hz(), name="collect samples")
            tasks.create_task(self._collect_paths(), name="collect paths")
            if self._commands is not None:
                tasks.create_task(self._collect_commands(self._commands), name="collect commands")

    # ---- health

    async def collect_health(self) -> None:
        """Receive the health of every process until cancelled."""
        async for received in self._health:
            self.health[received.name] = received
            if received.message.failure:
                self._failures.setdefault(received.name, received.message.failure)
            if received.message.role == "simulator":
                self._simulator.add(received.message)
            if self._began is not None:
                self._agents.add(received.name, received.message)

    def silence(self, process: str) -> float | None:
        """The time since the newest health of a process [s]; None before the first.

        Args:
            process: its name.
        """
        health = self.health.get(process)
        return health.age(self._bus.clock.now()) if health is not None else None

    def wheels_stopped(self, robot: str) -> str:
        """Why a robot's wheels are not turning, as its base reports: its agent may be frozen, and say nothing yet.

        Args:
            robot: its name.

        Returns:
            The reason; empty when there is none, and before the first report of the base.
        """
        base = self._bases.values().get(robot)
        if base is None:
            return ""
        if base.age(self._bus.clock.now()) > channels.BASE.stale_after:
            return "its base is silent"
        return "its base receives no commands" if base.message.dead_man else ""

    def fix_rate(self, robot: str) -> float | None:
        """Reported accepted fixes per second of scenario time [Hz].

        Args:
            robot: its name.
        """
        return self._agents.fix_rate(robot)

    def calibrated(self, robot: str) -> Calibrated:
        """The estimated calibrations, and the simulator's hidden drive scales.

        Args:
            robot: its name.
        """
        cal_omega, cal_v = self._cal_omega.values().get(robot), self._cal_v.values().get(robot)
        scales = self._simulator.scales
        return Calibrated(
            cal_omega.message.value if cal_omega is not None else None,
            cal_v.message.value if cal_v is not None else None,
            scales.get(f"scale_omega_{robot}"),
            scales.get(f"scale_v_{robot}"),
        )

    # ---- samples

    async def _sample_at_10_hz(self) -> None:
        clock = self._bus.clock
        start, k = clock.now(), 0
        while True:
            k = max(k + 1, math.floor((clock.now() - start) / SAMPLE_PERIOD))  # samples missed in a pause are skipped
            await asyncio.sleep(max(0.0, start + k * SAMPLE_PERIOD - clock.now()))
            self.take_sample()

    def take_sample(self) -> None:
        """Take one sample of the fleet."""
        bodies = self._bodies(self._bus.clock.now())
        positions = {name: (body.x, body.y) for name, body in bodies.items()}
        stopped = frozenset(name for name, health in self.health.items() if health.message.stop_latched)
        diverted = frozenset(name for name, health in self.health.items() if health.message.note)
        self.latest = Sample(self.elapsed, positions, self.circle, bodies, stopped, diverted)
        snapshot = self._positions.get()
        if snapshot is not None:
            self._seen.update(robot.name for robot in snapshot.message.robots)
        if self._began is not None:
            self._samples.append(self.latest)
            keep_newest(self._samples, _MAX_SAMPLES)
            self._note_circling(self.latest)

    @property
    def circle(self) -> Circle:
        """The circle to follow: the newest one received, or the scenario's before the first."""
        received = self._circle.get()
        return received.message.circle if received is not None else self._scenario.circle

    def _bodies(self, now: float) -> dict[str, Body]:
        received = self._truth.values()
        return {
            name: Body(truth.message.x, truth.message.y, truth.message.theta, truth.message.v, truth.message.omega)
            for name in self._robots
            if (truth := received.get(name)) is not None and truth.age(now) < TRUTH_TIMEOUT
        }

    def _note_circling(self, sample: Sample) -> None:
        for name, position in sample.positions.items():
            if name not in self._on_circle_since:
                if radius_error(position, sample.circle) <= RADIUS_BAND:
                    self._on_circle_since[name] = sample.t
            elif name not in self._error_after and sample.t - self._on_circle_since[name] >= _CIRCLING:
                self._error_after[name] = self.calibrated(name).error

    # ---- paths and commands

    async def _collect_paths(self) -> None:
        async for received in self._paths:
            m = received.message
            planned = self._planned.get(received.name)
            if planned is None or not m.segments:  # no path any more: it has arrived
                continue
            try:
                path = Path(Pose2(m.x, m.y, m.theta), tuple(Segment(*segment) for segment in m.segments))
            except ValueError as error:
                log.warning("%s published an invalid path: %s", received.name, error)
                continue
            planned.append(Planned(self.elapsed, path))
            keep_newest(planned, _MAX_PATHS)

    async def _collect_commands(self, commands: Every[VelocityCommand]) -> None:
        async for received in commands:
            robot = self._scenario.robot.get(received.name)
            if robot is not None:
                m = received.message
                ratio = max(abs(m.v) / robot.v_max, abs(m.omega) / robot.omega_max)
                self._command_ratio = max(self._command_ratio or 0.0, ratio)

    # ---- the end

    def observed(
        self,
        *,
        duration: float,
        seed: int | None,
        ended: str,
        restarts: int,
        processes: Mapping[str, ProcessUse],
        faults: Sequence[FaultSeen] = (),
    ) -> Observed:
        """All collected data.

        Args:
            duration: elapsed scenario time [s].
            seed: the simulator's seed.
            ended: ``duration``, ``interrupted`` or ``failed``.
            restarts: of processes.
            processes: their use of the machine.
            faults: what became of the scenario's faults.
        """
        return Observed(
            scenario=self._scenario.name,
            robots=self._robots,
            duration=duration,
            expected=self.expected,
            seed=seed,
            ended=ended,
            samples=self._samples,
            pose_age=self._agents.pose_age,
            pose_to_command=self._agents.pose_to_command,
            fix_rate={name: self.fix_rate(name) for name in self._robots},
            collisions=self._simulator.collisions,
            wall_contacts=self._simulator.wall_contacts,
            min_separation=self._simulator.min_separation,
            calibration={name: self.calibrated(name) for name in self._robots},
            calibration_error_10s=self._error_after,
            restarts=restarts,
            processes=processes,
            paths=self._planned if self.expected.v_min is not None else {},
            command_ratio=self._command_ratio,
            seen=self._seen,
            failures=self._failures,
            faults=faults,
        )
