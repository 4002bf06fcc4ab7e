"""Goals through real processes: a list from the scenario file, and an operator's with ``muro goal``."""

from __future__ import annotations

import json
import math
import time
from pathlib import Path

import numpy as np
import pytest

from muro_zenoh.geometry import Bounds
from muro_zenoh.simulation.starts import random_starts
from tests.integration.test_run import endpoint, run
from tests.support.process import muro
from tests.support.waiting import seconds

pytestmark = pytest.mark.slow

SEED = 7


def ahead(start: np.ndarray, way: float) -> tuple[float, float]:
    """The position at a distance ahead of a start [m, world]."""
    x, y, theta = start.tolist()
    return round(x + way * math.cos(theta), 3), round(y + way * math.sin(theta), 3)


def arrives(there: list[str], x: float, y: float) -> bool:
    """Whether r2 reaches a position, by the simulator's truth."""
    end = time.monotonic() + seconds(15)
    while time.monotonic() < end:
        truth = json.loads(muro("topic", "echo", "truth/r2", "--count", "1", *there).stdout.partition(" ")[2])
        if math.hypot(truth["x"] - x, truth["y"] - y) < 0.05:
            return True
    return False


def test_goals_of_a_list_are_reached_and_an_operator_s_are_answered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    first, second = random_starts(np.random.default_rng(SEED), 2, Bounds(-2.1, 2.1, -1.5, 1.5), np.full(2, 0.177))
    near, far = ahead(first, 0.3), ahead(first, 0.7)
    theta = round(first[2].item(), 4)
    Path("goals.toml").write_text(
        f"""
        robots = 2
        duration = 25.0
        [camera.north]
        jpeg_quality = 0
        [behaviour]
        name = "dubins"
        turning_radius = 0.2
        v_min = 0.12
        pause = 0.6
        [goals]
        r1 = [[{near[0]}, {near[1]}], [{far[0]}, {far[1]}, {theta}]]
        [checks]
        goals_missed = 0
        goal_distance = 0.05
        goal_heading = 0.1745
        tracking_error_p95 = 0.03
        command_ratio = 1.0
        """
    )
    x, y = ahead(second, 0.4)
    with run("goals.toml", "--seed", str(SEED), "--report", "r.json") as process:
        process.line("all processes ready")
        there = ["--connect", endpoint()]
        # One that has just started may have no pose yet, or say that it does not drive yet.
        end = time.monotonic() + seconds(5)
        while not (order := muro("goal", "r2", str(x), str(y), *there)).stdout.startswith("r2: accepted"):
            assert time.monotonic() < end, order.stdout + order.stderr
        assert order.returncode == 0
        order = muro("goal", "r2", "-5", "0.5", *there)
        assert order.returncode == 1
        assert "r2: refused: goal: got (-5, 0.5), outside the arena" in order.stdout
        order = muro("goal", "r9", "0", "0", *there)
        assert order.returncode == 1
        assert "r9 is not alive; the robots that are: r1, r2" in order.stderr
        # A refused goal has not replaced the one before.
        assert arrives(there, x, y)
        assert muro("set", "behaviour", "hold", "--robot", "r2", *there).returncode == 0
        order = muro("goal", "r2", str(x), str(y), *there)
        assert order.returncode == 1
        assert order.stdout == "r2: refused: the behaviour hold takes no goals\n"
        assert process.wait(40) == 0
    sheet = json.loads(Path("r.json").read_text())
    assert (sheet["goals_asked"], sheet["goals_reached"]) == (2, 2)
    assert sheet["goals"]["r1"][1]["heading_rad"] <= 0.1745
    assert sheet["goals"]["r2"] == []
    assert sheet["tracking_error_m"]["p95"] <= 0.03
