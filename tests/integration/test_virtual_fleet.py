"""A fleet in memory with faults: each fault has its effect, there is none without it, and a seed repeats the run."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from muro_zenoh.checking.run import run_fleet
from muro_zenoh.config import Scenario, parse_scenario
from tests.support.waiting import seconds

ROOT = Path(__file__).parents[2]


def lab(*faults: dict[str, Any], robots: int = 2, duration: float = 6.0, behaviour: str = "circle") -> Scenario:
    table = {"robots": robots, "duration": duration, "behaviour": {"name": behaviour}, "fault": list(faults)}
    return parse_scenario(table, "lab.toml", name="lab")


FAULTS: list[dict[str, Any]] = [
    {"kind": "delay", "target": "r1", "delay": 0.1},
    {"kind": "jitter", "target": "basestation", "jitter": 0.05},
    {"kind": "loss", "target": "r2/agent", "fraction": 0.2},
    {"kind": "duplicate", "target": "router", "fraction": 0.2},
    {"kind": "reorder", "target": "r1", "fraction": 0.2},
    {"kind": "partition", "target": "r1"},
    {"kind": "stall", "target": "camera"},
    {"kind": "crash", "target": "r1/agent"},
    {"kind": "restart", "target": "basestation"},
    {"kind": "freeze", "target": "r2/base"},
    {"kind": "camera_dropout", "target": "r2"},
    {"kind": "clock_offset", "target": "r1", "offset": 3.0},
    {"kind": "clock_step", "target": "basestation", "step": -1.0},
    {"kind": "halt", "target": "r1"},
    {"kind": "carry", "target": "r2", "x": 0.3},
    {"kind": "lie", "target": "r1", "x": 0.4},
    {"kind": "foreign_driver", "target": "r1"},
    {"kind": "foreign_driver", "target": "r1", "by": "wheels"},
]


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: f"{fault['kind']} {fault['target']}")
def test_every_fault_begins_does_something_and_ends(fault: dict[str, Any]) -> None:
    [effect] = run_fleet(lab({**fault, "at": 2.0, "until": 3.0}), 1).effects
    assert (effect.begun, effect.ended) == pytest.approx((2.0, 3.0))
    assert effect.occurred, str(effect)


_DIGEST = """
from muro_zenoh.checking.run import run_fleet
from tests.integration.test_virtual_fleet import FAULTS, lab
faults = [{**fault, "at": 1.0 + 0.2 * number, "duration": 0.5} for number, fault in enumerate(FAULTS)]
print(run_fleet(lab(*faults, behaviour="pursuit"), 3).digest())
"""


def test_the_same_seed_gives_the_same_bits_in_another_process() -> None:
    digests = [
        subprocess.run(
            [sys.executable, "-c", _DIGEST],
            cwd=ROOT,
            env={**os.environ, "PYTHONHASHSEED": number},
            capture_output=True,
            text=True,
            timeout=seconds(60),
            check=True,
        ).stdout
        for number in ("1", "2")
    ]
    assert digests[0] == digests[1]
