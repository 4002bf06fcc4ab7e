"""Settings of the separation filter; the section ``[separation]`` of a settings file."""

from __future__ import annotations

from dataclasses import dataclass

from muro_zenoh.quantities import Length, Positive, check_quantities


@dataclass(frozen=True, slots=True, kw_only=True)
class SeparationSettings:
    """How robots keep apart.

    Args:
        enabled: whether the filter changes commands at all.
        margin: free floor between two bodies [m]: their centres keep the sum of the radii and this.
        wall_margin: free floor between a body and a wall [m].
        hold: the longest time for which the wheels may go on with a command before they brake [s]: the dead-man's time
            and one period.
        snapshot_limit: largest age of the newest snapshot with which a robot drives [s].

    Raises:
        ParameterError: a number outside its limits.
    """

    enabled: bool = True
    margin: Length = 0.046
    wall_margin: Length = 0.02
    hold: Positive = 0.35
    snapshot_limit: Positive = 0.5

    def __post_init__(self) -> None:
        check_quantities(self)
