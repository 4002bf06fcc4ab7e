"""The ``[[fault]]`` tables: right ones are read, wrong ones are refused with the key."""

from __future__ import annotations

import math
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

from muro_zenoh.config import Fault, Scenario, Section, as_table, parse_scenario
from muro_zenoh.config.faults import KINDS, CarryFault, DelayFault, Place
from muro_zenoh.errors import ConfigError

NEEDS: dict[str, dict[str, Any]] = {
    "delay": {"delay": 0.3},
    "jitter": {"jitter": 0.1},
    "loss": {"fraction": 0.2},
    "duplicate": {"fraction": 0.5},
    "reorder": {"fraction": 0.5},
    "clock_step": {"step": -2.0},
    "carry": {"duration": 2.0, "x": 0.5},
}
"""What a kind cannot do without."""

TARGETS = {
    Place.ROBOT: "r1",
    Place.AGENT: "r1/agent",
    Place.BASE: "r1/base",
    Place.BASESTATION: "basestation",
    Place.CAMERAS: "camera",
    Place.CAMERA: "camera/north",
    Place.ROUTER: "router",
}


def lab(*faults: object) -> Scenario:
    table = {"robots": 2, "camera": {"north": {}}, "fault": list(faults)}
    return parse_scenario(table, "lab.toml", name="lab")


def row(kind: str, **given: object) -> dict[str, Any]:
    return {"kind": kind, "target": TARGETS[KINDS[kind].places[0]], **NEEDS.get(kind, {}), **given}


def kinds_of(kind: type[Section]) -> list[type[Section]]:
    return [kind, *(below for child in kind.__subclasses__() for below in kinds_of(child))]


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_survives_the_way_to_another_process(kind: str) -> None:
    scenario = lab(row(kind, at=3.0))
    [fault] = scenario.faults
    assert (fault.kind, fault.at) == (kind, 3.0)
    assert parse_scenario(as_table(scenario), "run.json", name="lab") == scenario


@pytest.mark.parametrize("kind", KINDS)
def test_a_fault_befalls_what_it_can_and_nothing_else(kind: str) -> None:
    for place, target in TARGETS.items():
        if place in KINDS[kind].places:
            [fault] = lab(row(kind, target=target)).faults
            assert fault.place is place
            assert fault.robot == ("r1" if target.startswith("r1") else "")
        else:
            with pytest.raises(ConfigError, match=r"lab.toml: fault\[0\]\.target: got "):
                lab(row(kind, target=target))


def test_a_fault_ends_at_a_time_after_a_duration_or_never() -> None:
    faults = lab(row("freeze", at=2, until=5), row("freeze", at=2, duration=5), row("freeze", at=2)).faults
    assert [fault.end for fault in faults] == [5.0, 7.0, math.inf]


def test_faults_of_one_kind_are_equal_by_their_values() -> None:
    assert lab(row("delay")).faults == (DelayFault(target="r1", delay=0.3),)
    assert lab(row("carry")).faults != (CarryFault(target="r1", duration=2.0),)


WRONG: list[tuple[dict[str, Any], str]] = [
    ({"target": "r1"}, "fault[0].kind: got nothing, expected one of 'delay', "),
    (row("delay") | {"kind": "dealy"}, "fault[0].kind: got 'dealy' (text), expected one of "),
    (row("delay", delay=-1), "fault[0].delay: got -1 (integer), expected a number above 0 and at most 10 [s]"),
    (row("loss", fraction=1.5), "fault[0].fraction: got 1.5 (number), expected a number above 0 and at most 1"),
    (row("freeze", target="r9/agent"), "fault[0].target: got 'r9/agent' (text), expected one of 'r1/agent', "),
    (row("freeze", target="r1/agnet"), "Did you mean 'r1/agent'?"),
    (row("freeze", until=3, duration=2), "fault[0].duration: got until as well, expected only one of the two"),
    (row("freeze", at=3, until=3), "fault[0].until: got 3, expected a time after at = 3 [s]"),
    (row("freeze", at=-1), "fault[0].at: got -1 (integer), expected a number at least 0 [s]"),
    (row("freeze", delay=1), "fault[0].delay: got an unknown key, expected one of target, at, until, duration"),
    ({"kind": "carry", "target": "r1"}, "fault[0].duration: got nothing, expected how long it is carried [s]"),
    ({"kind": "delay", "target": "r1"}, "fault[0].delay: got nothing, expected a number"),
]


@pytest.mark.parametrize(("given", "said"), WRONG, ids=[said[:60] for _, said in WRONG])
def test_a_wrong_fault_is_named(given: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError) as error:
        lab(given)
    assert said in str(error.value)


@pytest.mark.parametrize("rows", ["freeze", {"kind": "freeze"}, [3]])
def test_what_is_no_list_of_tables_is_refused(rows: object) -> None:
    with pytest.raises(ConfigError, match=r"lab.toml: fault"):
        parse_scenario({"fault": rows}, "lab.toml", name="lab")


@pytest.mark.parametrize("kind", kinds_of(Fault), ids=lambda kind: kind.__name__)
def test_every_number_of_a_fault_is_documented(kind: type[Section]) -> None:
    documented = "\n".join(parent.__doc__ or "" for parent in kind.__mro__)
    missing = [name for name in kind.__struct_fields__ if f"{name}:" not in documented]
    assert not missing


PAGE = (Path(__file__).parents[2] / "docs" / "faults.md").read_text(encoding="utf-8")


def test_the_examples_of_the_page_are_right() -> None:
    examples = re.findall(r"^```toml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    parsed = [parse_scenario({"robots": 2, **tomllib.loads(text)}, "example.toml", name="it") for text in examples]
    assert [len(scenario.faults) for scenario in parsed] == [3, 3]


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_is_on_the_page_with_its_numbers(kind: str) -> None:
    line = next(line for line in PAGE.splitlines() if line.startswith(f"| `{kind}` |"))
    own = set(KINDS[kind].__struct_fields__) - {"target", "at", "until", "duration", "direction"}
    assert {name for name in own if f"`{name}`" not in line} == set()


@pytest.mark.parametrize("at", [20.0, 31.0])
def test_one_that_begins_when_the_run_is_over_is_refused(at: float) -> None:
    table = {"robots": 2, "duration": 20.0, "fault": [{"kind": "crash", "target": "router", "at": at}]}
    with pytest.raises(ConfigError, match=rf"fault\[0\].at: got {at:g} s, expected a time before the end of the run"):
        parse_scenario(table, "lab.toml", name="lab")
    assert parse_scenario({**table, "duration": 32.0}, "lab.toml", name="lab").faults
