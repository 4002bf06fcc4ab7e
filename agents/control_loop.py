"""One robot's control loop: fix -> filter -> state -> step -> safety -> command.

Events go in, messages come out. It uses no bus and no clock, so that a test, a replay or a fleet in virtual time runs
the same loop as a robot.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

from agents.drive import Drive
from agents.failure import FAILURES, OnFailure
from agents.outgoing import NO_CELL, NO_PATH, Outgoing, calibrations, estimate_message, shown
from agents.tracking import Tracking
from muro_zenoh import channels
from muro_zenoh.behaviours.interface import Behaviour, Intent, Seen, Snapshot, hold
from muro_zenoh.config import TIMEOUTS, RobotSettings, Timeouts
from muro_zenoh.estimation.pose_filter import PoseEstimate
from muro_zenoh.geometry import STILL, Circle, State, Twist2
from muro_zenoh.messages import MOST_NAMES, PoseFix, StopOrder, VelocityCommand
from muro_zenoh.runtime.waiting import without_numbers
from muro_zenoh.safety.gate import reasons_to_hold
from muro_zenoh.safety.separation import Separation
from muro_zenoh.safety.stop import StopLatch

_INTENT_TIMEOUT = 0.25
"""An intent older than this is ignored [s]."""

_PAUSE = 0.5
"""Not updated for this time, the process was frozen, or a behaviour has blocked it [s]. What was ordered meanwhile may
still be on its way, or lost."""


class Surroundings(NamedTuple):
    """What was received from other processes, at one moment: the ``circle``; the ``speed`` on ``velocity/<name>``
    [m/s], None when stale, and its age [s]; the ``snapshot`` of all robots, None when stale, and its age [s]; the
    ``wish`` of a hand at a stick on ``drive/<name>``, None when stale, and its age [s]."""

    circle: Circle | None = None
    speed: float | None = None
    speed_age: float = math.inf
    snapshot: Snapshot | None = None
    snapshot_age: float = math.inf
    wish: Twist2 | None = None
    wish_age: float = math.inf


class ControlLoop:
    """The loop of one robot. All times are from one local clock [s].

    Args:
        name: the robot's name.
        robot: its settings.
        timeouts: how old a pose and the positions may be, and when the base gives up a command.
        separation: keeps the robot clear of the others; None drives without.

    Attributes:
        tracking: what is known of where the robot is.
        drive: makes the commands.
        latch: the stop latch.
        reasons: why the robot must not drive, most important first; empty while it may drive.
        seen: the observations at the newest estimate; None before the first.
        changed: whether the latch, the stopped names or the reasons have changed; the health report clears it.
        commands: number of commands sent since the start.
        stopped_names: the robots that stop orders name: the newest one, and all that came since and are not newer.
            An operator's may be one of those, and a robot that it stopped may forget it, because its agent restarts.
    """

    def __init__(
        self, name: str, robot: RobotSettings, timeouts: Timeouts = TIMEOUTS, separation: Separation | None = None
    ) -> None:
        self.tracking = Tracking(robot, timeouts.command)
        self.drive = Drive(robot, separation)
        self.latch = StopLatch()
        self.reasons: tuple[str, ...] = ()
        self.seen: Seen | None = None
        self.changed = False
        self.commands = 0
        self.stopped_names: frozenset[str] = frozenset()
        self._name = name
        self._robot = robot
        self._timeouts = timeouts
        self._estimate: PoseEstimate | None = None
        self._around = Surroundings()
        self._behaviour: Behaviour | None = None
        self._on_failure: OnFailure | None = None
        self._intent = hold("no behaviour yet")
        self._intended = -math.inf
        self._sent = -math.inf
        self._calibrated = -math.inf
        self._updated = math.inf
        self._paused = 0.0
        self._ended = False
        self._path_shown = self._cell_shown = False

    # ---- events

    def update(
        self,
        now: float,
        fixes: Iterable[tuple[float, PoseFix]],
        odometry: Iterable[tuple[float, float, float]],
        around: Surroundings,
        earlier: Iterable[Snapshot] = (),
    ) -> Outgoing:
        """Estimate, step the behaviour, command; called at each fix, and by the clock when a fix is overdue.

        Args:
            now: the time.
            fixes: new fixes, each with its time of capture.
            odometry: new rows t [s], v [m/s], omega [rad/s], in order.
            around: what was received from other processes.
            earlier: snapshots that came before that one, since the last time.
        """
        if self._ended:
            return []
        self._note_time(now)
        if now - self._updated > _PAUSE:
            self._paused = now - self._updated
        self._updated, self._around = now, around
        self.tracking.take(now, fixes, odometry)
        self.drive.learn(now, earlier)
        out: Outgoing = []
        estimate = self._estimate = self.tracking.filter.at(now)
        if estimate is not None:
            seen = self.seen = self._look(now, estimate, around)
            out.append((channels.ESTIMATE, estimate_message(now, estimate)))
            if now - self._calibrated >= channels.CAL_V.period:
                self._calibrated = now
                out += calibrations(estimate)
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
            self._note_time(now)
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
        known = names if self.latch.revision == latch.revision else frozenset()
        new = [name for name in dict.fromkeys(order.names) if name not in known]
        # A stranger with ever new names must not fill the memory.
        self.stopped_names = known.union(new[: MOST_NAMES - len(known)])
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

    def _note_time(self, now: float) -> None:
        """When the clock was set back, nobody knows how old what is known is: it is forgotten."""
        if now < self._updated < math.inf:
            self._updated, self._around, self._estimate = now, Surroundings(), None
            self._intended = self._sent = self._calibrated = -math.inf
            self.tracking.forget()

    # ---- from fix to state

    def _look(self, now: float, estimate: PoseEstimate, around: Surroundings) -> Seen:
        return Seen(
            now,
            State(estimate.x, estimate.y, estimate.theta, estimate.v, estimate.omega),
            self.tracking.filter.look_ahead(estimate, now, self._robot.lag),
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
        messages = shown(intent)  # may raise: before anything is kept
        self._intent, self._intended = intent, now
        out += messages
        self._path_shown |= intent.path is not None
        self._cell_shown |= intent.cell is not None
        if intent.twist is None and self._path_shown:  # it has arrived, or its behaviour has ended
            self._path_shown = False
            out += NO_PATH
        if intent.twist is None and self._behaviour is None and self._cell_shown:
            self._cell_shown = False
            out += NO_CELL

    def _command(self, now: float, out: Outgoing) -> None:
        estimate, intent, around = self._estimate, self._intent, self._around
        since = now - self._updated if math.isfinite(self._updated) else 0.0
        if estimate is not None and since > 0.0:  # a behaviour that is a task of its own commands between updates
            estimate = self.tracking.filter.at(now)
        snapshot_age = around.snapshot_age + since
        # A behaviour that is stepped at each estimate has not been stepped before the first: only the pose is missing.
        stepped = self._behaviour is None or estimate is not None
        reasons = reasons_to_hold(
            latch=self.latch,
            pause=self._paused,
            fix_age=now - estimate.t_fix if estimate is not None else math.inf,
            fix_limit=self._timeouts.pose,
            snapshot_age=snapshot_age if self.drive.needs_positions else 0.0,
            snapshot_limit=self._timeouts.snapshot,
            twist_age=now - self._intended if stepped else 0.0,
            twist_limit=_INTENT_TIMEOUT,
            hold=intent.reason if stepped and intent.twist is None else "",
        )
        command = STILL
        if estimate is not None:
            snapshot = around.snapshot._replace(age=snapshot_age) if around.snapshot is not None else None
            twist = intent.twist if not reasons else None
            command = self.drive.command(now, estimate, twist, snapshot, intent.target)
        self.changed |= without_numbers(reasons) != without_numbers(self.reasons)
        self.reasons = reasons
        self._sent = now
        self.commands += 1
        self.tracking.filter.command(now, command.v, command.omega)
        out.append((channels.CMD_VEL, VelocityCommand(stamp=now, v=command.v, omega=command.omega)))
