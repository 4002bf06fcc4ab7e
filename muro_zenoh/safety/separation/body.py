"""What the separation filter knows of a robot's body, and what it sees of the fleet."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol


class Body(NamedTuple):
    """A robot's size and limits.

    ``radius`` of the body [m]; ``v_max`` [m/s] and ``omega_max`` [rad/s] of a command; ``a_max`` and ``brake``, largest
    growth and fall of the speed [m/s^2]; ``alpha_max``, largest growth of the turning rate [rad/s^2]; ``lag``, time
    constant of the wheels [s].
    """

    radius: float = 0.177
    v_max: float = 0.5
    omega_max: float = 1.5
    a_max: float = 0.5
    alpha_max: float = 3.0
    brake: float = 1.0
    lag: float = 0.1

    def scaled(self, s_v: float, s_omega: float) -> Body:
        """The body as its wheels drive it.

        Args:
            s_v: what they do of a commanded speed.
            s_omega: what they do of a commanded turning rate.
        """
        radius, v_max, omega_max, a_max, alpha_max, brake, lag = self
        return Body(radius, s_v * v_max, s_omega * omega_max, s_v * a_max, s_omega * alpha_max, s_v * brake, lag)


class RobotSeen(Protocol):
    """One robot of a snapshot: position and heading from the cameras, speeds from its agent [m, rad, s; world],
    ``age`` of the pose fix when the snapshot was sent [s], and ``state``."""

    @property
    def name(self) -> str: ...
    @property
    def x(self) -> float: ...
    @property
    def y(self) -> float: ...
    @property
    def theta(self) -> float: ...
    @property
    def v(self) -> float: ...
    @property
    def omega(self) -> float: ...
    @property
    def age(self) -> float: ...
    @property
    def state(self) -> str: ...


class SharedSnapshot(Protocol):
    """All robots at one moment, the same for every receiver: ``robots``; ``stamp`` [s, the base station's clock] and
    ``epoch`` of its sender; ``age``, time since it was sent [s]."""

    @property
    def robots(self) -> Sequence[RobotSeen]: ...
    @property
    def stamp(self) -> float: ...
    @property
    def epoch(self) -> int: ...
    @property
    def age(self) -> float: ...
