"""The clock that ages are counted by: it goes on through suspensions, and no step of the wall clock reaches it."""

from __future__ import annotations

import time

import pytest

from muro_zenoh.runtime import clock as module
from muro_zenoh.runtime.clock import SystemClock

WALL = 1.7e9


class Machine:
    """The clocks of a machine, moved by hand.

    Attributes:
        wall: result of ``time.time`` [s].
        steady: result of the monotonic clock [s].
        asked: the monotonic clocks that were read.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.wall, self.steady = WALL, 50.0
        self.asked: set[int] = set()
        monkeypatch.setattr(time, "time", lambda: self.wall)
        monkeypatch.setattr(time, "clock_gettime", self._gettime)

    def _gettime(self, which: int) -> float:
        self.asked.add(which)
        return self.steady

    def passes(self, seconds: float) -> None:
        """Time passes for both."""
        self.wall += seconds
        self.steady += seconds


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> Machine:
    return Machine(monkeypatch)


def test_it_returns_the_time_since_1970(machine: Machine) -> None:
    clock = SystemClock()
    assert clock.now() == WALL
    machine.passes(0.25)
    assert clock.now() == pytest.approx(WALL + 0.25, abs=1e-6)


@pytest.mark.parametrize("step", [-3600.0, -1.0, -0.001, 0.001, 1.0, 86400.0])
def test_a_step_of_the_wall_clock_does_not_matter(machine: Machine, step: float) -> None:
    clock = SystemClock()
    machine.passes(1.0)
    machine.wall += step  # by NTP, or by hand
    assert clock.now() == pytest.approx(WALL + 1.0, abs=1e-6)
    machine.passes(1.0)
    assert clock.now() == pytest.approx(WALL + 2.0, abs=1e-6)


def test_it_uses_the_clock_that_includes_suspension(machine: Machine) -> None:
    clock = SystemClock()
    clock.now()
    assert machine.asked == {getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)}
    assert next(iter(machine.asked)) == module._CLOCK


def test_it_never_goes_back() -> None:
    clock = SystemClock()
    times = [clock.now() for _ in range(10_000)]
    assert times == sorted(times)
    assert times[-1] > times[0]
    assert times[0] == pytest.approx(time.time(), abs=60.0)
