"""Which wheels there are, and how a robot's are found."""

from __future__ import annotations

from pathlib import Path

import pytest

from agents.base import table
from agents.base.run import run_base_process
from muro_zenoh.config import Scenario, parse_scenario
from muro_zenoh.errors import ConfigError
from muro_zenoh.supervision.preflight import check_can_run
from tests.support.clock import ManualClock


def lab(base: str) -> Scenario:
    return parse_scenario({"robot": {"r1": {"tag": 0, "base": base}}, "camera": {"north": {}}}, "lab.toml", name="lab")


@pytest.mark.parametrize("name", table.names())
def test_each_file_of_the_folder_is_a_driver_of_that_name(name: str) -> None:
    assert table.find(name).__module__ == f"agents.base.{name}"
    assert (Path(table.__file__).parent / f"{name}.py").is_file()


def test_simulated_wheels_are_there_and_turn() -> None:
    clock = ManualClock()
    wheels = table.find("simulated")(lab("simulated").robot["r1"], clock)
    wheels.command(0.2, 0.0)
    assert wheels.read().v == 0.0
    for _ in range(10):
        clock.advance(0.1)
        reading = wheels.read()
    assert reading.v == pytest.approx(0.2, abs=0.001)
    assert reading.y == 0.0


async def test_unknown_wheels_are_refused_with_the_known_ones() -> None:
    said = r"robot\.r1\.base: got 'hovercraft', expected one of simulated: each is a file in agents/base"
    with pytest.raises(ConfigError, match=f"^lab: {said}"):
        await run_base_process(lab("hovercraft"), "r1")
    with pytest.raises(ConfigError, match=rf"^lab\.toml: {said}"):
        check_can_run(lab("hovercraft"), "lab.toml")


@pytest.mark.parametrize("helper", ["base", "obedience", "run", "table", "wheels"])
def test_helper_modules_are_not_wheels(helper: str) -> None:
    with pytest.raises(ConfigError, match=helper):
        table.check_base(lab(helper), "r1", "lab.toml")
