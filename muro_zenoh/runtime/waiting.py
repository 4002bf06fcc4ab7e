"""Logs what a process waits for: once per episode, and only when it lasts."""

from __future__ import annotations

import logging
import math
import re
from collections.abc import Sequence
from typing import Final

LASTING: Final = 3.0
"""Reasons that disappear within this time, as during the start of a fleet, are not logged [s]."""

_NUMBER = re.compile(r"(?<!\w)[0-9.]+")


def without_numbers(reasons: Sequence[str]) -> str:
    """Reasons without their ages and distances, to detect a change of reason.

    Args:
        reasons: the texts for operators; a number that is part of a name is kept.
    """
    return _NUMBER.sub("", "|".join(reasons)) if reasons else ""


class WaitingLog:
    """Logs the reasons for which a process cannot work.

    Args:
        log: the log.
        what: begins the line, such as ``stationary``.
        no_longer: the line at the end of a logged episode.
    """

    def __init__(self, log: logging.Logger, what: str, no_longer: str) -> None:
        self._log = log
        self._what = what
        self._no_longer = no_longer
        self._waiting_for = ""
        self._since = math.inf
        self._said = False  # this episode
        self._logged = False  # this one, or a previous one that it continues

    def note(self, now: float, reasons: Sequence[str]) -> None:
        """Update with the current reasons; call it at least once a second.

        Args:
            now: the time [s].
            reasons: the reasons; empty when the process works.
        """
        waiting_for = without_numbers(reasons)
        if waiting_for != self._waiting_for:
            self._waiting_for, self._since, self._said = waiting_for, now, False
        if not reasons:
            if self._logged:
                self._log.info("%s", self._no_longer)
            self._logged = False
        elif not self._said and now - self._since >= LASTING:
            self._said = self._logged = True
            self._log.warning("%s: %s", self._what, "; ".join(reasons))
