"""The faults to plant fit the code; that `muro check` finds them is measured by tests/planted.py."""

from __future__ import annotations

import ast
from typing import Any

import pytest

from muro_zenoh.checking import fleet, minimal
from muro_zenoh.checking.trial import run_trial
from muro_zenoh.config import parse_scenario
from muro_zenoh.safety.separation.certificate import Certificate
from muro_zenoh.transport import Bus
from tests import planted


@pytest.mark.parametrize("fault", planted.planted(), ids=lambda fault: fault.name)
def test_each_can_be_planted(fault: planted.Planted) -> None:
    ast.parse(planted.changed(fault))
    assert fault.old != fault.new


def test_there_are_twenty_with_names_of_their_own() -> None:
    names = [fault.name for fault in planted.planted()]
    assert len(set(names)) == len(names) >= 20


@pytest.mark.parametrize("kind", ["crash", "freeze"])
def test_a_base_that_waits_twice_as_long_is_found_though_its_wheels_have_a_watchdog(
    monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    run_bases = fleet.run_bases

    def patient(bus: Bus, wheels: Any, clock: Any, dead_man: float, limits: Any) -> Any:
        return run_bases(bus, wheels, clock, 2.0 * dead_man, limits)

    monkeypatch.setattr(fleet, "run_bases", patient)
    table = {
        "robots": 1,
        "duration": 6.0,
        "camera": {"north": {}},
        "behaviour": {"name": "circle"},
        "fault": [{"kind": kind, "target": "r1/agent", "at": 4.0}],
    }
    _, result = run_trial(parse_scenario(table, "lab.toml", name="lab"), 1)
    assert "blind" in {breach.promise for breach in result.breaches}


def test_a_filter_that_lets_everything_pass_is_found_and_its_trial_shrunk(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same as the planted fault, in this process."""
    monkeypatch.setattr(Certificate, "blocker", lambda self, command: "")
    monkeypatch.setattr("muro_zenoh.safety.separation.filter.rows_of", lambda x, y, near: [])
    monkeypatch.setattr("muro_zenoh.safety.separation.filter.first_met", lambda *arguments: (99.0, None))
    table = {
        "robots": 4,
        "duration": 6.0,
        "camera": {"north": {}},
        "behaviour": {"name": "steer", "speed": 0.4},
        "starts": {"r1": [-1, 0, 0], "r2": [1, 0, 3.14], "r3": [-1, 1, 0], "r4": [1, -1, 3.14]},
        "goals": {"r1": [[1.6, 0]], "r2": [[-1.6, 0]], "r3": [[0, 1]], "r4": [[0, -1]]},
        "fault": [{"kind": "jitter", "target": "r3", "at": 1.0, "duration": 2.0, "jitter": 0.1}],
    }
    scenario = parse_scenario(table, "lab.toml", name="lab")
    record, result = run_trial(scenario, 1)
    breach = next(breach for breach in result.breaches if breach.promise == "no contact")
    least = minimal.minimal(minimal.with_starts(record), 1, breach, minimal.breach_of("no contact"))
    assert set(least.scenario.robots) == {"r1", "r2"}
    assert least.scenario.faults == ()
    assert least.scenario.duration < 6.0
