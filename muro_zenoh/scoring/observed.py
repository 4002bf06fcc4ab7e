"""What was seen of a run: the input of its score sheet."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, NamedTuple

from muro_zenoh.geometry import Circle
from muro_zenoh.planning.path import Path

if TYPE_CHECKING:
    from muro_zenoh.scoring.expectations import Asked
    from muro_zenoh.scoring.sheet import ProcessUse

SAMPLE_PERIOD: Final = 0.1
"""Time from one sample of the fleet to the next [s]."""

STATIONARY_SPEED: Final = 0.01
"""A robot slower than this [m/s] ..."""

STATIONARY_TURNING_RATE: Final = 0.05
"""... that turns slower than this, too, is stationary [rad/s]."""


class Body(NamedTuple):
    """A robot as it truly is: x, y [m, world], theta [rad], v [m/s], omega [rad/s]."""

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
    """A robot at one scenario time ``t`` [s]."""

    t: float
    body: Body


class Planned(NamedTuple):
    """A path, and the scenario time ``t`` from which on the robot followed it [s]."""

    t: float
    path: Path


class Sample(NamedTuple):
    """The fleet at one moment.

    Attributes:
        t: scenario time [s].
        positions: x, y [m, world] of each robot whose truth is known then.
        circle: the circle to follow then.
        bodies: each robot whose truth is known then, with heading and speeds.
        stopped: the robots that were under a stop order then.
    """

    t: float
    positions: Mapping[str, tuple[float, float]]
    circle: Circle
    bodies: Mapping[str, Body] = MappingProxyType({})
    stopped: frozenset[str] = frozenset()


class Calibrated(NamedTuple):
    """A robot's drive calibrations, found and true.

    Attributes:
        cal0: found; multiplies omega.
        calD: found; multiplies v.
        s_omega: hidden: the robot turns this many times what its wheels report.
        s_v: hidden: the robot drives this many times what its wheels report.
    """

    cal0: float | None = None
    calD: float | None = None  # noqa: N815 - the channel's name
    s_omega: float | None = None
    s_v: float | None = None

    @property
    def error(self) -> float | None:
        """The larger relative error of the two against one over the hidden scale; None while one is not known."""
        if self.cal0 is None or self.calD is None or self.s_omega is None or self.s_v is None:
            return None
        return max(abs(self.cal0 * self.s_omega - 1.0), abs(self.calD * self.s_v - 1.0))


@dataclass(frozen=True, slots=True)
class Observed:
    """What was seen of a run.

    Attributes:
        scenario: its name.
        robots: their names.
        duration: scenario time that passed [s].
        asked: what the scenario asks of its robots.
        seed: of the simulator.
        ended: ``duration``, ``interrupted`` or ``failed``.
        samples: the fleet at 10 Hz.
        pose_age: from capture to the estimate that used it [s], each.
        pose_to_command: from the arrival of a pose to the command that followed [s], each.
        fix_rate: accepted fixes per second, by robot [Hz].
        collisions: the simulator's count; None without a simulator.
        min_separation: smallest distance between two centres [m]; None without a simulator, or for one robot.
        calibration: cal0, calD, and the simulator's hidden scales of omega and v, by robot.
        calibration_error_10s: worst relative error of the two after 10 s of circling, by robot.
        restarts: of processes.
        processes: their use of the machine, by process.
        paths: the paths that each robot planned; empty when the scenario asks for none.
        command_ratio: the largest speed commanded of any robot over its limit; None when it was not recorded.
        seen: the robots that a camera saw.
        failures: why behaviours failed, or ended before the run did, by robot.
    """

    scenario: str
    robots: tuple[str, ...]
    duration: float
    asked: Asked
    seed: int | None = None
    ended: str = "duration"
    samples: Sequence[Sample] = ()
    pose_age: Sequence[float] = ()
    pose_to_command: Sequence[float] = ()
    fix_rate: Mapping[str, float | None] = field(default_factory=dict)
    collisions: int | None = None
    min_separation: float | None = None
    calibration: Mapping[str, Calibrated] = field(default_factory=dict)
    calibration_error_10s: Mapping[str, float | None] = field(default_factory=dict)
    restarts: int = 0
    processes: Mapping[str, ProcessUse] = field(default_factory=dict)
    paths: Mapping[str, Sequence[Planned]] = field(default_factory=dict)
    command_ratio: float | None = None
    seen: Collection[str] = ()
    failures: Mapping[str, str] = field(default_factory=dict)
