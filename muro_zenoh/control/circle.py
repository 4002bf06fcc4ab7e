"""Circular path following: the turning rate that takes a unicycle to a circle and around it.

Notation of all three laws: ``h = (cos theta, sin theta)``, ``p`` the position minus the centre, ``rho = |p|``,
``phi = atan2(p)``, ``r`` the radius, ``sigma`` = +1 counter-clockwise, -1 clockwise. Each law is
``law(x, y, theta, v, circle, gains) -> omega``, takes floats or arrays that broadcast, keeps no state, and
returns an unlimited turning rate: limits and drive calibration belong to `drive`, once, after the law.

Every law is defined

* at ``v = 0``: it turns on the spot towards the heading it would drive in;
* at the centre: ``atan2(0, 0) = 0``, and any direction out is acceptable;
* while the centre moves: the circle is an argument of each call, and only the position relative to it matters.

``v`` is the actual speed (drive scale times modelled wheel speed), not below 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Final

from muro_zenoh.elementwise import Scalar, of
from muro_zenoh.errors import ParameterError
from muro_zenoh.geometry import Circle, State, Twist2
from muro_zenoh.quantities import AngleSize, Length, Quantity, TurningRate, check_quantities


@dataclass(frozen=True, slots=True)
class VectorFieldGains:
    """Gains of :func:`vector_field`.

    Args:
        k_o: steepness of the approach [1/m]: at ``1/k_o`` from the circle the field comes in at 45 degrees. A steeper
            one is quicker at 0.15 m/s and slower from 0.4 m/s on, where wheels with a lag of 0.2 s begin to hunt.
        k_h: heading gain [1/s].
        feedforward_max: clamp on the field's own turning rate [rad/s], which grows without limit near the centre.
        rho_0: minimum distance to divide by [m].
    """

    NAME: ClassVar[str] = "vector_field"

    k_o: Annotated[float, Quantity("1/m", above=0.0)] = 19.0
    k_h: Annotated[float, Quantity("1/s", above=0.0)] = 3.0
    feedforward_max: TurningRate = 3.0
    rho_0: Length = 0.05

    def __post_init__(self) -> None:
        check_quantities(self)


@dataclass(frozen=True, slots=True)
class PassivityGains:
    """Gain of :func:`passivity`.

    Args:
        psi: passivity gain [1/(m^2 s)]. Too small keeps overshooting, too large creeps (seed 000, figures 1 to 3).
            The loop linearised about the circle is critically damped at ``2 v / r^3``; from random starts about
            0.6 of that is best, which is the default for 0.15 m/s on 0.6 m.
    """

    NAME: ClassVar[str] = "passivity"

    psi: Annotated[float, Quantity("1/(m^2 s)", above=0.0)] = 0.8

    def __post_init__(self) -> None:
        check_quantities(self)


@dataclass(frozen=True, slots=True)
class LqrGains:
    """Weights of :func:`lqr`, each given as the error of unit cost (Bryson's rule).

    Args:
        radial_size: radial error of unit cost [m].
        heading_size: heading error of unit cost [rad].
        turn_size: turning rate, beyond that of the circle itself, of unit cost [rad/s].
    """

    NAME: ClassVar[str] = "lqr"

    radial_size: Length = 0.03
    heading_size: AngleSize = 1.0
    turn_size: TurningRate = 1.0

    def __post_init__(self) -> None:
        check_quantities(self)


def radius_error(x: Scalar, y: Scalar, circle: Circle) -> Scalar:
    """How far outside the circle a position is, ``rho - r`` [m]; negative inside.

    Args:
        x: position [m, world].
        y: position [m, world].
        circle: the circle.
    """
    error: Scalar = of(x).hypot(x - circle.x, y - circle.y) - circle.radius
    return error


def vector_field(x: Scalar, y: Scalar, theta: Scalar, v: Scalar, circle: Circle, gains: VectorFieldGains) -> Scalar:
    """Turning rate [rad/s] that follows a vector field which spirals onto the circle; the default.

    ::

        chi   = phi + sigma (pi/2 + atan(k_o (rho - r)))
        omega = v sin(theta - phi) / max(rho, rho_0)
                + sigma k_o v cos(theta - phi) / (1 + k_o^2 (rho - r)^2)      (both clamped: the field's own turning)
                - k_h wrap(theta - chi)

    The first two terms are d chi / dt, so the heading error falls as exp(-k_h t) and, on the field,
    d rho / dt = -v sin(atan(k_o (rho - r))): both converge from everywhere, whatever v > 0.

    Args:
        x: position [m, world].
        y: position [m, world].
        theta: heading [rad].
        v: actual speed [m/s], not below 0.
        circle: the circle and the direction of travel.
        gains: the gains.

    Source: vector-field path following (Nelson, Barber, McLain, Beard, IEEE T-RO 2007) with the exact feed-forward.
    """
    xp = of(x)
    px, py = x - circle.x, y - circle.y
    rho, phi = xp.hypot(px, py), xp.atan2(py, px)
    sigma = circle.sigma
    steep = gains.k_o * (rho - circle.radius)
    chi = phi + sigma * (0.5 * math.pi + xp.atan(steep))
    bearing = theta - phi
    along = v * xp.sin(bearing) / xp.maximum(rho, gains.rho_0)
    across = sigma * gains.k_o * v * xp.cos(bearing) / (1.0 + steep * steep)
    forward = xp.clip(along + across, -gains.feedforward_max, gains.feedforward_max)
    omega: Scalar = forward - gains.k_h * xp.wrap(theta - chi)
    return omega


def passivity(x: Scalar, y: Scalar, theta: Scalar, v: Scalar, circle: Circle, gains: PassivityGains) -> Scalar:
    """Turning rate [rad/s] of the passivity-based law of seed 000.

    ::

        omega = sigma (v / r + psi r (p . h))

    The sign is plus: with V = 1/2 |(p_x - r sin theta, p_y + r cos theta)|^2 (counter-clockwise), dV/dt is
    -r u_c (p . h), which is negative only for u_c = +psi r (p . h). The seed's C++ has a minus because its camera's yaw
    is rotated by pi. Clockwise the whole law is negated.

    Args:
        x: position [m, world].
        y: position [m, world].
        theta: heading [rad].
        v: actual speed [m/s], not below 0.
        circle: the circle and the direction of travel.
        gains: the gain.

    Source: El-Hawwary and Maggiore, Global path following for the unicycle and other results, ACC 2008; seed 000,
    section 3.1.
    """
    xp = of(x)
    p_dot_h = (x - circle.x) * xp.cos(theta) + (y - circle.y) * xp.sin(theta)
    omega: Scalar = circle.sigma * (v / circle.radius + gains.psi * circle.radius * p_dot_h)
    return omega


def lqr_feedback(v: Scalar, radius: float, gains: LqrGains) -> tuple[Scalar, Scalar]:
    """The optimal feedback gains about a circle, ``(k_e, k_h)`` of ``u = k_e e - k_h epsilon``.

    With ``e = rho - r`` and ``epsilon`` the heading error relative to the tangent (positive in the direction of
    travel), the unicycle about the circle is, for ``u = sigma omega - v / r``::

        d e / dt       = -v epsilon
        d epsilon / dt = (v / r^2) e + u

    and the cost is the integral of ``q_e e^2 + q_h epsilon^2 + u^2`` with ``q_e = (turn_size / radial_size)^2`` and
    ``q_h = (turn_size / heading_size)^2``. The 2x2 algebraic Riccati equation then has the closed form::

        k_e = sqrt((v / r^2)^2 + q_e) - v / r^2
        k_h = sqrt(q_h + 2 v k_e)

    It stays finite at ``v = 0``, where the radius cannot be controlled: the limit is the law for turning on the spot.

    Args:
        v: speed [m/s], not below 0.
        radius: the circle's radius [m].
        gains: the weights.

    Returns:
        ``k_e`` [rad/(m s)] and ``k_h`` [1/s], both positive.

    Source: the optimal gain by the Riccati equation that seed 000 calls for (section 4.1.1).
    """
    xp = of(v)
    w = v / (radius * radius)
    q_e = (gains.turn_size / gains.radial_size) ** 2
    q_h = (gains.turn_size / gains.heading_size) ** 2
    k_e: Scalar = xp.sqrt(w * w + q_e) - w
    k_h: Scalar = xp.sqrt(q_h + 2.0 * v * k_e)
    return k_e, k_h


def lqr(x: Scalar, y: Scalar, theta: Scalar, v: Scalar, circle: Circle, gains: LqrGains) -> Scalar:
    """Turning rate [rad/s] with the optimal gain about the circle, extended to the whole plane.

    ::

        epsilon = wrap(sigma (theta - phi) - pi/2)
        omega   = sigma (v / r + k_h wrap(atan((k_e / k_h) e) - epsilon))

    To first order at the circle this is ``u = k_e e - k_h epsilon`` of :func:`lqr_feedback`. The arctangent limits
    the linear law's heading demand to a quarter turn towards the circle, so it converges from any distance.

    The seed's own law feeds back only ``p . h = -rho sin(epsilon)``, that is ``k_e = 0`` and ``k_h = psi r^2``: it
    does not feed back the radius error, so no ``psi`` makes it converge fast.

    Args:
        x: position [m, world].
        y: position [m, world].
        theta: heading [rad].
        v: actual speed [m/s], not below 0.
        circle: the circle and the direction of travel.
        gains: the weights.
    """
    xp = of(x)
    px, py = x - circle.x, y - circle.y
    sigma = circle.sigma
    k_e, k_h = lqr_feedback(v, circle.radius, gains)
    epsilon = sigma * (theta - xp.atan2(py, px)) - 0.5 * math.pi
    approach = xp.atan(k_e / k_h * (xp.hypot(px, py) - circle.radius))
    omega: Scalar = sigma * (v / circle.radius + k_h * xp.wrap(approach - epsilon))
    return omega


CircleGains = VectorFieldGains | PassivityGains | LqrGains
"""The gains of one of the laws; their type selects it."""

CircleFunction = Callable[[Any, Any, Any, Any, Circle, Any], Any]
"""The signature of every circle law: ``law(x, y, theta, v, circle, gains) -> omega``."""

_FUNCTIONS: Final[Mapping[type[Any], CircleFunction]] = {
    VectorFieldGains: vector_field,
    PassivityGains: passivity,
    LqrGains: lqr,
}

CIRCLE_LAWS: Final[Mapping[str, type[Any]]] = MappingProxyType({gains.NAME: gains for gains in _FUNCTIONS})
"""The gains of each circle law by the name that settings use; the first is the default."""


@dataclass(frozen=True, slots=True)
class CircleLaw:
    """A circle law with its gains: ``law(x, y, theta, v, circle) -> omega``.

    Args:
        gains: the gains; their type selects the law.
    """

    gains: CircleGains = VectorFieldGains()

    def __call__(self, x: Scalar, y: Scalar, theta: Scalar, v: Scalar, circle: Circle) -> Scalar:
        """Turning rate [rad/s].

        Args:
            x: position [m, world].
            y: position [m, world].
            theta: heading [rad].
            v: actual speed [m/s], not below 0.
            circle: the circle and the direction of travel.
        """
        omega: Scalar = _FUNCTIONS[type(self.gains)](x, y, theta, v, circle, self.gains)
        return omega


def circle_law(name: str = VectorFieldGains.NAME, **gains: float) -> CircleLaw:
    """A circle law by name, with some of its gains changed.

    Args:
        name: a key of :data:`CIRCLE_LAWS`.
        gains: gains that differ from the default, by name.

    Raises:
        ParameterError: no such law, no such gain (the message lists the valid ones), or a gain that is not above 0.
    """
    kind = CIRCLE_LAWS.get(name)
    if kind is None:
        raise ParameterError("circle law", got=repr(name), expected=f"one of {', '.join(CIRCLE_LAWS)}")
    known = [field.name for field in fields(kind)]
    for gain in gains:
        if gain not in known:
            raise ParameterError(
                f"gain of the circle law {name}", got=repr(gain), expected=f"one of {', '.join(known)}"
            )
    return CircleLaw(kind(**gains))


def circle_twist(ahead: State, speed: Any, circle: Circle, law: CircleLaw) -> Twist2:
    """The twist that follows a circle at a speed; floats or arrays.

    In reverse the laws diverge from the circle and leave the arena, so a speed below 0 is taken as 0.

    Args:
        ahead: the robot's predicted state when the twist takes effect.
        speed: desired speed [m/s].
        circle: the circle and the direction of travel.
        law: the law.
    """
    maximum = of(ahead.x).maximum
    return Twist2(maximum(speed, 0.0), law(ahead.x, ahead.y, ahead.theta, maximum(ahead.v, 0.0), circle))
