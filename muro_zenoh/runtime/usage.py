"""Processor time and memory of processes, from Linux's ``/proc``. Elsewhere there are no numbers."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Reading:
    """Processor time and memory of a process.

    Attributes:
        cpu: processor time since its start, user and system [s].
        rss: resident memory now [MB of 10^6 bytes].
    """

    cpu: float
    rss: float


def read_usage(pid: int) -> Reading | None:
    """The usage of a process so far; None when it has exited, or without ``/proc``.

    Args:
        pid: pid of the process.
    """
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
        pages = Path(f"/proc/{pid}/statm").read_text().split()[1]
    except (OSError, IndexError):
        return None
    # The second field is the program's name in brackets and may contain anything; count the fields after it.
    fields = stat.rpartition(")")[2].split()
    ticks = int(fields[11]) + int(fields[12])
    return Reading(ticks / os.sysconf("SC_CLK_TCK"), int(pages) * os.sysconf("SC_PAGE_SIZE") / 1e6)


def own_usage() -> dict[str, float]:
    """The usage of this process, as gauges of its health."""
    reading = read_usage(os.getpid())
    return {} if reading is None else {"cpu_s": reading.cpu, "memory_mb": round(reading.rss, 1)}
