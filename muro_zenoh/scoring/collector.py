"""What is seen of a run while it goes on: from the bus, for the table and the score sheet."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from muro_zenoh import channels
from muro_zenoh.config import Scenario
from muro_zenoh.geometry import Circle, Pose2
from muro_zenoh.messages import Health, VelocityCommand
from muro_zenoh.planning.path import Path, Segment
from muro_zenoh.scoring.expectations import asked_of
from muro_zenoh.scoring.goals import Body, Planned
from muro_zenoh.scoring.sheet import RADIUS_BAND, SAMPLE_PERIOD, Calibrated, Observed, Sample, radius_error
from muro_zenoh.transport import Bus, Every, Received

TRUTH_FRESH = 0.5
"""A truth older than this is not known any more [s]; the simulator sends 20 a second."""

_CIRCLING = 10.0
"""Calibrations are looked at after so long on the circle [s]."""


@dataclass(slots=True)
class _Writer:
    """What one process's health has said since the scenario time began."""

    epoch: int
    last_fixes: float
    first_stamp: float
    last_stamp: float = 0.0
    fixes: float = 0.0


@dataclass(slots=True)
class _Contacts:
    """The simulator's counts through all its lives."""

    epoch: int = 0
    before: int = 0
    now: int = 0
    least: float | None = None
    scales: dict[str, float] = field(default_factory=dict)


class Collector:
    """Listens from the start on, and collects from :meth:`begin` on.

    Args:
        bus: the bus.
        scenario: whose robots are looked at.

    Attributes:
        health: the newest health of each process.
        latest: the newest sample.
    """

    def __init__(self, bus: Bus, scenario: Scenario) -> None:
        self._bus = bus
        self._scenario = scenario
        self._robots = scenario.robots
        self._health = bus.every(channels.HEALTH, "*", depth=4096)
        self._truth = bus.latest(channels.TRUTH, "*")
        self._circle = bus.latest(channels.CIRCLE)
        self._cal_omega = bus.latest(channels.CAL_OMEGA, "*")
        self._cal_v = bus.latest(channels.CAL_V, "*")
        self._paths = bus.every(channels.PATH, "*", depth=4096)
        # Only who asks for it pays for it.
        self._commands = (
            bus.every(channels.CMD_VEL, "*", depth=4096) if scenario.checks.command_ratio is not None else None
        )
        self._asked = asked_of(scenario)
        self._planned: dict[str, list[Planned]] = {name: [] for name in scenario.robots}
        self._command_ratio: float | None = None
        self._writers: dict[str, _Writer] = {}
        self._epochs: dict[str, int] = {}
        self._contacts = _Contacts()
        self._pose_age: list[float] = []
        self._pose_to_command: list[float] = []
        self._samples: list[Sample] = []
        self._began: float | None = None
        self._on_circle_since: dict[str, float] = {}
        self._error_after: dict[str, float | None] = {}
        self.health: dict[str, Health] = {}
        self.latest = Sample(0.0, {}, scenario.circle.circle)

    @property
    def elapsed(self) -> float:
        """Scenario time [s]; 0 before it begins."""
        return self._bus.clock.now() - self._began if self._began is not None else 0.0

    @property
    def samples(self) -> list[Sample]:
        """The fleet at 10 Hz so far."""
        return self._samples

    def begin(self) -> None:
        """Scenario time is 0 now."""
        self._began = self._bus.clock.now()
        self._epochs = {name: health.epoch for name, health in self.health.items()}

    async def run(self) -> None:
        """Collect until cancelled."""
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self.hear(), name="collect health")
            tasks.create_task(self._sample_at_10_hz(), name="collect samples")
            tasks.create_task(self._note_paths(), name="collect paths")
            if self._commands is not None:
                tasks.create_task(self._note_commands(self._commands), name="collect commands")

    # ---- health

    async def hear(self) -> None:
        """Take the health of every process as it comes, until cancelled."""
        async for received in self._health:
            self.health[received.name] = received.message
            if received.message.role == "simulator":
                self._note_simulator(received.message)
            if self._began is not None:
                self._note_health(received)

    def _note_health(self, received: Received[Health]) -> None:
        health = received.message
        fixes = health.numbers.get("fixes", 0.0)
        writer = self._writers.get(received.name)
        if writer is None:
            # The first one speaks of the time before, too, so it only marks where counting begins; unless its process
            # began after that.
            writer = self._writers[received.name] = _Writer(health.epoch, fixes, health.stamp)
            before = self._epochs.get(received.name, health.epoch)
            if before == health.epoch:
                return
            writer.epoch, writer.first_stamp = before, self._began or 0.0
        if health.epoch != writer.epoch:
            writer.epoch, writer.last_fixes = health.epoch, 0.0
        writer.fixes += max(0.0, fixes - writer.last_fixes)
        writer.last_fixes, writer.last_stamp = fixes, health.stamp
        self._pose_age += health.samples.get("pose_age_s", ())
        self._pose_to_command += health.samples.get("pose_to_command_s", ())

    def _note_simulator(self, health: Health) -> None:
        contacts = self._contacts
        if health.epoch != contacts.epoch:
            contacts.epoch, contacts.before, contacts.now = health.epoch, contacts.before + contacts.now, 0
        contacts.now = int(health.numbers.get("collisions", 0.0))
        least = health.numbers.get("min_separation_m")
        if least is not None:
            contacts.least = least if contacts.least is None else min(contacts.least, least)
        contacts.scales = {k: v for k, v in health.numbers.items() if k.startswith("scale_")}

    def fix_rate(self, robot: str) -> float | None:
        """Accepted fixes per second of scenario time, as far as it was reported.

        Args:
            robot: whose.
        """
        writer = self._writers.get(robot)
        if writer is None or writer.last_stamp <= writer.first_stamp:
            return None
        return writer.fixes / (writer.last_stamp - writer.first_stamp)

    def calibrated(self, robot: str) -> Calibrated:
        """The calibrations found, and what the simulator hides.

        Args:
            robot: whose.
        """
        cal_omega, cal_v = self._cal_omega.values().get(robot), self._cal_v.values().get(robot)
        scales = self._contacts.scales
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
            k = max(k + 1, math.floor((clock.now() - start) / SAMPLE_PERIOD))  # after a pause, none are made up for
            await asyncio.sleep(max(0.0, start + k * SAMPLE_PERIOD - clock.now()))
            self.take_sample()

    def take_sample(self) -> None:
        """Look at the fleet once."""
        bodies = self._bodies(self._bus.clock.now())
        places = {name: (body.x, body.y) for name, body in bodies.items()}
        self.latest = Sample(self.elapsed, places, self.circle, bodies)
        if self._began is not None:
            self._samples.append(self.latest)
            self._note_circling(self.latest)

    @property
    def circle(self) -> Circle:
        """The circle to follow: as it was heard, else as the scenario has it."""
        heard = self._circle.get()
        return heard.message.circle if heard is not None else self._scenario.circle.circle

    def _bodies(self, now: float) -> dict[str, Body]:
        heard = self._truth.values()
        return {
            name: Body(truth.message.x, truth.message.y, truth.message.theta, truth.message.v, truth.message.omega)
            for name in self._robots
            if (truth := heard.get(name)) is not None and truth.age(now) < TRUTH_FRESH
        }

    # ---- paths and commands

    async def _note_paths(self) -> None:
        async for received in self._paths:
            m = received.message
            if received.name in self._planned:
                path = Path(Pose2(m.x, m.y, m.theta), tuple(Segment(*segment) for segment in m.segments))
                self._planned[received.name].append(Planned(self.elapsed, path))

    async def _note_commands(self, commands: Every[VelocityCommand]) -> None:
        async for received in commands:
            robot = self._scenario.robot.get(received.name)
            if robot is not None:
                m = received.message
                ratio = max(abs(m.v) / robot.v_max, abs(m.omega) / robot.omega_max)
                self._command_ratio = max(self._command_ratio or 0.0, ratio)

    def _note_circling(self, sample: Sample) -> None:
        for name, place in sample.places.items():
            if name not in self._on_circle_since:
                if radius_error(place, sample.circle) <= RADIUS_BAND:
                    self._on_circle_since[name] = sample.t
            elif name not in self._error_after and sample.t - self._on_circle_since[name] >= _CIRCLING:
                self._error_after[name] = self.calibrated(name).error

    # ---- the end

    def observed(
        self,
        *,
        duration: float,
        seed: int | None,
        ended: str,
        restarts: int,
        processes: Mapping[str, Mapping[str, float | None]],
    ) -> Observed:
        """All that was seen.

        Args:
            duration: scenario time that passed [s].
            seed: of the simulator.
            ended: ``duration``, ``interrupted`` or ``failed``.
            restarts: of processes.
            processes: their use of the machine.
        """
        asked = self._asked
        contacts = self._contacts
        return Observed(
            scenario=self._scenario.name,
            robots=self._robots,
            duration=duration,
            seed=seed,
            ended=ended,
            follows_circle=asked.follows_circle,
            spreads=asked.spreads,
            samples=self._samples,
            pose_age=self._pose_age,
            pose_to_command=self._pose_to_command,
            fix_rate={name: self.fix_rate(name) for name in self._robots},
            collisions=contacts.before + contacts.now if contacts.epoch else None,
            min_separation=contacts.least,
            calibration={name: self.calibrated(name) for name in self._robots},
            calibration_error_10s=self._error_after,
            restarts=restarts,
            processes=processes,
            goals=asked.goals,
            paths=self._planned if asked.v_min is not None else {},
            v_min=asked.v_min,
            command_ratio=self._command_ratio,
            deployment=asked.deployment,
            importance=asked.importance,
        )
