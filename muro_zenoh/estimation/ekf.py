"""The extended Kalman filter of one unicycle and its two drive errors, in closed form, element by element.

State x, y, theta, s_v, s_omega: the wheels report (v, omega), the robot does (s_v v, s_omega omega), so that
calD = 1 / s_v and cal0 = 1 / s_omega (seed 000, section 3.3; seed 004, localization). The mean is five scalars and the
covariance its fifteen upper-triangle entries, each a float or an array with one entry per robot: an agent runs the
filter on plain floats, the lock-step rollout on thousands of robots at once, with the same code.

The covariance moves only when a fix is taken: :func:`drive` carries the pose along the inputs and gathers, meanwhile,
the Jacobian of the whole stretch since the last fix; :func:`predict` applies it once. The map is linear in s_v and
a rotation in theta, so those columns are exact in closed form.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from muro_zenoh import elementwise
from muro_zenoh.arcs import chord
from muro_zenoh.estimation.filter_settings import FilterSettings


class Mean(NamedTuple):
    """The state: ``x``, ``y`` [m, world], ``theta`` [rad], drive scales ``s_v`` and ``s_omega`` [1]."""

    x: Any
    y: Any
    theta: Any
    s_v: Any
    s_omega: Any


class Covariance(NamedTuple):
    """Upper triangle of the state's covariance, row by row: x, y, t (theta), v (s_v), w (s_omega) name row and column.

    ``xx``, ``xy``, ``yy`` [m^2]; ``xt``, ``yt`` [m rad]; ``tt`` [rad^2]; ``xv``, ``xw``, ``yv``, ``yw`` [m]; ``tv``,
    ``tw`` [rad]; ``vv``, ``vw``, ``ww`` [1].
    """

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
    """One measured pose: ``x``, ``y`` [m, world], ``theta`` [rad], and the upper triangle of its 3x3 covariance.

    ``xx``, ``xy``, ``yy`` [m^2]; ``xt``, ``yt`` [m rad]; ``tt`` [rad^2].
    """

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
    """A stretch driven from a mean: the pose at its end, and what the covariance needs to know of it.

    ``x``, ``y`` [m, world], ``theta`` [rad, not wrapped]. ``turn``: angle the nominal wheels turned [rad], signed.
    ``x_by_w``, ``y_by_w``: derivatives of the end's place by s_omega [m]. ``path``, ``spin``: distance and angle of the
    nominal wheels, unsigned [m], [rad]. ``time``: its length [s]. ``time_v``, ``time_w``: how much of it the scales
    could be seen [s].
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

    @property
    def moved_v(self) -> Any:
        """Whether s_v could be seen in it: the wheels drove for more than a tenth of its time."""
        return self.time_v > 0.1 * self.time

    @property
    def moved_w(self) -> Any:
        """Whether s_omega could be seen in it: the wheels turned for more than a tenth of its time."""
        return self.time_w > 0.1 * self.time


def begin(mean: Mean) -> Stretch:
    """The stretch of no length at ``mean``.

    Args:
        mean: where it begins.
    """
    zero = 0.0 * mean.x
    return Stretch(mean.x, mean.y, mean.theta, zero, zero, zero, zero, zero, 0.0, zero, zero)


def drive(stretch: Stretch, mean: Mean, v: Any, omega: Any, dt: Any, settings: FilterSettings) -> Stretch:
    """The stretch carried on along one arc of constant speeds; the derivatives hold for turns below 1 rad.

        d = s_v v dt sinc(h),  h = s_omega omega dt / 2:   x += d cos(theta + h),  y += d sin(theta + h),  theta += 2 h

    Args:
        stretch: the stretch so far.
        mean: where it began; only its drive scales are read.
        v: speed of the nominal wheels [m/s].
        omega: turning speed of the nominal wheels [rad/s].
        dt: how long [s].
        settings: the speeds that count as rest.
    """
    half_wheel = 0.5 * dt * omega
    h = mean.s_omega * half_wheel
    nominal = mean.s_v * dt * v
    d, cos, sin = chord(stretch.theta, nominal, h)
    dx, dy = d * cos, d * sin
    turn_mid = stretch.turn + half_wheel
    bend = nominal * half_wheel * h * (h * h / 30.0 - 1.0 / 3.0)  # sinc's derivative, as its series
    return Stretch(
        stretch.x + dx,
        stretch.y + dy,
        stretch.theta + 2.0 * h,
        turn_mid + half_wheel,
        stretch.x_by_w - dy * turn_mid + bend * cos,
        stretch.y_by_w + dx * turn_mid + bend * sin,
        stretch.path + abs(v) * dt,
        stretch.spin + 2.0 * abs(half_wheel),
        stretch.time + dt,
        stretch.time_v + (abs(v) > settings.v_rest) * dt,
        stretch.time_w + (abs(omega) > settings.omega_rest) * dt,
    )


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
    xx, xy, xt, xv, xw, yy, yt, yv, yw, tt, tv, tw, vv, vw, ww = P
    dx, dy = stretch.x - mean.x, stretch.y - mean.y
    # F = I but for the columns theta (-dy, dx), s_v (bx, by) and s_omega (cx, cy, turn)
    bx, by = dx / mean.s_v, dy / mean.s_v
    cx, cy, turn = stretch.x_by_w, stretch.y_by_w, stretch.turn

    # F P, the rows that change; the columns below the diagonal only where the product needs them
    x_t = xt - dy * tt + bx * tv + cx * tw
    x_v = xv - dy * tv + bx * vv + cx * vw
    x_w = xw - dy * tw + bx * vw + cx * ww
    x_x = xx - dy * xt + bx * xv + cx * xw
    x_y = xy - dy * yt + bx * yv + cx * yw
    y_t = yt + dx * tt + by * tv + cy * tw
    y_v = yv + dx * tv + by * vv + cy * vw
    y_w = yw + dx * tw + by * vw + cy * ww
    y_y = yy + dx * yt + by * yv + cy * yw
    t_t = tt + turn * tw
    t_v = tv + turn * vw
    t_w = tw + turn * ww

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
            vv + walk * stretch.time_v,
            vw,
            ww + walk * stretch.time_w,
        ),
    )


def correct(
    mean: Mean, P: Covariance, fix: Fix, moved_v: Any, moved_w: Any, settings: FilterSettings
) -> tuple[Mean, Covariance, Any]:
    """Mean and covariance after one fix, and the fix's squared Mahalanobis distance. The gate is the caller's.

    With B = P[:, pose] and S = B[pose] + R the gain is K = B S^-1, its rows zero for a scale that is frozen or a fix
    beyond ``scale_gate``, and P' is Joseph's form, right for any gain, multiplied out:

        P' = (I - K H) P (I - K H)^T + K R K^T = P - K B^T - B K^T + K S K^T

    A row at its optimum has K S = B, so its terms are - B S^-1 B^T; so are those of the covariances of a frozen scale
    with the pose, while its own variance stays as it is. S = L D L^T gives all of it by substitution:
    U = B L^-T, B S^-1 B^T = U D^-1 U^T. The heading's innovation is wrapped.

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
    xx, xy, xt, xv, xw, yy, yt, yv, yw, tt, tv, tw, vv, vw, ww = P
    # S = L D L^T, of (x, y, theta)
    dx = 1.0 / (xx + fix.xx)
    syx, stx, syt = xy + fix.xy, xt + fix.xt, yt + fix.yt
    lyx, ltx = syx * dx, stx * dx
    dy = 1.0 / (yy + fix.yy - lyx * syx)
    uty = syt - ltx * syx
    lty = uty * dy
    dt = 1.0 / (tt + fix.tt - ltx * stx - lty * uty)
    # the innovation in those coordinates
    ex = fix.x - mean.x
    ey = fix.y - mean.y - lyx * ex
    et = xp.wrap(fix.theta - mean.theta) - ltx * ex - lty * ey
    nis = ex * ex * dx + ey * ey * dy + et * et * dt

    # U = B L^-T row by row: its first column is B's, b its second, c its third
    xb, yb, tb, vb, wb = xy - lyx * xx, yy - lyx * xy, yt - lyx * xt, yv - lyx * xv, yw - lyx * xw
    xc = xt - ltx * xx - lty * xb
    yc = yt - ltx * xy - lty * yb
    tc = tt - ltx * xt - lty * tb
    vc = tv - ltx * xv - lty * vb
    wc = tw - ltx * xw - lty * wb
    # U D^-1
    x1, x2, x3 = xx * dx, xb * dy, xc * dt
    y1, y2, y3 = xy * dx, yb * dy, yc * dt
    t1, t2, t3 = xt * dx, tb * dy, tc * dt
    v1, v2, v3 = xv * dx, vb * dy, vc * dt
    w1, w2, w3 = xw * dx, wb * dy, wc * dt

    passed = nis <= settings.scale_gate
    free_v, free_w = 1.0 * (passed & moved_v), 1.0 * (passed & moved_w)
    low, high = settings.scale_min, settings.scale_max
    return (
        Mean(
            mean.x + x1 * ex + x2 * ey + x3 * et,
            mean.y + y1 * ex + y2 * ey + y3 * et,
            xp.wrap(mean.theta + t1 * ex + t2 * ey + t3 * et),
            xp.clip(mean.s_v + free_v * (v1 * ex + v2 * ey + v3 * et), low, high),
            xp.clip(mean.s_omega + free_w * (w1 * ex + w2 * ey + w3 * et), low, high),
        ),
        Covariance(
            xx - x1 * xx - x2 * xb - x3 * xc,
            xy - x1 * xy - x2 * yb - x3 * yc,
            xt - x1 * xt - x2 * tb - x3 * tc,
            xv - x1 * xv - x2 * vb - x3 * vc,
            xw - x1 * xw - x2 * wb - x3 * wc,
            yy - y1 * xy - y2 * yb - y3 * yc,
            yt - y1 * xt - y2 * tb - y3 * tc,
            yv - y1 * xv - y2 * vb - y3 * vc,
            yw - y1 * xw - y2 * wb - y3 * wc,
            tt - t1 * xt - t2 * tb - t3 * tc,
            tv - t1 * xv - t2 * vb - t3 * vc,
            tw - t1 * xw - t2 * wb - t3 * wc,
            vv - free_v * (v1 * xv + v2 * vb + v3 * vc),
            vw - (free_v + free_w - free_v * free_w) * (v1 * xw + v2 * wb + v3 * wc),
            ww - free_w * (w1 * xw + w2 * wb + w3 * wc),
        ),
        nis,
    )


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


_LEAST_VARIANCE, _GREATEST_VARIANCE = 1e-12, 1e6
_LEAST_INDEPENDENCE = 1e-6


def is_covariance(fix: Fix) -> bool:
    """Whether a fix's covariance is one that can be calculated with: positive definite, by more than the floats'
    rounding, and between a micrometre and a kilometre. Plain floats only.

    Args:
        fix: the measured pose.
    """
    minor = fix.xx * fix.yy - fix.xy * fix.xy
    det = fix.tt * minor - fix.xx * fix.yt * fix.yt - fix.yy * fix.xt * fix.xt + 2.0 * fix.xy * fix.xt * fix.yt
    area = fix.xx * fix.yy
    return (
        all(_LEAST_VARIANCE <= variance <= _GREATEST_VARIANCE for variance in (fix.xx, fix.yy, fix.tt))
        and minor > 0.0
        and det >= _LEAST_INDEPENDENCE * area * fix.tt
    )
