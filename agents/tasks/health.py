"""Reports the agent's health once a second, and at once when the robot starts or stops driving."""

from __future__ import annotations

import asyncio
import contextlib
import logging

from agents.control_loop import ControlLoop
from agents.tasks.behaviour import BehaviourRunner
from agents.tasks.control import Listener, Signals
from muro_zenoh import channels
from muro_zenoh.messages import Health
from muro_zenoh.runtime.waiting import WaitingLog
from muro_zenoh.transport import Bus
from muro_zenoh.transport.measured_clock import StationClock

log = logging.getLogger(__name__)

_PERIOD = channels.HEALTH.period

_BEFORE_THE_FIRST_COMMAND = ("it has just started",)


async def report_health(
    bus: Bus,
    name: str,
    loop: ControlLoop,
    runner: BehaviourRunner,
    clock: StationClock,
    listener: Listener,
    signals: Signals,
) -> None:
    """Report until cancelled.

    Args:
        bus: the bus.
        name: the robot's name.
        loop: the control loop; its measurements are cleared.
        runner: runs the behaviour.
        clock: ours against the base station's.
        listener: receives what the behaviour needs.
        signals: wakes this task; its latencies are cleared.
    """
    publisher = bus.publisher(channels.HEALTH, name)
    waiting = WaitingLog(log, "stationary", "no longer stationary")
    commands, since, rate = 0, bus.clock.now(), 0.0
    while True:
        now = bus.clock.now()
        if now - since > 0.5 * _PERIOD:
            rate = (loop.commands - commands) / (now - since)
            commands, since = loop.commands, now
        samples = {"pose_age_s": tuple(loop.tracking.pose_ages), "pose_to_command_s": tuple(signals.latencies)}
        loop.tracking.pose_ages.clear()
        signals.latencies.clear()
        loop.changed = False
        waiting.note(now, loop.reasons)
        reasons = loop.reasons if loop.commands else _BEFORE_THE_FIRST_COMMAND
        publisher.put(
            Health(
                role="agent",
                state=_state(loop, runner, reasons),
                reasons=reasons,
                note=loop.drive.take_note(),
                complaints=(*listener.complaints, *clock.complaints()),
                numbers={
                    "fixes": loop.tracking.fixes,
                    "commands": loop.commands,
                    "command_rate_hz": round(rate, 1),
                    **clock.numbers(),
                    **{f"refused_{what.replace(' ', '_')}": count for what, count in loop.tracking.refused.items()},
                    **{f"separated_{why.replace(' ', '_')}": count for why, count in loop.drive.changes.items()},
                    **bus.numbers(),
                },
                samples=samples,
                failure=runner.failure,
                behaviour_revision=runner.revision,
                stop_latched=loop.latch.stopped,
                stop_all=loop.latch.all_robots,
                stop_names=tuple(sorted(loop.stopped_names)),
                stop_revision=max(loop.latch.revision, 0),
            )
        )
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_PERIOD):
                await signals.changed.wait()
        signals.changed.clear()


def _state(loop: ControlLoop, runner: BehaviourRunner, reasons: tuple[str, ...]) -> str:
    if runner.outcome:
        return runner.outcome
    if loop.latch.stopped:
        return "stopped"
    if reasons:
        return "holding"
    return runner.name.rpartition(":")[2] or "driving"
