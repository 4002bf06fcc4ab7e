"""A process on its own reports within a few seconds what it waits for: once in its log, and in its health."""

from __future__ import annotations

import asyncio
import logging

import pytest

from muro_zenoh.config import Scenario, parse_scenario
from muro_zenoh.runtime.virtual_time import run_virtually
from tests.support.memory_lab import Main, agent, basestation, memory_lab, simulator

CAMERA = {"rate": 10}
LAB = parse_scenario({"robots": 2, "camera": {"north": CAMERA}}, "lab.toml", name="lab")
NO_CAMERA = parse_scenario({"robots": 1, "behaviour": {"name": "circle"}}, "lab.toml", name="lab")
BLIND = parse_scenario(  # its camera looks at another floor than the one where the robots are
    {
        "robots": 1,
        "camera": {
            "north": {
                **CAMERA,
                "pixels": [[0, 0], [1279, 0], [1279, 719], [0, 719]],
                "metres": [[50, 53], [54, 53], [54, 50], [50, 50]],
            }
        },
        "behaviour": {"name": "circle"},
    },
    "lab.toml",
    name="lab",
)


@pytest.mark.parametrize(
    ("main", "name", "line", "reasons"),
    [
        (
            basestation,
            "basestation",
            "waiting: ",
            ("no agent of r1", "no agent of r2", "no frames from camera north yet"),
        ),
        (simulator, "simulator", "waiting: ", ("no commands for r1 r2: waiting for their agents",)),
        (
            agent("r1"),
            "r1",
            "stationary: ",
            (
                "no stop state received yet: waiting for the base station",
                "no pose yet: waiting for a camera to see this robot",
                "no positions of all robots yet: waiting for the base station",
                "no behaviour yet",
            ),
        ),
    ],
)
def test_a_process_alone_says_what_it_waits_for(
    main: Main, name: str, line: str, reasons: tuple[str, ...], caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)

    async def run() -> None:
        async with memory_lab() as there:
            there.start(LAB, main)
            await asyncio.sleep(5.0)
            assert there.reasons(name) == reasons
            await asyncio.sleep(30.0)
            assert there.reasons(name) == reasons

    run_virtually(run())
    assert [message for message in caplog.messages if message.startswith(line)] == [line + "; ".join(reasons)]


@pytest.mark.parametrize(
    ("scenario", "missing"),
    [
        (NO_CAMERA, "no camera in the settings: no robot drives without poses"),
        (BLIND, "no camera has seen r1 yet"),
    ],
)
def test_robots_that_no_camera_sees(scenario: Scenario, missing: str, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)

    async def run() -> None:
        async with memory_lab() as there:
            there.start(scenario, simulator, basestation, agent("r1"))
            await asyncio.sleep(6.0)
            assert there.reasons("basestation") == (missing,)
            assert there.reasons("r1") == ("no pose yet: waiting for a camera to see this robot",)
            assert there.reasons("simulator") == ()  # zero is a command, too

    run_virtually(run())
    assert caplog.messages.count(f"waiting: {missing}") == 1
    assert caplog.messages.count("stationary: no pose yet: waiting for a camera to see this robot") == 1


def test_a_missing_process_is_reported_when_it_ends_and_when_it_is_back(caplog: pytest.LogCaptureFixture) -> None:
    """Each episode has a line for its beginning and one for its end."""
    caplog.set_level(logging.INFO)

    async def run() -> None:
        async with memory_lab() as there:
            there.start(LAB, simulator)
            await asyncio.sleep(5.0)
            there.start(LAB, basestation)
            await asyncio.sleep(5.0)
            there.start(LAB, agent("r1"), agent("r2"))
            await asyncio.sleep(5.0)
            assert (there.reasons("simulator"), there.reasons("basestation")) == ((), ())

    run_virtually(run())
    said = [message for message in caplog.messages if message.startswith(("waiting", "every", "nothing"))]
    assert said[:2] == [
        "waiting: no commands for r1 r2: waiting for their agents",
        "waiting: no agent of r1; no agent of r2",
    ]
    assert sorted(said[2:]) == ["every robot receives commands", "nothing is missing now"]
