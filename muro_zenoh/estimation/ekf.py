"""The extended Kalman filter of one unicycle and its two drive errors, in closed form, element by element.

State x, y, theta, s_v, s_omega: the wheels report (v, omega), the robot does (s_v v, s_omega omega), so that
calD = 1 / s_v and cal0 = 1 / s_omega (seed 000, section 3.3; seed 004, localization). The mean is five scalars and the
covariance its fifteen upper-triangle entries, each a float or an array with one entry per robot: an agent runs the
filter on plain floats, the lock-step rollout on thousands of robots at once, and there is one spelling of it.

The covariance moves only when a fix is taken: :func:`drive` carries the pose along the inputs and gathers, on the way,
the Jacobian of the whole stretch since the last fix; :func:`predict` applies it once. The map is linear in s_v and
a rotation in theta, so those columns are exact in closed form.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

from muro_zenoh import elementwise


@dataclass(frozen=True, slots=True)
class FilterSettings:
    """What the filter believes about robot, wheels and cameras.

    Gates are squared Mahalanobis distances of a fix (chi-square, three degrees of freedom): 21.1 loses one good fix in
    10,000, 11.3 one in 100.

    Args:
        gate: a fix beyond it is not taken at all.
        scale_gate: a fix beyond it moves the pose but not the drive scales.
        scale_sigma: standard deviation of both scales before anything is known.
        scale_min: least drive scale believed.
        scale_max: largest drive scale believed.
        scale_walk: how fast the scales may drift while they can be seen [1/sqrt(s)].
        slip: standard deviation of the distance driven [m/sqrt(m)] and of the angle turned [rad/sqrt(rad)].
        veer: standard deviation of the heading over a distance [rad/sqrt(m)].
        drift: standard deviation of the place, whatever the wheels do [m/sqrt(s)].
        drift_theta: standard deviation of the heading, whatever the wheels do [rad/sqrt(s)].
        v_rest: below this wheel speed s_v is frozen [m/s].
        omega_rest: below this wheel speed s_omega is frozen [rad/s].
        history: how long inputs and anchors are kept for late and out-of-order fixes [s].
        odometry_timeout: odometry older than this is carried on by commands through the wheel model [s].
        command_timeout: a command older than this counts as zero: the base's dead-man [s].
        command_delay: from sending a command to the wheels obeying it [s].
        restart_fixes: so many gated fixes in a row that agree with each other restart the filter.
        restart_distance: agree means within this distance [m], the odometry in between taken off.
        restart_angle: and within this heading [rad].
    """

    gate: float = 21.1
    scale_gate: float = 11.3
    scale_sigma: float = 0.15
    scale_min: float = 0.5
    scale_max: float = 1.5
    scale_walk: float = 0.003
    slip: float = 0.01
    veer: float = 0.01
    drift: float = 0.001
    drift_theta: float = 0.003
    v_rest: float = 0.01
    omega_rest: float = 0.03
    history: float = 1.0
    odometry_timeout: float = 0.15
    command_timeout: float = 0.3
    command_delay: float = 0.0
    restart_fixes: int = 5
    restart_distance: float = 0.06
    restart_angle: float = 0.25

    def __post_init__(self) -> None:
        if not 0.0 < self.scale_min < 1.0 < self.scale_max:
            raise ValueError(f"drive scales bounded by {self.scale_min} and {self.scale_max}: 1 must lie between them")
        if not 0.0 < self.scale_gate <= self.gate:
            raise ValueError(f"scale_gate {self.scale_gate} must lie in (0, gate = {self.gate}]")
        if self.restart_fixes < 2:
            raise ValueError(f"restart_fixes {self.restart_fixes}: at least 2 are needed to agree with each other")


class Mean(NamedTuple):
    """The state: ``x``, ``y`` [m, world], ``theta`` [rad], drive scales ``s_v`` and ``s_omega`` [1]."""

    x: Any
    y: Any
    theta: Any
    s_v: Any
    s_omega: Any


class Covariance(NamedTuple):
    """Upper triangle of the state's covariance. x, y, t (theta), v (s_v), w (s_omega) name row and column."""

    xx: Any
    xy: Any
    xt: Any
    xv: Any
    xw: Any
    yy: Any
    yt: Any
    yv: Any
    yw: Any
    tt: Any
    tv: Any
    tw: Any
    vv: Any
    vw: Any
    ww: Any


class Fix(NamedTuple):
    """One measured pose: place [m, world], heading [rad], and the upper triangle of its 3x3 covariance."""

    x: Any
    y: Any
    theta: Any
    xx: Any
    xy: Any
    xt: Any
    yy: Any
    yt: Any
    tt: Any


class Stretch(NamedTuple):
    """A stretch driven from a mean: the pose at its end, and what the covariance needs to know of the way.

    ``turn``: angle the nominal wheels turned [rad], signed. ``x_by_w``, ``y_by_w``: derivatives of the end's place by
    s_omega [m]. ``path``, ``spin``: distance and angle of the nominal wheels, unsigned [m], [rad]. ``time``: its length
    [s]. ``time_v``, ``time_w``: how much of it the scales could be seen [s].
    """

    x: Any
    y: Any
    theta: Any
    turn: Any
    x_by_w: Any
    y_by_w: Any
    path: Any
    spin: Any
    time: Any
    time_v: Any
    time_w: Any


def begin(mean: Mean) -> Stretch:
    """The stretch of no length at ``mean``.

    Args:
        mean: where it begins.
    """
    zero = 0.0 * mean.x
    return Stretch(mean.x, mean.y, mean.theta, zero, zero, zero, zero, zero, 0.0, zero, zero)


def drive(stretch: Stretch, mean: Mean, v: Any, omega: Any, dt: Any, settings: FilterSettings) -> Stretch:
    """The stretch carried on along one arc, exact for constant speeds while \\|s_omega omega dt\\| < 1 rad.

        d = s_v v dt sinc(h),  h = s_omega omega dt / 2:   x += d cos(theta + h),  y += d sin(theta + h),  theta += 2 h

    Args:
        stretch: the stretch so far.
        mean: where it began; only its drive scales are read.
        v: speed of the nominal wheels [m/s].
        omega: turning speed of the nominal wheels [rad/s].
        dt: how long [s].
        settings: the speeds that count as rest.
    """
    xp = elementwise.of(stretch.theta)
    half_wheel = 0.5 * dt * omega
    h = mean.s_omega * half_wheel
    hh = h * h
    nominal = mean.s_v * dt * v
    # sinc as its series: no branch at zero, and within 3e-8 up to h = 0.5
    d = nominal * (1.0 - hh * (1.0 / 6.0 - hh * (1.0 / 120.0 - hh / 5040.0)))
    mid = stretch.theta + h
    cos, sin = xp.cos(mid), xp.sin(mid)
    dx, dy = d * cos, d * sin
    turn_mid = stretch.turn + half_wheel
    bend = nominal * half_wheel * h * (hh / 30.0 - 1.0 / 3.0)
    return Stretch(
        stretch.x + dx,
        stretch.y + dy,
        mid + h,
        turn_mid + half_wheel,
        stretch.x_by_w - dy * turn_mid + bend * cos,
        stretch.y_by_w + dx * turn_mid + bend * sin,
        stretch.path + abs(v) * dt,
        stretch.spin + 2.0 * abs(half_wheel),
        stretch.time + dt,
        stretch.time_v + (abs(v) > settings.v_rest) * dt,
        stretch.time_w + (abs(omega) > settings.omega_rest) * dt,
    )


def carry(x: Any, y: Any, theta: Any, v: Any, omega: Any, dt: Any) -> tuple[Any, Any, Any]:
    """A pose alone, carried along one arc: :func:`drive` without what the covariance needs.

    Args:
        x: place [m, world].
        y: place [m, world].
        theta: heading [rad].
        v: true speed [m/s].
        omega: true turning speed [rad/s], \\|omega dt\\| < 1 rad.
        dt: how long [s].

    Returns:
        x, y [m, world] and theta [rad], not wrapped.
    """
    xp = elementwise.of(theta)
    h = 0.5 * dt * omega
    hh = h * h
    d = dt * v * (1.0 - hh * (1.0 / 6.0 - hh * (1.0 / 120.0 - hh / 5040.0)))
    mid = theta + h
    return x + d * xp.cos(mid), y + d * xp.sin(mid), mid + h


def predict(mean: Mean, P: Covariance, stretch: Stretch, settings: FilterSettings) -> tuple[Mean, Covariance]:
    """Mean and covariance at the end of a stretch: P' = F P F^T + Q.

    Q: slip along the chord, slip and veer of the heading, a small drift of the pose, a random walk of each scale while
    its wheel speed is not at rest.

    Args:
        mean: the mean that the stretch began at.
        P: its covariance.
        stretch: what was driven since.
        settings: the process noise.
    """
    xp = elementwise.of(stretch.theta)
    dx, dy = stretch.x - mean.x, stretch.y - mean.y
    # F = I but for the columns theta (-dy, dx), s_v (bx, by) and s_omega (cx, cy, turn)
    bx, by = dx / mean.s_v, dy / mean.s_v
    cx, cy, turn = stretch.x_by_w, stretch.y_by_w, stretch.turn

    # F P, the rows that change; the columns below the diagonal only where the product needs them
    x_t = P.xt - dy * P.tt + bx * P.tv + cx * P.tw
    x_v = P.xv - dy * P.tv + bx * P.vv + cx * P.vw
    x_w = P.xw - dy * P.tw + bx * P.vw + cx * P.ww
    x_x = P.xx - dy * P.xt + bx * P.xv + cx * P.xw
    x_y = P.xy - dy * P.yt + bx * P.yv + cx * P.yw
    y_t = P.yt + dx * P.tt + by * P.tv + cy * P.tw
    y_v = P.yv + dx * P.tv + by * P.vv + cy * P.vw
    y_w = P.yw + dx * P.tw + by * P.vw + cy * P.ww
    y_y = P.yy + dx * P.yt + by * P.yv + cy * P.yw
    t_t = P.tt + turn * P.tw
    t_v = P.tv + turn * P.vw
    t_w = P.tw + turn * P.ww

    slip = settings.slip * settings.slip
    along = slip * mean.s_v * stretch.path / xp.maximum(dx * dx + dy * dy, 1e-12)
    drift = settings.drift * settings.drift * stretch.time
    heading = (
        slip * mean.s_omega * stretch.spin
        + settings.veer * settings.veer * mean.s_v * stretch.path
        + settings.drift_theta * settings.drift_theta * stretch.time
    )
    walk = settings.scale_walk * settings.scale_walk
    return (
        Mean(stretch.x, stretch.y, xp.wrap(stretch.theta), mean.s_v, mean.s_omega),
        Covariance(
            x_x - dy * x_t + bx * x_v + cx * x_w + along * dx * dx + drift,
            x_y + dx * x_t + by * x_v + cy * x_w + along * dx * dy,
            x_t + turn * x_w,
            x_v,
            x_w,
            y_y + dx * y_t + by * y_v + cy * y_w + along * dy * dy + drift,
            y_t + turn * y_w,
            y_v,
            y_w,
            t_t + turn * t_w + heading,
            t_v,
            t_w,
            P.vv + walk * stretch.time_v,
            P.vw,
            P.ww + walk * stretch.time_w,
        ),
    )


def correct(
    mean: Mean, P: Covariance, fix: Fix, moved_v: Any, moved_w: Any, settings: FilterSettings
) -> tuple[Mean, Covariance, Any]:
    """Mean and covariance after one fix, and the fix's squared Mahalanobis distance. The gate is the caller's.

    S = P_pose + R, K = P[:, pose] S^-1, P' = (I - K H) P (I - K H)^T + K R K^T (Joseph's form, right for any gain: a
    frozen scale has the gain zero and keeps its covariances honest). The heading's innovation is wrapped.

    Args:
        mean: the mean at the capture time.
        P: its covariance.
        fix: the measured pose; its covariance must be positive definite.
        moved_v: whether the wheels drove since the last fix: else s_v keeps its value. A bool, or an array of them.
        moved_w: whether the wheels turned since the last fix: else s_omega keeps its value.
        settings: the gate and the bounds of the scales.

    Returns:
        ``(mean, covariance, nis)``, as if the fix passed the gate.
    """
    xp = elementwise.of(mean.x)
    ex, ey, et = fix.x - mean.x, fix.y - mean.y, xp.wrap(fix.theta - mean.theta)
    sxx, sxy, sxt = P.xx + fix.xx, P.xy + fix.xy, P.xt + fix.xt
    syy, syt, stt = P.yy + fix.yy, P.yt + fix.yt, P.tt + fix.tt
    # the inverse of S, by its adjugate
    axx, axy, axt = syy * stt - syt * syt, sxt * syt - sxy * stt, sxy * syt - sxt * syy
    scale = 1.0 / (sxx * axx + sxy * axy + sxt * axt)
    ixx, ixy, ixt = axx * scale, axy * scale, axt * scale
    iyy, iyt = (sxx * stt - sxt * sxt) * scale, (sxy * sxt - sxx * syt) * scale
    itt = (sxx * syy - sxy * sxy) * scale
    wx, wy, wt = ixx * ex + ixy * ey + ixt * et, ixy * ex + iyy * ey + iyt * et, ixt * ex + iyt * ey + itt * et
    nis = ex * wx + ey * wy + et * wt

    free = nis <= settings.scale_gate
    free_v, free_w = 1.0 * (free & moved_v), 1.0 * (free & moved_w)
    gain_x = (
        P.xx * ixx + P.xy * ixy + P.xt * ixt,
        P.xx * ixy + P.xy * iyy + P.xt * iyt,
        P.xx * ixt + P.xy * iyt + P.xt * itt,
    )
    gain_y = (
        P.xy * ixx + P.yy * ixy + P.yt * ixt,
        P.xy * ixy + P.yy * iyy + P.yt * iyt,
        P.xy * ixt + P.yy * iyt + P.yt * itt,
    )
    gain_t = (
        P.xt * ixx + P.yt * ixy + P.tt * ixt,
        P.xt * ixy + P.yt * iyy + P.tt * iyt,
        P.xt * ixt + P.yt * iyt + P.tt * itt,
    )
    gain_v = (
        free_v * (P.xv * ixx + P.yv * ixy + P.tv * ixt),
        free_v * (P.xv * ixy + P.yv * iyy + P.tv * iyt),
        free_v * (P.xv * ixt + P.yv * iyt + P.tv * itt),
    )
    gain_w = (
        free_w * (P.xw * ixx + P.yw * ixy + P.tw * ixt),
        free_w * (P.xw * ixy + P.yw * iyy + P.tw * iyt),
        free_w * (P.xw * ixt + P.yw * iyt + P.tw * itt),
    )
    corrected = Mean(
        mean.x + P.xx * wx + P.xy * wy + P.xt * wt,
        mean.y + P.xy * wx + P.yy * wy + P.yt * wt,
        xp.wrap(mean.theta + P.xt * wx + P.yt * wy + P.tt * wt),
        xp.clip(mean.s_v + free_v * (P.xv * wx + P.yv * wy + P.tv * wt), settings.scale_min, settings.scale_max),
        xp.clip(mean.s_omega + free_w * (P.xw * wx + P.yw * wy + P.tw * wt), settings.scale_min, settings.scale_max),
    )
    return corrected, _joseph(P, fix, (gain_x, gain_y, gain_t, gain_v, gain_w)), nis


_Row = tuple[Any, Any, Any]


def _joseph(P: Covariance, R: Fix, gain: tuple[_Row, _Row, _Row, _Row, _Row]) -> Covariance:
    """(I - K H) P (I - K H)^T + K R K^T, written as A + (K R - A H^T) K^T with A = (I - K H) P."""
    (px, py, pt, pv, pw) = gain
    rows = ((P.xx, P.xy, P.xt), (P.xy, P.yy, P.yt), (P.xt, P.yt, P.tt), (P.xv, P.yv, P.tv), (P.xw, P.yw, P.tw))
    nx = _rest(px, rows[0], P, R)
    ny = _rest(py, rows[1], P, R)
    nt = _rest(pt, rows[2], P, R)
    nv = _rest(pv, rows[3], P, R)
    nw = _rest(pw, rows[4], P, R)
    return Covariance(
        P.xx - _dot(px, rows[0]) + _dot(nx, px),
        P.xy - _dot(px, rows[1]) + _dot(nx, py),
        P.xt - _dot(px, rows[2]) + _dot(nx, pt),
        P.xv - _dot(px, rows[3]) + _dot(nx, pv),
        P.xw - _dot(px, rows[4]) + _dot(nx, pw),
        P.yy - _dot(py, rows[1]) + _dot(ny, py),
        P.yt - _dot(py, rows[2]) + _dot(ny, pt),
        P.yv - _dot(py, rows[3]) + _dot(ny, pv),
        P.yw - _dot(py, rows[4]) + _dot(ny, pw),
        P.tt - _dot(pt, rows[2]) + _dot(nt, pt),
        P.tv - _dot(pt, rows[3]) + _dot(nt, pv),
        P.tw - _dot(pt, rows[4]) + _dot(nt, pw),
        P.vv - _dot(pv, rows[3]) + _dot(nv, pv),
        P.vw - _dot(pv, rows[4]) + _dot(nv, pw),
        P.ww - _dot(pw, rows[4]) + _dot(nw, pw),
    )


def _rest(k: _Row, row: _Row, P: Covariance, R: Fix) -> _Row:
    """One row of K R - (I - K H) P H^T = K S - P H^T; zero, up to rounding, at the optimal gain."""
    a, b, c = k
    return (
        a * (P.xx + R.xx) + b * (P.xy + R.xy) + c * (P.xt + R.xt) - row[0],
        a * (P.xy + R.xy) + b * (P.yy + R.yy) + c * (P.yt + R.yt) - row[1],
        a * (P.xt + R.xt) + b * (P.yt + R.yt) + c * (P.tt + R.tt) - row[2],
    )


def _dot(a: _Row, b: _Row) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def start(fix: Fix, settings: FilterSettings, s_v: Any = None, s_omega: Any = None) -> tuple[Mean, Covariance]:
    """Mean and covariance from a fix alone: nothing known of the drive scales but ``settings.scale_sigma``.

    Args:
        fix: the measured pose.
        settings: the prior of the scales.
        s_v: a scale to start from; 1 without it.
        s_omega: a scale to start from; 1 without it.
    """
    xp = elementwise.of(fix.x)
    zero = 0.0 * fix.x
    prior = zero + settings.scale_sigma * settings.scale_sigma
    mean = Mean(
        fix.x,
        fix.y,
        xp.wrap(fix.theta),
        zero + (1.0 if s_v is None else s_v),
        zero + (1.0 if s_omega is None else s_omega),
    )
    cov = Covariance(
        zero + fix.xx, zero + fix.xy, zero + fix.xt, zero, zero, zero + fix.yy, zero + fix.yt, zero, zero,
        zero + fix.tt, zero, zero, prior, zero, prior,
    )  # fmt: skip
    return mean, cov


def is_positive_definite(fix: Fix) -> bool:
    """Whether a fix's covariance is one: finite and positive definite. Plain floats only.

    Args:
        fix: the measured pose.
    """
    minor = fix.xx * fix.yy - fix.xy * fix.xy
    det = fix.tt * minor - fix.xx * fix.yt * fix.yt - fix.yy * fix.xt * fix.xt + 2.0 * fix.xy * fix.xt * fix.yt
    return math.isfinite(det) and fix.xx > 0.0 and minor > 0.0 and det > 0.0
