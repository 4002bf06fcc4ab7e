"""Whether a run has passed, and why not. Pure."""

from __future__ import annotations

from muro_zenoh.scoring.sheet import ScoreSheet


def passed(sheet: ScoreSheet) -> bool | None:
    """Whether nothing went wrong and something was checked; None when nothing was.

    Args:
        sheet: the score sheet, with the results of its checks.
    """
    if _shortcomings(sheet):
        return False
    return True if sheet.checks else None


def verdict(sheet: ScoreSheet) -> str:
    """The verdict in one line.

    Args:
        sheet: the score sheet.
    """
    why = _shortcomings(sheet)
    if why:
        return f"NOT PASSED ({'; '.join(why if sheet.checks else (*why, 'nothing was checked'))})"
    return "passed" if sheet.checks else "nothing was checked: the scenario sets no limit in [checks]"


def _shortcomings(sheet: ScoreSheet) -> list[str]:
    found = []
    if sheet.ended != "duration":
        found.append(sheet.ended)
    if sheet.failures:
        found.append(f"the behaviour of {' '.join(sheet.failures)} failed or ended early")
    if missed := [name for name, check in sheet.checks.items() if not check.passed]:
        found.append(f"{', '.join(missed)} not met")
    return found
