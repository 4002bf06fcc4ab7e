"""What the pose filter believes, as settings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from muro_zenoh.errors import ParameterError
from muro_zenoh.quantities import AngleSize, Duration, Length, Positive, Quantity, SpeedOrRest, check_quantities


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
        history: how late a fix may come, behind the newest one, and still be used [s].
        odometry_timeout: odometry older than this is carried on by commands through the wheel model [s].
        command_timeout: a command older than this counts as zero: the base's command timeout [s].
        command_delay: from sending a command to the wheels obeying it [s].
        restart_fixes: this many gated fixes in a row that agree with each other restart the filter.
        restart_distance: agree means within this distance [m], the odometry in between taken off.
        restart_angle: and within this heading [rad].

    Raises:
        ParameterError: a number outside its limits.
    """

    gate: Positive = 21.1
    scale_gate: Positive = 11.3
    scale_sigma: Positive = 0.15
    scale_min: Annotated[float, Quantity(above=0.0, below=1.0)] = 0.5
    scale_max: Annotated[float, Quantity(above=1.0)] = 1.5
    scale_walk: Annotated[float, Quantity("1/sqrt(s)", at_least=0.0)] = 0.003
    slip: Annotated[float, Quantity("m/sqrt(m)", at_least=0.0)] = 0.01
    veer: Annotated[float, Quantity("rad/sqrt(m)", at_least=0.0)] = 0.01
    drift: Annotated[float, Quantity("m/sqrt(s)", at_least=0.0)] = 0.001
    drift_theta: Annotated[float, Quantity("rad/sqrt(s)", at_least=0.0)] = 0.003
    v_rest: SpeedOrRest = 0.01
    omega_rest: Annotated[float, Quantity("rad/s", at_least=0.0)] = 0.03
    history: Duration = 1.0
    odometry_timeout: Duration = 0.15
    command_timeout: Duration = 0.3
    command_delay: Duration = 0.0
    restart_fixes: Annotated[int, Quantity(at_least=2, whole=True)] = 5
    restart_distance: Length = 0.06
    restart_angle: AngleSize = 0.25

    def __post_init__(self) -> None:
        check_quantities(self)
        if self.scale_gate > self.gate:
            raise ParameterError("scale_gate", got=f"{self.scale_gate:g}", expected=f"at most gate, {self.gate:g}")
