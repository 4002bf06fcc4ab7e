"""The recent past of a robot's wheels, and its near future: what the filter integrates.

Odometry gives knots of the wheels' speeds, joined by straight lines. Past the newest knot the commands sent since carry
the speeds on through the wheel model, so that an odometry which falls silent, or a time that lies ahead, needs no case
of its own.
"""

from __future__ import annotations

import math
from bisect import bisect_right

from muro_zenoh.estimation.filter_settings import FilterSettings
from muro_zenoh.estimation.wheel_model import WheelLimits, step_wheels

Piece = tuple[float, float, float]
"""An arc of the nominal wheels: v [m/s], omega [rad/s], dt [s]."""

Timed = tuple[float, float, float]
"""Speeds or a command at a time: t [s], v [m/s], omega [rad/s]."""

LONGEST_ARC = 0.05 + 1e-9
"""Knots are gathered into arcs of at most this length [s]."""

_INSTANT = 1e-9
_SILENCE = 0.5
"""In a gap between knots that is longer than this, the wheels are taken to have stopped after it: the base's command
timeout has stopped them [s]."""
_AT_REST = 1e-6
"""Slower wheels are at rest under a command of zero [m/s], [rad/s]."""
_MOST_KNOTS = 512
_MOST_COMMANDS = 64


class WheelTrack:
    """Speeds of the nominal wheels since the oldest time still needed, and onwards under the commands sent.

    A local of one coroutine; it reads no clock. Times are of one local clock [s].

    Args:
        settings: when odometry and commands are too old.
        limits: the robot's wheels, for the times that odometry does not cover.
    """

    __slots__ = ("_commands", "_knots", "_limits", "_measured", "_settings")

    def __init__(self, settings: FilterSettings, limits: WheelLimits) -> None:
        self._settings = settings
        self._limits = limits
        self._knots: list[Timed] = []
        self._measured = -math.inf  # time of the newest odometry; the knots after it came from the model
        self._commands: list[Timed] = []

    @property
    def newest(self) -> float:
        """The time of the newest twist or command [s, local clock]; minus infinity before any."""
        newest = self._knots[-1][0] if self._knots else -math.inf
        return max(newest, self._commands[-1][0]) if self._commands else newest

    def twist(self, t: float, v: float, omega: float) -> None:
        """File the odometry twist at ``t``. One that is not newer than the last is ignored.

        Args:
            t: when the wheels had these speeds [s, local clock].
            v: forward speed of the nominal wheels [m/s].
            omega: turning speed of the nominal wheels [rad/s].
        """
        if t <= self._measured:
            return
        while self._knots and self._knots[-1][0] >= t:  # from the model, and this one knows better
            self._knots.pop()
        self._measured = t
        self._file((t, v, omega))

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
        if not self._knots:
            self._file((t, 0.0, 0.0))
        elif t - self._knots[-1][0] > self._settings.odometry_timeout:
            for knot in self._ahead(t):
                self._file(knot)
        self._commands.append((t, v, omega))
        oldest = t - self._settings.history
        while len(self._commands) > _MOST_COMMANDS or self._commands[0][0] < oldest:
            del self._commands[0]

    def command_at(self, t: float, v: float, omega: float) -> tuple[float, float]:
        """The command in force at ``t``, the newest time that is known: zero when the newest has expired.

        Args:
            t: when [s, local clock].
            v: what to assume when no command was ever sent: the wheels' own speed [m/s].
            omega: the same [rad/s].
        """
        if not self._commands:
            return v, omega
        sent, v_sent, omega_sent = self._commands[-1]
        return (v_sent, omega_sent) if t - sent < self._settings.command_timeout else (0.0, 0.0)

    def forget(self, t: float) -> None:
        """Drop what is not needed for times from ``t`` on.

        Args:
            t: the earliest time that will be asked for [s, local clock].
        """
        # The newest odometry stays: later odometry may take the place of all that the model has added to it.
        oldest = min(t, self._measured) if self._measured > -math.inf else t
        needless = bisect_right(self._knots, (oldest, math.inf, math.inf)) - 1
        if needless > 0:
            del self._knots[:needless]

    def walk(self, start: float, end: float) -> tuple[list[Piece], tuple[float, float]]:
        """The arcs from ``start`` to ``end``, and the speeds there; zero when nothing was ever received.

        Knots closer together than 50 ms are gathered into arcs of about that length: what the mean speeds miss of a
        50 ms arc is far below the slip, and the filter costs as much per arc as per knot.

        Args:
            start: when to begin [s, local clock].
            end: when to end; may lie ahead. Before ``start`` there are no arcs.

        Returns:
            ``([(v, omega, dt), ...], (v, omega))`` of the nominal wheels [m/s], [rad/s], [s].
        """
        knots = self._knots
        if not knots:
            return [(0.0, 0.0, end - start)] if end > start else [], (0.0, 0.0)
        i = bisect_right(knots, (start, math.inf, math.inf))
        t, (v, omega) = start, self._between(i, start)
        then = knots[i:]
        if end > knots[-1][0]:
            then += self._ahead(end)
        arcs: list[Piece] = []
        distance = angle = span = 0.0  # of the arc being gathered
        for t1, v1, omega1 in then:
            if t >= end:
                break
            if t1 > t:
                if t1 > end:
                    part = (end - t) / (t1 - t)
                    t1, v1, omega1 = end, v + part * (v1 - v), omega + part * (omega1 - omega)
                dt = t1 - t
                driven = 0.5 * (dt if dt < _SILENCE else _SILENCE)
                if span + dt > LONGEST_ARC and span > 0.0:
                    arcs.append((distance / span, angle / span, span))
                    distance = angle = span = 0.0
                distance += driven * (v + v1)
                angle += driven * (omega + omega1)
                span += dt
                t = t1
            v, omega = v1, omega1
        if span > 0.0:
            arcs.append((distance / span, angle / span, span))
        return arcs, (v, omega)

    def _between(self, i: int, t: float) -> tuple[float, float]:
        """Speeds at ``t``, that lies before knot ``i``; before the first and after the last knot, that knot's."""
        if i == 0 or i == len(self._knots):
            _, v, omega = self._knots[min(i, len(self._knots) - 1)]
            return v, omega
        t0, v0, omega0 = self._knots[i - 1]
        t1, v1, omega1 = self._knots[i]
        part = (t - t0) / (t1 - t0)
        return v0 + part * (v1 - v0), omega0 + part * (omega1 - omega0)

    def _ahead(self, end: float) -> list[Timed]:
        """From the newest knot to ``end`` under the commands: the knots that the wheel model predicts."""
        t, v, omega = self._knots[-1]
        commands = self._commands
        if not commands:  # unknown what was sent: the wheels keep their speeds
            return [(end, v, omega)] if end > t else []
        steps: list[Timed] = []
        i = max(0, bisect_right(commands, (t, math.inf, math.inf)) - 1)
        v_cmd, omega_cmd, expires = v, omega, math.inf  # until the first command that is known
        while t < end - _INSTANT:
            while i < len(commands) and commands[i][0] <= t + _INSTANT:
                sent, v_cmd, omega_cmd = commands[i]
                expires = sent + self._settings.command_timeout
                i += 1
            if t >= expires - _INSTANT:
                v_cmd, omega_cmd, expires = 0.0, 0.0, math.inf
            known = commands[i][0] if i < len(commands) else math.inf
            rests = v_cmd == omega_cmd == 0.0 and abs(v) < _AT_REST and abs(omega) < _AT_REST
            # At rest one step does: after hours of suspend they would be hundreds of thousands.
            t1 = min(end, math.inf if rests else t + LONGEST_ARC, expires, known)
            v, omega = step_wheels(v, omega, v_cmd, omega_cmd, self._limits, t1 - t)
            t = t1
            steps.append((t, v, omega))
        return steps

    def _file(self, knot: Timed) -> None:
        self._knots.append(knot)
        if len(self._knots) > _MOST_KNOTS:  # nothing was forgotten for long: keep the old half more coarsely
            del self._knots[1 : _MOST_KNOTS // 2 : 2]
