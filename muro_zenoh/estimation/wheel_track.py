"""The recent past of a robot's wheels, and its near future: what the filter integrates.

Odometry gives knots of the wheels' speeds, joined by straight lines. Past the newest knot the commands sent since carry
the speeds on through the wheel model, so that an odometry which falls silent, or a time that lies ahead, needs no case
of its own.
"""

from __future__ import annotations

import math
from bisect import bisect_right

from muro_zenoh.estimation.ekf import FilterSettings
from muro_zenoh.estimation.wheel_model import WheelLimits, step_wheels

Piece = tuple[float, float, float]
"""An arc of the nominal wheels: v [m/s], omega [rad/s], dt [s]."""

_MODEL_STEP = 0.05
_INSTANT = 1e-9
_MOST_KNOTS = 512


def _sent(command: tuple[float, float, float]) -> float:
    return command[0]


class WheelTrack:
    """Speeds of the nominal wheels over the last second or so, and onwards under the commands sent.

    A local of one coroutine; it reads no clock. Times are of one local clock [s].

    Args:
        settings: how long to remember, and when odometry and commands are too old.
        limits: the robot's wheels, for the times that odometry does not cover.
    """

    __slots__ = ("_commands", "_limits", "_modelled", "_settings", "_speeds", "_times")

    def __init__(self, settings: FilterSettings, limits: WheelLimits) -> None:
        self._settings = settings
        self._limits = limits
        self._times: list[float] = []
        self._speeds: list[tuple[float, float]] = []
        self._modelled = 0  # how many of the newest knots came from the model
        self._commands: list[tuple[float, float, float]] = []

    def twist(self, t: float, v: float, omega: float) -> None:
        """File the odometry twist at ``t``. One that is not newer than the last is ignored.

        Args:
            t: when the wheels had these speeds [s, local clock].
            v: forward speed of the nominal wheels [m/s].
            omega: turning speed of the nominal wheels [rad/s].
        """
        while self._modelled and self._times[-1] >= t:
            self._times.pop()
            self._speeds.pop()
            self._modelled -= 1
        if self._times and t <= self._times[-1]:
            return
        self._modelled = 0
        self._file(t, v, omega)

    def command(self, t: float, v: float, omega: float) -> None:
        """File a command sent at ``t``, as it left the limits. One older than the last is ignored.

        Args:
            t: when it was sent [s, local clock].
            v: commanded forward speed [m/s].
            omega: commanded turning speed [rad/s].
        """
        t += self._settings.command_delay
        if self._commands and t < self._commands[-1][0]:
            return
        if not self._times:
            self._file(t, 0.0, 0.0)
            self._modelled = 1
        elif t - self._times[-1] > self._settings.odometry_timeout:
            for knot in self._ahead(t):
                self._file(*knot)
                self._modelled += 1
        self._commands.append((t, v, omega))
        if len(self._commands) > 64 or self._commands[0][0] < t - self._settings.history:
            keep = self._settings.history
            self._commands = [c for c in self._commands[-64:] if c[0] >= t - keep]

    def walk(self, start: float, end: float) -> tuple[list[Piece], tuple[float, float]]:
        """The arcs from ``start`` to ``end``, and the speeds there; zero when nothing was ever heard.

        Args:
            start: when to begin [s, local clock].
            end: when to end; may lie ahead. Before ``start`` there are no arcs.

        Returns:
            ``([(v, omega, dt), ...], (v, omega))`` of the nominal wheels [m/s], [rad/s], [s].
        """
        times, speeds = self._times, self._speeds
        pieces: list[Piece] = []
        if not times:
            return [(0.0, 0.0, end - start)] if end > start else pieces, (0.0, 0.0)
        i = bisect_right(times, start)
        t, (v, omega) = start, self._between(i, start)
        while t < end and i < len(times):
            t1, (v1, omega1) = (times[i], speeds[i]) if times[i] <= end else (end, self._between(i, end))
            pieces.append((0.5 * (v + v1), 0.5 * (omega + omega1), t1 - t))
            t, v, omega = t1, v1, omega1
            i += 1
        if end > times[-1]:
            t, (v, omega) = times[-1], speeds[-1]
            for t1, v1, omega1 in self._ahead(end):
                if t1 > start:
                    pieces.append((0.5 * (v + v1), 0.5 * (omega + omega1), t1 - max(t, start)))
                t, v, omega = t1, v1, omega1
        return pieces, (v, omega)

    def _between(self, i: int, t: float) -> tuple[float, float]:
        """Speeds at ``t``, that lies before knot ``i``; before the first and after the last knot, that knot's."""
        if i == 0 or i == len(self._times):
            return self._speeds[min(i, len(self._times) - 1)]
        t0, (v0, omega0) = self._times[i - 1], self._speeds[i - 1]
        v1, omega1 = self._speeds[i]
        s = (t - t0) / (self._times[i] - t0)
        return v0 + s * (v1 - v0), omega0 + s * (omega1 - omega0)

    def _ahead(self, end: float) -> list[tuple[float, float, float]]:
        """From the newest knot to ``end`` under the commands: ``(t, v, omega)`` after each step of the model."""
        t, (v, omega) = self._times[-1], self._speeds[-1]
        commands = self._commands
        if not commands:  # nobody tells what is sent: the wheels go on as they do
            return [(end, v, omega)] if end > t else []
        steps: list[tuple[float, float, float]] = []
        i = max(0, bisect_right(commands, t, key=_sent) - 1)
        v_cmd, omega_cmd, expires = v, omega, math.inf  # until the first command that is known
        while t < end - _INSTANT:
            while i < len(commands) and commands[i][0] <= t + _INSTANT:
                sent, v_cmd, omega_cmd = commands[i]
                expires = sent + self._settings.command_timeout
                i += 1
            if t >= expires - _INSTANT:
                v_cmd, omega_cmd, expires = 0.0, 0.0, math.inf
            t1 = min(end, t + _MODEL_STEP, expires, commands[i][0] if i < len(commands) else math.inf)
            v, omega = step_wheels(v, omega, v_cmd, omega_cmd, self._limits, t1 - t)
            t = t1
            steps.append((t, v, omega))
        return steps

    def _file(self, t: float, v: float, omega: float) -> None:
        self._times.append(t)
        self._speeds.append((v, omega))
        horizon = t - self._settings.history - self._settings.odometry_timeout
        if len(self._times) > _MOST_KNOTS or self._times[0] < horizon - 1.0:
            first = max(0, bisect_right(self._times, horizon) - 1, len(self._times) - _MOST_KNOTS)
            del self._times[:first]
            del self._speeds[:first]
