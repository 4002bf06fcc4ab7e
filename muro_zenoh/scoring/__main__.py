"""Generates the tables of ``docs/scoresheet.md``: ``python -m muro_zenoh.scoring docs/scoresheet.md``."""

from __future__ import annotations

import sys
from pathlib import Path

from muro_zenoh.pages import markdown_table, with_generated
from muro_zenoh.scoring.checks import CHECKS
from muro_zenoh.scoring.rows import definitions
from muro_zenoh.scoring.sheet import ScoreSheet


def page(text: str) -> str:
    """The page of the score sheet with its generated part replaced.

    Args:
        text: the page as it is; text outside the marks is kept.

    Raises:
        ConfigError: the marks are missing.
    """
    keys = [(f"`{key}`", unit, meaning) for key, unit, meaning in definitions(ScoreSheet)]
    checks = [(f"`{check.name}`", check.looks_at, check.unit, f"{check.bound} the limit") for check in CHECKS]
    generated = (
        f"## Keys\n\n{markdown_table(('key', 'unit', 'definition'), keys)}\n"
        "## Checks\n\nSet in a scenario's `[checks]`; a check without a limit is not made.\n\n"
        f"{markdown_table(('check', 'value', 'unit', 'met when the value is'), checks)}"
    )
    return with_generated(text, "muro_zenoh.scoring", "docs/scoresheet.md", generated)


if __name__ == "__main__":
    for name in sys.argv[1:]:
        path = Path(name)
        path.write_text(page(path.read_text(encoding="utf-8")), encoding="utf-8")
