"""Where one robot is, from late camera fixes and its wheels: the filter that an agent runs.

Fixes arrive 60 to 150 ms after their capture, and from two cameras not in order. Each is applied at its capture time:
the anchors of the last second (mean and covariance just after a fix) are kept, and the wheels' speeds since the oldest
of them. A fix goes in after the last anchor before it, and the fixes that were captured later are taken once more. The
estimate for any time, the near future too, is the newest anchor rolled forward along the wheels.

The filter is a small class rather than a value that goes in and out: it is a local of the one coroutine that runs it,
reads no clock and holds no resource, and a copy of the last second's inputs at 50 Hz would cost more than the filter.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from muro_zenoh.arcs import carry
from muro_zenoh.estimation import ekf
from muro_zenoh.estimation.ekf import Covariance, Fix, Mean, Stretch
from muro_zenoh.estimation.filter_settings import FilterSettings
from muro_zenoh.estimation.wheel_model import WheelLimits, step_wheels
from muro_zenoh.estimation.wheel_track import WheelTrack
from muro_zenoh.geometry import State, wrap_to_pi

_DEFAULT_WHEELS = WheelLimits()


class FixResult(NamedTuple):
    """What became of a fix.

    ``accepted``: whether it was used. ``reason``: ``"used"``, ``"started"`` and ``"restarted"`` for one that was;
    ``"gated"``, ``"too old"``, ``"from the future"`` (more than ``history`` after all else heard) or
    ``"bad covariance"`` for one that was not. ``nis``: its squared Mahalanobis distance, NaN where there was none.
    ``restarted``: whether it made the filter start anew, after a kidnapping.
    """

    accepted: bool
    reason: str
    nis: float
    restarted: bool


class PoseEstimate(NamedTuple):
    """Where a robot is and how it moves.

    ``x``, ``y`` [m, world], ``theta`` [rad, (-pi, pi]]; ``v`` [m/s] and ``omega`` [rad/s] are the speeds really driven:
    drive scale times wheel speed. ``covariance9``: of x, y, theta, row-major. ``s_v``, ``s_omega``: the drive scales,
    calD = 1 / s_v and cal0 = 1 / s_omega, with their standard deviations ``sigma_v`` and ``sigma_omega``. ``t_fix``:
    capture time of the newest fix in it [s, local clock].
    """

    x: float
    y: float
    theta: float
    v: float
    omega: float
    covariance9: tuple[float, float, float, float, float, float, float, float, float]
    s_v: float
    s_omega: float
    sigma_v: float
    sigma_omega: float
    t_fix: float


class _Anchor(NamedTuple):
    t: float
    mean: Mean
    cov: Covariance
    fix: Fix | None  # None where the filter (re)started or coasted: nothing goes in before it
    t_fix: float


class PoseFilter:
    """Pose and drive scales of one robot. Every time is of one local clock [s].

    Args:
        settings: what is believed of robot and cameras.
        limits: the robot's wheels, for the times that odometry does not cover.
    """

    __slots__ = ("_anchors", "_gated", "_limits", "_settings", "_track")

    def __init__(self, settings: FilterSettings | None = None, limits: WheelLimits = _DEFAULT_WHEELS) -> None:
        self._settings = settings if settings is not None else FilterSettings()
        self._limits = limits
        self._track = WheelTrack(self._settings, limits)
        self._anchors: list[_Anchor] = []
        self._gated: list[tuple[float, Fix]] = []

    def twist(self, t: float, v: float, omega: float) -> None:
        """Take in an odometry twist: what encoders of nominal wheels report.

        Args:
            t: when the wheels had these speeds [s].
            v: forward speed [m/s].
            omega: turning speed [rad/s].
        """
        self._track.twist(t, v, omega)

    def command(self, t: float, v: float, omega: float) -> None:
        """Take in a command really sent, after calibration and limits. Odometry newer than 0.15 s goes before it.

        Args:
            t: when it was sent [s].
            v: commanded forward speed [m/s].
            omega: commanded turning speed [rad/s].
        """
        self._track.command(t, v, omega)

    def fix(
        self, t_capture: float, x: float, y: float, theta: float, cov9: tuple[float, ...] | list[float]
    ) -> FixResult:
        """Take in a fix of the cameras, however late, at the time that it was captured.

        Args:
            t_capture: when the picture was taken [s].
            x: measured place [m, world].
            y: measured place [m, world].
            theta: measured heading [rad].
            cov9: covariance of (x, y, theta), row-major, nine floats [m^2, m rad, rad^2]; its upper triangle is read.
        """
        fix = Fix(x, y, theta, cov9[0], cov9[1], cov9[2], cov9[4], cov9[5], cov9[8])
        if not ekf.is_covariance(fix):
            return FixResult(False, "bad covariance", math.nan, False)
        anchors = self._anchors
        if not anchors:
            anchors.append(_Anchor(t_capture, *ekf.start(fix, self._settings), None, t_capture))
            return FixResult(True, "started", math.nan, False)
        if t_capture > max(self._track.newest, anchors[-1].t) + self._settings.history:
            # Taken in, one wrong stamp would make every true fix after it too old. A row of them is no wrong stamp.
            return self._gate(t_capture, fix, math.nan, "from the future")
        i = self._anchors_until(t_capture)
        if i == 0:
            return FixResult(False, "too old", math.nan, False)
        anchor, nis = self._apply(anchors[i - 1], t_capture, fix)
        if anchor is None:
            return self._gate(t_capture, fix, nis, "gated")
        self._gated.clear()
        later = anchors[i:]
        del anchors[i:]
        anchors.append(anchor)
        for old in later:
            again = old if old.fix is None else self._apply(anchors[-1], old.t, old.fix)[0]
            if again is not None:
                anchors.append(again)
        horizon = anchors[-1].t - self._settings.history
        while len(anchors) > 1 and anchors[0].t < horizon:
            del anchors[0]
        self._track.forget(anchors[0].t)
        return FixResult(True, "used", nis, False)

    def at(self, t: float) -> PoseEstimate | None:
        """The estimate for time ``t``, which may lie ahead; None before the first fix, or before all that is kept.

        Args:
            t: for when [s].
        """
        self._coast(t)
        i = self._anchors_until(t)
        if i == 0:
            return None
        anchor = self._anchors[i - 1]
        stretch, (v, omega) = self._roll(anchor.mean, anchor.t, t)
        mean, P = ekf.predict(anchor.mean, anchor.cov, stretch, self._settings)
        return PoseEstimate(
            mean.x,
            mean.y,
            mean.theta,
            mean.s_v * v,
            mean.s_omega * omega,
            (P.xx, P.xy, P.xt, P.xy, P.yy, P.yt, P.xt, P.yt, P.tt),
            mean.s_v,
            mean.s_omega,
            math.sqrt(P.vv),
            math.sqrt(P.ww),
            anchor.t_fix,
        )

    def look_ahead(self, estimate: PoseEstimate, t: float, horizon: float) -> State:
        """Where the robot will be under the command in force, and how fast: where laws are evaluated.

        Args:
            estimate: what :meth:`at` returned for ``t``.
            t: its time [s].
            horizon: how far ahead [s]; the speeds are taken as linear within it.
        """
        v, omega = estimate.v / estimate.s_v, estimate.omega / estimate.s_omega
        v1, omega1 = step_wheels(v, omega, *self._track.command_at(t, v, omega), self._limits, horizon)
        x, y, theta = carry(
            estimate.x,
            estimate.y,
            estimate.theta,
            estimate.s_v * (0.5 * (v + v1)),
            estimate.s_omega * (0.5 * (omega + omega1)),
            horizon,
        )
        return State(x, y, theta, estimate.s_v * v1, estimate.s_omega * omega1)

    def _anchors_until(self, t: float) -> int:
        """How many of the anchors are not later than ``t``; most often all."""
        i = len(self._anchors)
        while i and self._anchors[i - 1].t > t:
            i -= 1
        return i

    def _coast(self, t: float) -> None:
        """Without fixes for two seconds, move the anchor on: nothing is rolled forward twice for ever."""
        if not self._anchors:
            return
        last, history = self._anchors[-1], self._settings.history
        known = min(t, self._track.newest)
        if known - last.t > 2.0 * history:
            stretch, _ = self._roll(last.mean, last.t, known - history)
            coasted = ekf.predict(last.mean, last.cov, stretch, self._settings)
            self._anchors = [_Anchor(known - history, *coasted, None, last.t_fix)]
            self._track.forget(known - history)

    def _roll(self, mean: Mean, start: float, end: float) -> tuple[Stretch, tuple[float, float]]:
        """The stretch that the wheels drove from ``start`` to ``end``, and their speeds there."""
        stretch = ekf.begin(mean)
        pieces, speeds = self._track.walk(start, end)
        for v, omega, dt in pieces:
            stretch = ekf.drive(stretch, mean, v, omega, dt, self._settings)
        return stretch, speeds

    def _apply(self, before: _Anchor, t: float, fix: Fix) -> tuple[_Anchor | None, float]:
        """The anchor after ``fix``, or None where the gate keeps it out; and its squared Mahalanobis distance."""
        settings = self._settings
        stretch, _ = self._roll(before.mean, before.t, t)
        mean, cov = ekf.predict(before.mean, before.cov, stretch, settings)
        mean, cov, nis = ekf.correct(mean, cov, fix, stretch.moved_v, stretch.moved_w, settings)
        return (_Anchor(t, mean, cov, fix, t) if nis <= settings.gate else None), nis

    def _gate(self, t: float, fix: Fix, nis: float, reason: str) -> FixResult:
        """A fix that does not belong to the track. Enough of them in a row that agree: the robot was carried off."""
        newest = self._anchors[-1].mean
        if self._gated and not self._agree(self._gated[-1], t, fix, newest):
            self._gated.clear()
        self._gated.append((t, fix))
        if len(self._gated) < self._settings.restart_fixes:
            return FixResult(False, reason, nis, False)
        t, fix = max(self._gated, key=lambda gated: gated[0])
        self._gated.clear()
        s_v, s_omega = newest.s_v, newest.s_omega
        self._anchors = [_Anchor(t, *ekf.start(fix, self._settings, s_v, s_omega), None, t)]
        return FixResult(True, "restarted", nis, True)

    def _agree(self, before: tuple[float, Fix], t: float, fix: Fix, scales: Mean) -> bool:
        """Whether the wheels' motion leads from one gated fix to the other, whichever was captured first."""
        t0, old = before
        if t < t0:
            t0, old, t, fix = t, fix, t0, old
        mean = Mean(old.x, old.y, old.theta, scales.s_v, scales.s_omega)
        stretch, _ = self._roll(mean, t0, t)
        return (
            math.hypot(fix.x - stretch.x, fix.y - stretch.y) <= self._settings.restart_distance
            and abs(wrap_to_pi(fix.theta - stretch.theta)) <= self._settings.restart_angle
        )
