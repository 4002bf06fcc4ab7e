"""What a process waits for is logged once per episode, and only what lasts."""

from __future__ import annotations

import logging

import pytest

from muro_zenoh.runtime.waiting import WaitingLog, without_numbers


@pytest.fixture
def waiting(caplog: pytest.LogCaptureFixture) -> WaitingLog:
    caplog.set_level(logging.INFO)
    return WaitingLog(logging.getLogger("lab"), "waiting", "all is there")


def test_a_long_wait_is_logged_once(waiting: WaitingLog, caplog: pytest.LogCaptureFixture) -> None:
    for k in range(600):
        waiting.note(100.0 + k / 10, [f"no frames for {k / 10:.1f} s", "no agent of r1"])
        assert len(caplog.messages) == (k >= 30)
    assert caplog.messages == ["waiting: no frames for 3.0 s; no agent of r1"]


def test_a_short_wait_is_not_logged(waiting: WaitingLog, caplog: pytest.LogCaptureFixture) -> None:
    for k in range(100):
        waiting.note(100.0 + k, [] if k % 3 == 2 else ["no agent of r1"])
        waiting.note(100.9 + k, [] if k % 3 == 2 else ["no agent of r1"])
    assert caplog.messages == []


def test_another_reason_is_another_episode_and_the_end_is_logged_once(
    waiting: WaitingLog, caplog: pytest.LogCaptureFixture
) -> None:
    for t, reasons in [(0, ["a"]), (3, ["a"]), (4, ["a", "b"]), (5, ["a", "b"]), (7, ["a", "b"]), (8, []), (99, [])]:
        waiting.note(t, reasons)
    assert caplog.messages == ["waiting: a", "waiting: a; b", "all is there"]
    caplog.clear()
    for t, reasons in [(100, ["a"]), (103, ["a"]), (104, ["b"]), (105, []), (106, ["a"]), (108.9, ["a"]), (109, ["a"])]:
        waiting.note(t, reasons)
    assert caplog.messages == ["waiting: a", "all is there", "waiting: a"]


def test_a_number_in_a_name_tells_robots_apart() -> None:
    assert without_numbers(["no pose for 0.5 s"]) == without_numbers(["no pose for 11.2 s"])
    assert without_numbers(["no agent of r1"]) != without_numbers(["no agent of r2"])
