"""The score sheet: a typed value, whose fields define every key of ``report.json`` and of ``docs/scoresheet.md``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from muro_zenoh.scoring.circle import RADIUS_BAND, SETTLED_FOR, SPACING_BAND
from muro_zenoh.scoring.density import BINS
from muro_zenoh.scoring.deployment import Coverage
from muro_zenoh.scoring.goals import NEAR, REST, GoalResult
from muro_zenoh.scoring.observed import STATIONARY_SPEED, STATIONARY_TURNING_RATE
from muro_zenoh.scoring.rows import Row, Table
from muro_zenoh.scoring.spread import DelaySpread, ErrorSpread


@dataclass(frozen=True, slots=True)
class Calibration(Table):
    """A robot's drive calibration, estimated and true."""

    cal0: Annotated[float | None, Row("the estimated factor on omega, at the end", digits=4)]
    calD: Annotated[  # noqa: N815 - the channel's name
        float | None, Row("the estimated factor on v, at the end", digits=4)
    ]
    true_cal0: Annotated[float | None, Row("one over the simulator's hidden scale of omega", digits=4)]
    true_calD: Annotated[float | None, Row("one over the simulator's hidden scale of v", digits=4)]  # noqa: N815
    error: Annotated[float | None, Row("the larger relative error of the two, at the end", digits=4)]
    error_after_10s: Annotated[
        float | None, Row(f"the same, 10 s after the robot was first within {RADIUS_BAND:g} m of the circle", digits=4)
    ]


@dataclass(frozen=True, slots=True)
class ProcessUse(Table):
    """Processor time and memory of a process."""

    cpu_percent: Annotated[
        float | None,
        Row(
            "processor time, user and system, of one core, in scenario time, over all restarts of the process (up "
            "to one second before it dies is not counted)",
            "%",
            2,
        ),
    ]
    rss_mb: Annotated[
        float | None,
        Row(
            "largest resident memory seen, read once a second, in 10^6 bytes; memory that processes share counts in "
            "each",
            "MB",
            1,
        ),
    ]


@dataclass(frozen=True, slots=True)
class FaultResult(Table):
    """A fault of the scenario, and what became of it."""

    kind: Annotated[str, Row("its kind, as in the scenario's `[[fault]]`, in the order of the scenario")]
    target: Annotated[str, Row("its target, likewise")]
    begin_s: Annotated[float | None, Row("scenario time at which it began; `null` when it did not", "s", 3)]
    end_s: Annotated[float | None, Row("scenario time at which it ended; `null` when it did not", "s", 3)]
    stamp: Annotated[float | None, Row("when it began, as messages are stamped, in seconds since 1970", "s", 3)]
    note: Annotated[str, Row("why it had no effect, such as that the process was not running; empty otherwise")]


@dataclass(frozen=True, slots=True)
class CheckResult(Table):
    """A check that the scenario makes, and its result."""

    value: Annotated[float | None, Row("the value reached")]
    limit: Annotated[float, Row("the scenario's limit")]
    passed: Annotated[bool, Row("whether it is met; an unknown value does not meet a check")]


@dataclass(frozen=True, slots=True)
class ScoreSheet(Table):
    """The score sheet of a run. Its fields are the keys of ``report.json``, in their order."""

    scenario: Annotated[str, Row("the scenario's name")]
    robots: Annotated[int, Row("number of robots")]
    duration_s: Annotated[float, Row("elapsed scenario time", "s", 2)]
    seed: Annotated[int | None, Row("the simulator's seed, for starts, hidden drive errors and noise")]
    ended: Annotated[
        str,
        Row(
            "`duration`: as planned; `interrupted`: by a signal; `failed`: a process could not be kept alive",
        ),
    ]
    settle_time_s: Annotated[
        float | None,
        Row(
            f"the first scenario time from which, for at least {SETTLED_FOR:g} s, no sample has a robot more than "
            f"{RADIUS_BAND:g} m off the circle or (if the robots are to spread evenly) a spacing error above "
            f"{SPACING_BAND:g} rad, and every robot's truth is known; `null` when there is none, and unless the robots "
            "are to follow the circle",
            "s",
            2,
        ),
    ]
    radius_error_m: Annotated[
        ErrorSpread,
        Row(
            "the distance of a robot from the circle's line, over all robots and samples of the window; `null` unless "
            "the robots are to follow the circle",
            "m",
            5,
        ),
    ]
    radius_error_by_robot_m: Annotated[
        Mapping[str, ErrorSpread], Row("the same distance, of one robot", "m", 5, by="robot")
    ]
    spacing_error_rad: Annotated[
        ErrorSpread,
        Row(
            "the largest \\|gap - 2 pi / N\\| between neighbours around the circle's centre, N all robots of the "
            "scenario, over the samples of the window in which every robot's truth is known; 0 for one robot; the same "
            "for both directions of travel; `null` unless the robots are to spread evenly",
            "rad",
            5,
        ),
    ]
    goals_asked: Annotated[int, Row("number of goals in the scenario (`[goals]`)")]
    goals_reached: Annotated[
        int,
        Row(
            f"number of goals at which their robot came to rest, within {NEAR:g} m, in order; a robot is at rest when "
            f"it is slower than {STATIONARY_SPEED:g} m/s and {STATIONARY_TURNING_RATE:g} rad/s for at least {REST:g} s"
        ),
    ]
    goals_missed: Annotated[
        int | None, Row("`goals_asked` minus `goals_reached`; `null` when the scenario has no goals")
    ]
    goal_distance_m: Annotated[
        float | None,
        Row("the largest distance from a goal of the robot at rest there; `null` when none was reached", "m", 4),
    ]
    goal_heading_rad: Annotated[
        float | None,
        Row(
            "the largest angle between the heading of a goal and that of the robot at rest there; `null` "
            "when no goal with a heading was reached",
            "rad",
            4,
        ),
    ]
    goals: Annotated[
        Mapping[str, tuple[GoalResult, ...]],
        Row(by="robot"),
    ]
    tracking_error_m: Annotated[
        ErrorSpread,
        Row(
            "the distance of a robot from its newest planned path (`muro/path/<robot>`), over all robots and samples "
            "in which the robot drove, and had not been diverted from that path to keep clear of others; `null` unless "
            "the robots plan paths",
            "m",
            5,
        ),
    ]
    peak_speed_ratio: Annotated[
        float | None,
        Row(
            "a robot's maximum true speed on a straight of its path over `v_min`, its speed on arcs; the minimum over "
            "all robots",
            digits=3,
        ),
    ]
    command_ratio: Annotated[
        float | None,
        Row(
            "the largest commanded forward or turning speed (`muro/cmd_vel/<robot>`) over the robot's `v_max` or "
            "`omega_max`; recorded only when a check needs it",
            digits=4,
        ),
    ]
    coverage: Annotated[Coverage, Row()]
    density_error: Annotated[
        float | None,
        Row(
            f"total variation distance, in {BINS} parts of the circle, of the positions of all robots in the window "
            "from the importance: half the sum of \\|share of the samples - share of the importance\\|; `null` unless "
            "the circle has an importance",
            digits=4,
        ),
    ]
    truth_known: Annotated[float, Row("fraction of all robots in all samples whose truth was known", digits=4)]
    min_separation_m: Annotated[
        float | None,
        Row(
            "smallest distance between two robots' centres since the simulator's start, in its own steps; `null` for "
            "one robot",
            "m",
            4,
        ),
    ]
    collisions: Annotated[
        int | None,
        Row(
            "episodes of two centres closer than the sum of the radii since the simulator's start, in its own steps; "
            "bodies pass through each other"
        ),
    ]
    wall_contacts: Annotated[
        int | None,
        Row(
            "episodes of a body that reaches over a wall inside the arena (`[[wall]]`) or over the arena's edge, since "
            "the simulator's start, in its own steps; bodies pass through walls"
        ),
    ]
    pose_age_ms: Annotated[
        DelaySpread,
        Row(
            "the time from a frame's capture to the estimate that used its pose, on the agent's clock, over all "
            "estimates of all robots",
            "ms",
            2,
        ),
    ]
    pose_to_command_ms: Annotated[
        DelaySpread,
        Row(
            "the time from the arrival of a pose at an agent to the command that followed from it, over all robots",
            "ms",
            3,
        ),
    ]
    fix_rate_hz: Annotated[
        Mapping[str, float | None],
        Row(
            "poses that the agent's filter accepted, per second of scenario time; time in which the agent was dead "
            "counts",
            "Hz",
            2,
            by="robot",
        ),
    ]
    calibration: Annotated[Mapping[str, Calibration], Row(by="robot")]
    never_seen: Annotated[tuple[str, ...], Row("the robots that no camera ever saw")]
    stopped_s: Annotated[
        Mapping[str, float],
        Row("scenario time under a stop order, as the robot's agent reported it", "s", 1, by="robot"),
    ]
    failures: Annotated[
        Mapping[str, str],
        Row(
            "why the robot's behaviour failed, or ended before the run did; of the robots whose behaviour did",
            by="robot",
        ),
    ]
    faults: Annotated[tuple[FaultResult, ...], Row()]
    restarts: Annotated[int, Row("number of restarts of processes that died")]
    processes: Annotated[Mapping[str, ProcessUse], Row(by="process")]
    checks: Annotated[Mapping[str, CheckResult], Row(by="check")]
    passed: Annotated[
        bool | None,
        Row(
            "`false` when the run ended before its duration, a behaviour failed or ended before the run did, or a "
            "check is not met; otherwise `true`, or `null` when the scenario makes no checks"
        ),
    ]
