"""What a process waits for, in its log: once per episode, and only what lasts."""

from __future__ import annotations

import logging
import math
import re
from collections.abc import Sequence
from typing import Final

LASTING: Final = 3.0
"""What goes away by itself within this time, as while a fleet starts, is not worth a line [s]."""

_NUMBER = re.compile(r"(?<!\w)[0-9.]+")


def without_numbers(reasons: Sequence[str]) -> str:
    """Reasons without the ages and distances in them: what stays the same from one moment to the next.

    Args:
        reasons: as operators read them; a number that is part of a name stays.
    """
    return _NUMBER.sub("", "|".join(reasons)) if reasons else ""


class WaitingLog:
    """Logs the reasons for which a process does not do its work.

    Args:
        log: where to.
        what: begins the line, such as ``stationary``.
        no_longer: the line for the end of what was logged.
    """

    def __init__(self, log: logging.Logger, what: str, no_longer: str) -> None:
        self._log = log
        self._what = what
        self._no_longer = no_longer
        self._waiting_for = ""
        self._since = math.inf
        self._said = False  # of this very episode
        self._logged = False  # of this one, or of one that went over into it

    def note(self, now: float, reasons: Sequence[str]) -> None:
        """Take the reasons as they are now; call it once a second or more often.

        Args:
            now: the time [s].
            reasons: none when the process does its work.
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
