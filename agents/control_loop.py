"""One robot's control loop: fix -> filter -> state -> step -> safety -> command.

Events go in, messages come out. It uses no bus and no clock, so that a test, a replay or a fleet in virtual time runs
the same loop as a robot.
"""

from __future__ import annotations

import logging
import math
from collections import Counter
from collections.abc import Iterable
from typing import Any, NamedTuple

from agents.failure import FAILURES, OnFailure
from muro_zenoh import channels
from muro_zenoh.behaviours.interface import Behaviour, Intent, Seen, Snapshot, hold
from muro_zenoh.channels import Channel
from muro_zenoh.config import TIMEOUTS, RobotSettings, Timeouts
from muro_zenoh.errors import ParameterError
from muro_zenoh.estimation.pose_filter import FilterSettings, PoseEstimate, PoseFilter
from muro_zenoh.geometry import STILL, Circle, State
from muro_zenoh.messages import (
    Calibration,
    Cell,
    Estimate,
    Message,
    PlannedPath,
    PoseFix,
    SpeedReference,
    StopOrder,
    VelocityCommand,
)
from muro_zenoh.runtime.waiting import without_numbers
from muro_zenoh.safety.gate import reasons_to_hold
from muro_zenoh.safety.limits import calibrate_and_limit
from muro_zenoh.safety.stop import StopLatch

log = logging.getLogger(__name__)

Outgoing = list[tuple[Channel[Any], Message]]
"""Messages to send, each under this robot's name."""

_INTENT_TIMEOUT = 0.25
"""An intent older than this is ignored [s]."""

_PAUSE = 0.5
"""Not updated for this time, the process was frozen, or a behaviour has blocked it [s]. What was ordered meanwhile may
still be on its way, or lost."""

_FASTEST = 4.0
"""Odometry faster than this multiple of the robot's limits is invalid."""


class Surroundings(NamedTuple):
    """What was received from other processes, at one moment: the ``circle``; the ``speed`` on ``velocity/<name>``
    [m/s], None when stale, and its age [s]; the ``snapshot`` of all robots, None when stale, and its age [s]."""

    circle: Circle | None = None
    speed: float | None = None
    speed_age: float = math.inf
    snapshot: Snapshot | None = None
    snapshot_age: float = math.inf


class ControlLoop:
    """The loop of one robot. All times are from one local clock [s].

    Args:
        name: the robot's name.
        robot: its settings.
        timeouts: how old a pose may be, and when the base gives up a command.

    Attributes:
        latch: the stop latch.
        reasons: why the robot must not drive, most important first; empty while it may drive.
        seen: the observations at the newest estimate; None before the first.
        changed: whether the latch, the stopped names or the reasons have changed; the health report clears it.
        fixes: number of accepted fixes since the start.
        commands: number of commands sent since the start.
        stopped_names: the robots that stop orders name: the newest one, and all that came since and are not newer.
            An operator's may be one of those, and a robot that it stopped may forget it, because its agent restarts.
        refused: number of fixes and odometry messages that were refused since the start, by reason.
        pose_ages: for each accepted fix, the time from capture to the estimate that used it [s]; the health report
            clears it.
    """

    def __init__(self, name: str, robot: RobotSettings, timeouts: Timeouts = TIMEOUTS) -> None:
        self.latch = StopLatch()
        self.reasons: tuple[str, ...] = ()
        self.seen: Seen | None = None
        self.changed = False
        self.fixes = 0
        self.commands = 0
        self.stopped_names: frozenset[str] = frozenset()
        self.refused: Counter[str] = Counter()
        self.pose_ages: list[float] = []
        self._name = name
        self._robot = robot
        self._timeouts = timeouts
        settings = FilterSettings(odometry_timeout=channels.ODOMETRY.stale_after, command_timeout=timeouts.command)
        self._history = settings.history
        self._filter = PoseFilter(settings, robot.wheels)
        self._estimate: PoseEstimate | None = None
        self._behaviour: Behaviour | None = None
        self._on_failure: OnFailure | None = None
        self._intent = hold("no behaviour yet")
        self._intended = -math.inf
        self._sent = -math.inf
        self._calibrated = -math.inf
        self._updated = math.inf
        self._paused = 0.0
        self._ended = False

    # ---- events

    def update(
        self,
        now: float,
        fixes: Iterable[tuple[float, PoseFix]],
        odometry: Iterable[tuple[float, float, float]],
        around: Surroundings,
    ) -> Outgoing:
        """Estimate, step the behaviour, command; called at each fix, and by the clock when a fix is overdue.

        Args:
            now: the time.
            fixes: new fixes, each with its time of capture.
            odometry: new rows t [s], v [m/s], omega [rad/s], in order.
            around: what was received from other processes.
        """
        if self._ended:
            return []
        if now - self._updated > _PAUSE:
            self._paused = now - self._updated
        self._updated = now
        for t, v, omega in odometry:
            if self._is_possible(now, t, v, omega):
                self._filter.twist(t, v, omega)
            else:
                self.refused["odometry"] += 1
        for captured, fix in fixes:
            self._take(now, captured, fix)
        out: Outgoing = []
        estimate = self._estimate = self._filter.at(now)
        if estimate is not None:
            seen = self.seen = self._look(now, estimate, around)
            out.append((channels.ESTIMATE, _estimate_message(now, estimate)))
            if now - self._calibrated >= channels.CAL_V.period:
                self._calibrated = now
                out.append((channels.CAL_V, _calibration(estimate.s_v, estimate.sigma_v)))
                out.append((channels.CAL_OMEGA, _calibration(estimate.s_omega, estimate.sigma_omega)))
            if self._behaviour is not None:
                self._step(now, self._behaviour, seen, out)
                self._command(now, out)
                return out
        # A behaviour that is a task of its own commands by want(); here its command is only repeated or set to zero.
        # It is repeated three times before the base's dead-man gives it up.
        if now - self._sent >= self._timeouts.command / 3.0:
            self._command(now, out)
        return out

    def behave(self, behaviour: Behaviour | None, on_failure: OnFailure | None = None) -> None:
        """Step this behaviour from now on; None for a behaviour that is a task of its own and calls :meth:`want`.

        Args:
            behaviour: the behaviour.
            on_failure: called with what a step raises; the behaviour is not stepped again. None to raise it, in tests.
        """
        self._behaviour, self._on_failure = behaviour, on_failure

    def want(self, now: float, intent: Intent) -> Outgoing:
        """Take a behaviour's intent, and command.

        Args:
            now: the time.
            intent: the intent.

        Raises:
            ValueError: a number in it that cannot be driven or sent; the intent before stays in force.
        """
        out: Outgoing = []
        if not self._ended:
            self._intend(now, intent, out)
            self._command(now, out)
        return out

    def take_stop(self, now: float, order: StopOrder, age: float = 0.0) -> Outgoing:
        """Take a stop order from any sender; command zero at once when it stops this robot.

        Args:
            now: the time.
            order: the order.
            age: of the order [s]. A stop counts at any age; only one that is not left over from a pause ends the wait
                for the stop state after it.
        """
        before = self.latch, self.stopped_names
        latch, names = before
        self.latch = latch.receive(self._name, all_robots=order.all, names=order.names, revision=order.revision)
        if age <= _PAUSE and order.revision == self.latch.revision:
            self._paused = 0.0
        # A newer order is the whole state; any other one stops more robots.
        self.stopped_names = (
            names.union(order.names) if self.latch.revision == latch.revision else frozenset(order.names)
        )
        self.changed |= (self.latch, self.stopped_names) != before
        out: Outgoing = []
        if not self.latch.may_drive and not self._ended:
            self._command(now, out)
        return out

    def end(self, now: float) -> Outgoing:
        """The last command: zero. No command follows it, even when a behaviour that has not ended still calls.

        Args:
            now: the time.
        """
        self._behaviour = None
        out = self.want(now, hold("the agent is shutting down"))
        self._ended = True
        return out

    # ---- from fix to state

    def _take(self, now: float, captured: float, fix: PoseFix) -> None:
        if not now - self._history <= captured <= now:
            self.refused["fix untimely"] += 1
            return
        result = self._filter.fix(captured, fix.x, fix.y, fix.theta, fix.covariance)
        if result.accepted:
            self.fixes += 1
            self.pose_ages.append(now - captured)
        else:
            self.refused[f"fix {result.reason}"] += 1
        if result.restarted:
            log.warning("the fixes disagree with the track: restarting the filter at (%.2f, %.2f)", fix.x, fix.y)

    def _is_possible(self, now: float, t: float, v: float, omega: float) -> bool:
        """Whether odometry has a recent time and speeds that these wheels could have."""
        return (
            now - self._history <= t <= now
            and abs(v) <= _FASTEST * self._robot.v_max
            and abs(omega) <= _FASTEST * self._robot.omega_max
        )

    def _look(self, now: float, estimate: PoseEstimate, around: Surroundings) -> Seen:
        return Seen(
            now,
            State(estimate.x, estimate.y, estimate.theta, estimate.v, estimate.omega),
            self._filter.look_ahead(estimate, now, self._robot.lag),
            *around,
            self.stopped_names,
            not self.reasons,
        )

    # ---- from intent to command

    def _step(self, now: float, behaviour: Behaviour, seen: Seen, out: Outgoing) -> None:
        """Step the behaviour. One that raises, or wants what cannot be driven or sent, is not stepped again."""
        try:
            self._intend(now, behaviour.step(seen), out)
        except FAILURES as error:
            if self._on_failure is None:
                raise
            self._behaviour = None
            self._intend(now, hold(self._on_failure(error)), out)

    def _intend(self, now: float, intent: Intent, out: Outgoing) -> None:
        shown = _shown(intent)  # may raise: before anything is kept
        self._intent, self._intended = intent, now
        out += shown

    def _command(self, now: float, out: Outgoing) -> None:
        estimate, intent = self._estimate, self._intent
        # A behaviour that is stepped at each estimate has not been stepped before the first: only the pose is missing.
        stepped = self._behaviour is None or estimate is not None
        reasons = reasons_to_hold(
            latch=self.latch,
            pause=self._paused,
            fix_age=now - estimate.t_fix if estimate is not None else math.inf,
            fix_limit=self._timeouts.pose,
            twist_age=now - self._intended if stepped else 0.0,
            twist_limit=_INTENT_TIMEOUT,
            hold=intent.reason if stepped and intent.twist is None else "",
        )
        command = STILL
        if not reasons and estimate is not None and intent.twist is not None:
            command = calibrate_and_limit(
                intent.twist,
                cal_v=1.0 / estimate.s_v,
                cal_omega=1.0 / estimate.s_omega,
                v_max=self._robot.v_max,
                omega_max=self._robot.omega_max,
            )
        self.changed |= without_numbers(reasons) != without_numbers(self.reasons)
        self.reasons = reasons
        self._sent = now
        self.commands += 1
        self._filter.command(now, command.v, command.omega)
        out.append((channels.CMD_VEL, VelocityCommand(stamp=now, v=command.v, omega=command.omega)))


def _shown(intent: Intent) -> Outgoing:
    """What others see of an intent; raises for one that cannot be driven or sent."""
    if intent.twist is not None and not all(map(math.isfinite, intent.twist)):
        raise ParameterError("twist", got=repr(intent.twist), expected="finite numbers [m/s, rad/s]")
    out: Outgoing = []
    if intent.speed is not None:
        out.append((channels.VELOCITY, SpeedReference(speed=intent.speed)))
    if intent.path is not None:
        x, y, theta = intent.path.start
        segments = tuple((segment.length, segment.curvature) for segment in intent.path.segments)
        path = PlannedPath(x=x, y=y, theta=theta, segments=segments, goal_theta=intent.path_has_heading)
        out.append((channels.PATH, path))
    if intent.cell is not None:
        out.append((channels.CELL, Cell(corners=intent.cell.corners, x=intent.cell.x, y=intent.cell.y)))
    return out


def _estimate_message(now: float, estimate: PoseEstimate) -> Estimate:
    return Estimate(
        stamp=now,
        x=estimate.x,
        y=estimate.y,
        theta=estimate.theta,
        v=estimate.v,
        omega=estimate.omega,
        covariance=estimate.covariance9,
    )


def _calibration(scale: float, sigma: float) -> Calibration:
    """The factor that corrects a drive scale, and its standard deviation to first order."""
    return Calibration(value=1.0 / scale, sigma=sigma / scale**2)
