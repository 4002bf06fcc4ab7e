"""What a page shows: reads the bus as any operator may, and makes a state of it at each tick."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping
from typing import Any, Final

from basestation.dashboard.events import Events
from basestation.dashboard.frames import Frames
from basestation.dashboard.processes import Processes
from basestation.dashboard.ring import RingOf
from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.config import Scenario
from muro_zenoh.control import ring
from muro_zenoh.messages import BaseState, Behaviour, Cell, Goal, Health, Lease, PlannedPath, RobotState
from muro_zenoh.transport import Bus, Latest, Received

_COMMAND_TIMEOUT: Final = 0.5
"""A command that is older is not shown as the present one [s]."""

_SILENT: Final = channels.ALL_POSITIONS.stale_after
"""All positions that are older say nothing about now [s]."""

_SLOW_PERIOD: Final = 0.25
"""Time between two looks at what is slow [s]; what robots report when something changes is looked at in each tick."""

_PAGE: Final = "page"
"""This process among the others; nobody else needs to hear of it."""

_ROUTER: Final = "router"
"""The router among the processes: it says nothing itself, but nothing comes from anybody without it."""

_UNKNOWN: Final = (None,) * 8


class FleetWatch:
    """Reads what robots and base station say.

    Args:
        bus: the bus.
        scenario: the settings.

    Attributes:
        frames: the state as clients get it.
    """

    def __init__(self, bus: Bus, scenario: Scenario) -> None:
        self.frames = Frames()
        self._goals: dict[str, tuple[Any, list[float | None]]] = {}
        self._bus = bus
        self._scenario = scenario
        self._snapshot = bus.latest(channels.ALL_POSITIONS)
        self._commands = bus.latest(channels.CMD_VEL, "*")
        self._health = bus.latest(channels.HEALTH, "*")
        self._behaviours = bus.latest(channels.BEHAVIOUR, "*")
        self._circle = bus.latest(channels.CIRCLE)
        self._stop = bus.latest(channels.STOP)
        self._lease = bus.latest(channels.LEASE)
        self._bases = bus.latest(channels.BASE, "*")
        self._paths = bus.latest(channels.PATH, "*")
        self._cells = bus.latest(channels.CELL, "*")
        self._cal_v = bus.latest(channels.CAL_V, "*")
        self._cal_omega = bus.latest(channels.CAL_OMEGA, "*")
        self._faults = bus.latest(channels.FAULTS)
        self._roster = bus.roster()
        self._events = Events(self.frames)
        self._ring = RingOf(scenario)
        self._slow_at = -math.inf
        self._processes = Processes(scenario.robots, tuple(scenario.camera))
        self._began = bus.clock.now()
        self._processes_at = -math.inf

    @property
    def behaviours(self) -> Mapping[str, Behaviour]:
        """The behaviour of each robot, as far as it is known."""
        return _messages(self._behaviours)

    @property
    def leases(self) -> list[Lease]:
        """Those that are in force now, base station or not."""
        received = self._lease.get()
        if received is None:
            return []
        age = received.age(self._bus.clock.now())
        return [lease for lease in received.message.leases if age < lease.left]

    @property
    def can_be_broken(self) -> bool:
        """Whether this fleet is simulated, and a run is there that breaks it on an operator's order."""
        return bool(self._roster.of(Role.SUPERVISOR)) and bool(self._roster.of(Role.SIMULATOR))

    def has_agent(self, name: str) -> bool:
        """Whether a robot's agent is alive.

        Args:
            name: of the robot.
        """
        return name in self._roster.of(Role.AGENT)

    def tick(self) -> None:
        """Make the state of now."""
        now = self._bus.clock.now()
        received = self._snapshot.get()
        silent = received.age(now) if received is not None else math.inf
        seen = {robot.name: robot for robot in received.message.robots} if received is not None else {}
        self._set_fast(now, seen, silent)
        if now - self._slow_at >= _SLOW_PERIOD or now < self._slow_at:
            self._slow_at = now
            self._set_slow(now, seen, silent)

    def look(self) -> None:
        """Look at what is slow in the next tick already, because an order may just have changed it."""
        self._slow_at = -math.inf

    def set_goal(self, name: str, goal: Goal) -> None:
        """Show a goal that a robot has taken from a page, until its behaviour, or its agent, is started anew.

        Args:
            name: of the robot.
            goal: the goal.
        """
        self._goals[name] = self._run_of(name), [goal.x, goal.y, goal.theta]
        self._events.goal(self._bus.clock.now(), name, goal)

    # ---- fast

    def _set_fast(self, now: float, seen: Mapping[str, RobotState], silent: float) -> None:
        commands = self._commands.values()
        robots = {}
        for name in self._scenario.robots:
            robot, command = seen.get(name), commands.get(name)
            if command is not None and command.age(now) <= _COMMAND_TIMEOUT:
                commanded: tuple[float | None, ...] = (command.message.v, command.message.omega)
            else:
                commanded = (None, None)
            if robot is None:
                robots[name] = (*_UNKNOWN[:6], *commanded)
            else:
                robots[name] = (robot.x, robot.y, robot.theta, robot.v, robot.omega, robot.age + silent, *commanded)
        self.frames.set_state(now, robots)

    # ---- slow

    def _set_slow(self, now: float, seen: Mapping[str, RobotState], silent: float) -> None:
        healths, bases, behaviours = self._health.values(), self._bases.values(), self.behaviours
        alive = self._roster.of(Role.AGENT)
        # What an agent keeps for late joiners ends with it, and it can no longer say so itself.
        for kept in (self._paths, self._cells):
            for name in kept.values().keys() - alive:
                kept.forget(name)
        paths, cells = _messages(self._paths), _messages(self._cells)
        cal_v, cal_omega = _messages(self._cal_v), _messages(self._cal_omega)
        for name in self._scenario.robots:
            health = healths.get(name)
            state, reason = state_of(seen.get(name), silent, health, now, name in alive)
            report = health.message if health is not None else None
            behaviour, path, cell = behaviours.get(name), paths.get(name), cells.get(name)
            self._events.robot(now, name, state, reason)
            self._events.behaviour(now, name, behaviour)
            self.frames.set_detail(
                name,
                {
                    "state": state,
                    "reason": reason,
                    "note": report.note if report is not None else "",
                    "complaints": list(report.complaints) if report is not None else [],
                    "pose_age": _median(report, "pose_age_s"),
                    "latency": _median(report, "pose_to_command_s"),
                    "cal": [_value(cal_omega.get(name)), _value(cal_v.get(name))],
                    "wheels": _wheels(bases.get(name), now),
                    "behaviour": behaviour.behaviour if behaviour is not None else None,
                    "parameters": dict(behaviour.parameters) if behaviour is not None else {},
                    "path": _path(path),
                    "cell": _cell(cell),
                    "goal": self._goal_of(name),
                },
            )
        self._set_kept(now, seen, behaviours)
        self._events.processes(now, self._alive(now))
        if now - self._processes_at >= channels.HEALTH.period or now < self._processes_at:
            self._processes_at = now
            self._set_processes(now, healths)

    def _set_processes(self, now: float, healths: Mapping[str, Received[Health]]) -> None:
        own = Health(stamp=now, role=_PAGE, state="serving", numbers=self._bus.numbers())
        heard = self._heard()
        router = Health(stamp=heard, role=_ROUTER, state="reached")
        reports = {
            _PAGE: Received(_PAGE, own, now, 0.0, 0.0),
            _ROUTER: Received(_ROUTER, router, heard, 0.0, 0.0),
            **healths,
        }
        self.frames.set_part("processes", self._processes.rows(now, reports, {(_PAGE, _PAGE), *self._alive(now)}))

    def _alive(self, now: float) -> set[tuple[str, str]]:
        """Role and name of each process that is alive; the router is while anything comes from anybody."""
        router = {(_ROUTER, _ROUTER)} if now - self._heard() <= channels.HEALTH.stale_after else set()
        return {*self._roster.alive, *router}

    def _heard(self) -> float:
        """When anything came last [s]."""
        return max((counters.arrival for counters in self._bus.counters.values()), default=self._began)

    def _goal_of(self, name: str) -> list[float | None] | None:
        run, goal = self._goals.get(name, (None, None))
        if run != self._run_of(name):
            self._goals.pop(name, None)
            return None
        return goal

    def _run_of(self, name: str) -> tuple[object, ...]:
        """Which run of a behaviour a robot is in: another one does not know of a goal that this one took."""
        kept, report = self._behaviours.get(name), self._health.get(name)
        behaviour = (kept.message.behaviour, kept.message.parameters) if kept is not None else ()
        return *behaviour, report.message.epoch if report is not None else None

    def _set_kept(self, now: float, seen: Mapping[str, RobotState], behaviours: Mapping[str, Behaviour]) -> None:
        frames = self.frames
        kept = self._circle.get()
        if kept is not None:
            circle = kept.message.circle
            self._events.circle(now, circle)
            frames.set_part(
                "circle",
                {
                    "x": circle.x,
                    "y": circle.y,
                    "radius": circle.radius,
                    "clockwise": circle.clockwise,
                    "revision": kept.message.revision,
                    "importance": self._ring.importance(behaviours),
                },
            )
            places = {name: (seen[name].x, seen[name].y) for name in self._ring.spreading(behaviours) if name in seen}
            gaps = ring.gaps_ahead(ring.angles_round(places, circle), circle.clockwise) if places else {}
            frames.set_part("gaps", {name: round(gap, 3) for name, gap in gaps.items()})
        stop = self._stop.get()
        if stop is not None:
            order = stop.message
            frames.set_part("stop", {"all": order.all, "names": list(order.names), "revision": order.revision})
            self._events.stop(now, order)
        faults = self._faults.get()
        if faults is not None:
            frames.set_part("faults", {"rows": faults.message.rows, "lasting": list(faults.message.lasting)})
            self._events.faults(now, faults.message.lasting)
        leases = self.leases
        held = [
            {"program": one.program, "operator": one.operator, "names": list(one.names), "since": one.since}
            for one in leases
        ]
        frames.set_part("lease", held)
        self._events.leases(now, leases)


def state_of(
    seen: RobotState | None, silent: float, health: Received[Health] | None, now: float, alive: bool
) -> tuple[str, str]:
    """A robot's state in one word, and why.

    Args:
        seen: the robot as the cameras see it; None when they never did.
        silent: age of that [s].
        health: what its agent reports; None for nothing yet.
        now: the time [s].
        alive: whether its agent is.

    Returns:
        The word, and the reason; empty for a robot that drives.
    """
    place = "" if seen is not None else "no camera has seen it yet"
    if not alive:
        return "absent", "; ".join(filter(None, ["no agent is running for it", place]))
    if seen is None:
        return "unseen", place
    if not silent <= _SILENT:
        return "stale", f"no positions from the base station for {silent:.0f} s"
    if seen.state == "lost":
        return "lost", f"no camera has seen it for {seen.age:.0f} s; it stays an obstacle where it was"
    if health is None:
        return "holding", "no report from its agent yet"
    if not health.age(now) <= channels.HEALTH.stale_after:
        return "stale", f"no report from its agent for {health.age(now):.0f} s"
    report = health.message
    if report.stop_latched:
        return "stopped", ", ".join(report.reasons) or "stopped"
    if report.failure:
        return "failed", report.failure
    if seen.state == "stale":
        return "stale", f"no camera has seen it for {seen.age:.1f} s"
    if report.reasons:
        return "holding", ", ".join(report.reasons)
    return "driving", ""


def _messages(box: Latest[Any]) -> dict[str, Any]:
    return {name: received.message for name, received in box.values().items()}


def _median(report: Health | None, what: str) -> float | None:
    samples = report.samples.get(what, ()) if report is not None else ()
    return round(statistics.median(samples), 4) if samples else None


def _value(calibration: Any) -> float | None:
    return round(calibration.value, 3) if calibration is not None else None


def _path(path: PlannedPath | None) -> dict[str, Any] | None:
    return (
        None
        if path is None or not path.segments
        else {"x": path.x, "y": path.y, "theta": path.theta, "segments": path.segments}
    )


def _cell(cell: Cell | None) -> dict[str, Any] | None:
    return None if cell is None or not cell.corners else {"corners": cell.corners, "x": cell.x, "y": cell.y}


def _wheels(received: Received[BaseState] | None, now: float) -> str:
    """What is wrong with a robot's wheels, in words."""
    if received is None or not received.age(now) <= channels.BASE.stale_after:
        return "no word from its wheels"
    state = received.message
    if state.contested:
        return "two processes command its wheels"
    if state.unruly:
        return "its wheels do not do what they are commanded"
    for what in ("bumper", "cliff", "wheel_drop"):
        if getattr(state, what):
            return what.replace("_", " ")
    return "no fresh command: its wheels are at zero" if state.dead_man else ""
