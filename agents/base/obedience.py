"""Whether wheels do what they are commanded, or somebody else turns them: a joystick, a hand, a second program."""

from __future__ import annotations

from typing import Final

from muro_zenoh.estimation.wheel_model import WheelLimits, step_wheels

SPEED: Final = 0.1
TURNING: Final = 0.6
"""Wheels may differ from their model by this [m/s], [rad/s] ..."""

LASTING: Final = 0.3
"""... and by more for this time, while a command is new [s]."""

_FORGETTING: Final = 2.0
"""The model forgets a difference in about this time [s]."""


class Obedience:
    """Compares the speeds that wheels report with a model that was given the same commands.

    Args:
        limits: of the wheels.

    Attributes:
        unruly: whether they have done otherwise for a while.
    """

    def __init__(self, limits: WheelLimits) -> None:
        self.unruly = False
        self._limits = limits
        self._command = (0.0, 0.0)
        self._model = (0.0, 0.0)
        self._time: float | None = None
        self._since: float | None = None

    def command(self, v: float, omega: float, now: float) -> None:
        """Take what the wheels are commanded.

        Args:
            v: [m/s].
            omega: [rad/s].
            now: the time [s].
        """
        self._advance(now)
        self._command = v, omega

    def read(self, v: float, omega: float, now: float) -> None:
        """Take what the wheels report; call it at each beat.

        Args:
            v: [m/s].
            omega: [rad/s].
            now: the time [s].
        """
        passed = self._advance(now)
        if not 0.0 <= passed <= LASTING:  # the process was frozen: what the wheels did meanwhile is not known
            self._model, self._since = (v, omega), None
            return
        # Small differences, of the model and of the moment at which a command counts, must not add up.
        share = passed / _FORGETTING
        v_model, omega_model = self._model
        v_model += share * (v - v_model)
        omega_model += share * (omega - omega_model)
        self._model = v_model, omega_model
        if abs(v - v_model) <= SPEED and abs(omega - omega_model) <= TURNING:
            self.unruly, self._since = False, None
            return
        if self._since is None:
            self._since = now
        self.unruly = now - self._since >= LASTING

    def _advance(self, now: float) -> float:
        """Advance the model to now; returns the time since it was last advanced [s]."""
        passed = now - self._time if self._time is not None else 0.0
        self._time = now
        if 0.0 < passed <= LASTING:
            self._model = step_wheels(*self._model, *self._command, self._limits, passed)
        return passed
