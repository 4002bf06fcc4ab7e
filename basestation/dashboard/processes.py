"""The processes of a fleet, from what each reports of itself."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Any

from muro_zenoh.channels import Role
from muro_zenoh.messages import Health
from muro_zenoh.transport import Received


class _Usage:
    """What one process used and received between its last two reports."""

    def __init__(self) -> None:
        self._at = math.nan
        self._numbers: Mapping[str, float] = {}
        self.cpu: float | None = None
        self.rates: dict[str, float] = {}

    def take(self, report: Health) -> None:
        """Take a report; one that is known changes nothing."""
        elapsed = report.stamp - self._at
        if elapsed <= 0.0:
            return
        before, numbers = self._numbers, report.numbers
        self._at, self._numbers = report.stamp, numbers
        self.cpu, self.rates = None, {}
        if math.isnan(elapsed):
            return
        if "cpu_s" in numbers and "cpu_s" in before:
            self.cpu = round(100.0 * max(0.0, numbers["cpu_s"] - before["cpu_s"]) / elapsed, 1)
        for key, count in numbers.items():
            if key.endswith("_received") and key in before:
                self.rates[key.removesuffix("_received")] = round(max(0.0, count - before[key]) / elapsed, 1)


class Processes:
    """Makes the rows of the health table.

    Args:
        agents: the robots that are to have agents.
        cameras: those that are to have processes, unless a simulator films.
    """

    def __init__(self, agents: Collection[str] = (), cameras: Collection[str] = ()) -> None:
        self._agents = agents
        self._cameras = cameras
        self._usage: dict[str, _Usage] = {}

    def rows(
        self, now: float, healths: Mapping[str, Received[Health]], alive: Collection[tuple[str, str]]
    ) -> dict[str, dict[str, Any]]:
        """A row for each process that is alive, or has been, or is missing.

        Args:
            now: the time [s].
            healths: what each reports.
            alive: role and name of those that are alive.
        """
        # A robot's base has the robot's name, and so has its agent.
        roles = {f"{name}/base" if role == Role.BASE else name: role for role, name in alive}
        expected = dict.fromkeys(self._agents, Role.AGENT)
        if Role.SIMULATOR not in roles.values():
            expected |= dict.fromkeys(self._cameras, Role.CAMERA)
        rows = {name: self._row(name, now, healths.get(name), roles) for name in {*healths, *roles}}
        missing = {name: {**_MISSING, "role": role} for name, role in expected.items() if name not in rows}
        return dict(sorted({**rows, **missing}.items()))

    def _row(
        self, name: str, now: float, received: Received[Health] | None, roles: Mapping[str, str]
    ) -> dict[str, Any]:
        row: dict[str, Any] = {"role": roles.get(name, ""), "alive": name in roles, "state": "", "age": None}
        if received is None:
            return {**row, **_NOTHING}
        report, usage = received.message, self._usage.setdefault(name, _Usage())
        usage.take(report)
        numbers = report.numbers
        return {
            "role": report.role,
            "alive": name in roles,
            "state": report.state,
            "age": round(received.age(now), 1),
            "reasons": list(report.reasons),
            "complaints": list(report.complaints),
            "cpu": usage.cpu,
            "memory": numbers.get("memory_mb"),
            "rates": usage.rates,
            "ages": _ages(numbers),
            "drops": _total(numbers, "_dropped"),
            "rejects": _total(numbers, "_rejected"),
        }


_NOTHING: Mapping[str, Any] = {
    "reasons": [],
    "complaints": [],
    "cpu": None,
    "memory": None,
    "rates": {},
    "ages": {},
    "drops": 0,
    "rejects": 0,
}


_MISSING: Mapping[str, Any] = {
    **_NOTHING,
    "alive": False,
    "state": "missing",
    "age": None,
    "reasons": ["it is not there"],
}


def _ages(numbers: Mapping[str, float]) -> dict[str, float]:
    return {key.removesuffix("_age_s"): round(age, 2) for key, age in numbers.items() if key.endswith("_age_s")}


def _total(numbers: Mapping[str, float], end: str) -> int:
    return int(sum(count for key, count in numbers.items() if key.endswith(end)))
