"""Processor time and memory of the processes of a run, over all their restarts."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from muro_zenoh.runtime.usage import read_usage
from muro_zenoh.scoring.sheet import ProcessUse


@dataclass(slots=True)
class Usage:
    """Processor time and memory of one process over all its restarts.

    Attributes:
        cpu: processor time since the first :meth:`note` [s].
        rss: largest resident memory seen [MB].
    """

    cpu: float = 0.0
    rss: float = 0.0
    _runs: dict[int, float] = field(default_factory=dict)

    def note(self, pid: int, *, first: bool = False) -> None:
        """Take a reading.

        Args:
            pid: pid of the current run.
            first: do not count what it has used until now.
        """
        reading = read_usage(pid)
        if reading is None:
            return
        before = self._runs.get(pid, reading.cpu if first else 0.0)
        self.cpu += reading.cpu - before
        self.rss = max(self.rss, reading.rss)
        self._runs[pid] = reading.cpu


class UsageTable:
    """Processor time and memory by process, since :meth:`begin`."""

    def __init__(self) -> None:
        self._of: dict[str, Usage] = {}

    def begin(self, processes: Iterable[tuple[str, int | None]]) -> None:
        """Start counting.

        Args:
            processes: name and current pid of each.
        """
        self._of = {}
        for name, pid in processes:
            usage = self._of[name] = Usage()
            if pid is not None:
                usage.note(pid, first=True)

    def note(self, processes: Iterable[tuple[str, int | None]]) -> None:
        """Take a reading; do so about every second, because what a process used after its last one is lost.

        Args:
            processes: name and current pid of each.
        """
        for name, pid in processes:
            if pid is not None:
                self._of.setdefault(name, Usage()).note(pid)

    def report(self, elapsed: float) -> dict[str, ProcessUse]:
        """Processor time and memory by process; all None without ``/proc``.

        Args:
            elapsed: time since :meth:`begin` [s].
        """
        if not Path("/proc/self/stat").exists() or elapsed <= 0.0:
            return {name: ProcessUse(None, None) for name in self._of}
        return {name: ProcessUse(100.0 * usage.cpu / elapsed, usage.rss) for name, usage in self._of.items()}
