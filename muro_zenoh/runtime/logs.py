"""Logs: one line per event, to standard error."""

from __future__ import annotations

import logging
import os
import sys


def set_up_logs(name: str) -> None:
    """Send this process's logs to standard error.

    Args:
        name: of the process; part of every line. The level is ``MURO_LOG`` (``debug``, ``info``, ``warning``).
    """
    level = os.environ.get("MURO_LOG", "info").upper()
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter(f"%(asctime)s.%(msecs)03d {name} %(levelname)s %(message)s", "%H:%M:%S"))
    logging.basicConfig(level=getattr(logging, level, logging.INFO), handlers=[handler], force=True)
