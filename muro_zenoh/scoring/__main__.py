"""Generates the tables of ``docs/scoresheet.md``: ``python -m muro_zenoh.scoring docs/scoresheet.md``."""

from __future__ import annotations

import sys
from pathlib import Path

from muro_zenoh.config.checks import Bound
from muro_zenoh.pages import markdown_table, with_generated
from muro_zenoh.scoring.checks import CHECKS, Judged
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
    checks = [
        (f"`{judged.name}`", _compared(judged), judged.unit, f"{judged.check.bound} the limit") for judged in CHECKS
    ]
    generated = (
        f"## Keys\n\n{markdown_table(('key', 'unit', 'definition'), keys)}\n"
        "## Checks\n\nSet in a scenario's `[checks]`; a check without a limit is not made.\n\n"
        f"{markdown_table(('check', 'value', 'unit', 'met when the value is'), checks)}"
    )
    return with_generated(text, "muro_zenoh.scoring", "docs/scoresheet.md", generated)


def _compared(judged: Judged) -> str:
    """The key that a check looks at, in words."""
    key = judged.check.key
    worst = "largest" if judged.check.bound is Bound.AT_MOST else "smallest"
    which = f"the {worst} `{key}`" if "<" in key else f"`{key}`"
    return which if judged.factor == 1.0 else f"{which}, in {judged.unit}"


if __name__ == "__main__":
    for name in sys.argv[1:]:
        path = Path(name)
        path.write_text(page(path.read_text(encoding="utf-8")), encoding="utf-8")
