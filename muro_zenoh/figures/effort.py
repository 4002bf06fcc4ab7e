"""How much is simulated for a figure."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Effort:
    """How much is simulated for a figure; the defaults are what the published figures have.

    Args:
        starts: of each circle law, for distributions.
        trials: rings of ten of each pursuit law.
        share: of the length of every run, 0 to 1; for a quick look.
    """

    starts: int = 250
    trials: int = 25
    share: float = 1.0

    def __post_init__(self) -> None:
        if self.starts < 1 or self.trials < 1 or not 0.0 < self.share <= 1.0:
            raise ValueError(f"got {self}, expected at least one start and trial, and a share above 0, at most 1")

    def seconds(self, full: float) -> float:
        """Length of a run that has ``full`` seconds in the published figure [s]; one second at least.

        Args:
            full: that length [s].
        """
        return max(1.0, full * self.share)


PUBLISHED = Effort()
"""What the figures in the documentation were drawn with."""
