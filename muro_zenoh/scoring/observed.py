"""The data observed in a run: the input of its score sheet."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, NamedTuple

from muro_zenoh.geometry import Circle
from muro_zenoh.planning.path import Path

if TYPE_CHECKING:
    from muro_zenoh.behaviours.interface import Expectation
    from muro_zenoh.scoring.sheet import ProcessUse

SAMPLE_PERIOD: Final = 0.1
"""Period of the samples of the fleet [s]."""

STATIONARY_SPEED: Final = 0.01
"""A stationary robot is slower than this [m/s] ..."""

STATIONARY_TURNING_RATE: Final = 0.05
"""... and turns slower than this [rad/s]."""


class Body(NamedTuple):
    """A robot's true state: x, y [m, world], theta [rad], v [m/s], omega [rad/s]."""

    x: float
    y: float
    theta: float
    v: float
    omega: float

    @property
    def stationary(self) -> bool:
        """Whether it neither drives nor turns."""
        return abs(self.v) < STATIONARY_SPEED and abs(self.omega) < STATIONARY_TURNING_RATE


class Moment(NamedTuple):
    """A robot at one scenario time ``t`` [s]; ``diverted`` as in :class:`Sample`."""

    t: float
    body: Body
    diverted: bool = False


class Planned(NamedTuple):
    """A path, and the scenario time ``t`` from which the robot followed it [s]."""

    t: float
    path: Path


class Sample(NamedTuple):
    """The fleet at one moment.

    Attributes:
        t: scenario time [s].
        positions: true x, y [m, world] by robot, for those known at this time.
        circle: the circle to follow at this time.
        bodies: true states by robot, for those known at this time.
        stopped: the robots that were stopped by order at this time.
        diverted: the robots whose newest health says that they drove otherwise than their behaviours wanted.
    """

    t: float
    positions: Mapping[str, tuple[float, float]]
    circle: Circle
    bodies: Mapping[str, Body] = MappingProxyType({})
    stopped: frozenset[str] = frozenset()
    diverted: frozenset[str] = frozenset()


class Calibrated(NamedTuple):
    """A robot's drive calibrations, estimated and true.

    Attributes:
        cal0: estimated factor on omega.
        calD: estimated factor on v.
        s_omega: hidden scale: true over reported turning rate.
        s_v: hidden scale: true over reported speed.
    """

    cal0: float | None = None
    calD: float | None = None  # noqa: N815 - the channel's name
    s_omega: float | None = None
    s_v: float | None = None

    @property
    def error(self) -> float | None:
        """The larger relative error of the two against one over the hidden scale; None while one is unknown."""
        if self.cal0 is None or self.calD is None or self.s_omega is None or self.s_v is None:
            return None
        return max(abs(self.cal0 * self.s_omega - 1.0), abs(self.calD * self.s_v - 1.0))


class FaultSeen(NamedTuple):
    """What became of a fault of the scenario.

    Attributes:
        kind: as in the scenario.
        target: as in the scenario.
        begin: scenario time at which it began [s]; None when it did not.
        end: scenario time at which it ended [s]; None when it did not.
        stamp: when it began, by the clock of the machine [s since 1970]; None when it did not.
        note: why it had no effect; empty otherwise.
    """

    kind: str
    target: str
    begin: float | None = None
    end: float | None = None
    stamp: float | None = None
    note: str = ""


@dataclass(frozen=True, slots=True)
class Observed:
    """The data observed in a run.

    Attributes:
        scenario: its name.
        robots: their names.
        duration: elapsed scenario time [s].
        expected: what the robots should achieve.
        seed: the simulator's seed.
        ended: ``duration``, ``interrupted`` or ``failed``.
        samples: the fleet at 10 Hz.
        pose_age: for each pose, the time from capture to the estimate that used it [s].
        pose_to_command: for each pose, the time from its arrival to the command that used it [s].
        fix_rate: accepted fixes per second, by robot [Hz].
        collisions: the simulator's count; None without a simulator.
        wall_contacts: the same.
        min_separation: smallest distance between two centres [m]; None without a simulator, or for one robot.
        calibration: cal0, calD, and the simulator's hidden scales of omega and v, by robot.
        calibration_error_10s: worst relative error of the two after 10 s of circling, by robot.
        restarts: number of process restarts.
        processes: processor time and memory, by process.
        paths: the paths that each robot planned; empty when the scenario needs none.
        command_ratio: the largest commanded speed of any robot over its limit; None when it was not recorded.
        seen: the robots that a camera saw.
        failures: why behaviours failed, or ended before the run did, by robot.
        faults: what became of the scenario's faults, in their order.
    """

    scenario: str
    robots: tuple[str, ...]
    duration: float
    expected: Expectation
    seed: int | None = None
    ended: str = "duration"
    samples: Sequence[Sample] = ()
    pose_age: Sequence[float] = ()
    pose_to_command: Sequence[float] = ()
    fix_rate: Mapping[str, float | None] = field(default_factory=dict)
    collisions: int | None = None
    wall_contacts: int | None = None
    min_separation: float | None = None
    calibration: Mapping[str, Calibrated] = field(default_factory=dict)
    calibration_error_10s: Mapping[str, float | None] = field(default_factory=dict)
    restarts: int = 0
    processes: Mapping[str, ProcessUse] = field(default_factory=dict)
    paths: Mapping[str, Sequence[Planned]] = field(default_factory=dict)
    command_ratio: float | None = None
    seen: Collection[str] = ()
    failures: Mapping[str, str] = field(default_factory=dict)
    faults: Sequence[FaultSeen] = ()
