"""How late a message is."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from muro_zenoh.messages import VelocityCommand
from muro_zenoh.transport import Received
from muro_zenoh.transport.delay import DelayTracker


def test_a_steady_writer_is_never_late_whatever_its_clock_says() -> None:
    tracker = DelayTracker()
    for i in range(5000):
        assert tracker.observe(1, 7000.0 + 0.02 * i, 0.02 * i) == pytest.approx(0.0, abs=1e-9)
    assert tracker.least == pytest.approx(-7000.0)


def test_before_the_first_message_nothing_is_known() -> None:
    assert DelayTracker().least == math.inf


def test_a_backlog_is_late_by_what_it_waited() -> None:
    tracker = DelayTracker()
    tracker.observe(1, 0.0, 10.0)
    assert [tracker.observe(1, t, 15.0) for t in (1.0, 2.0, 3.0, 4.0)] == pytest.approx([4.0, 3.0, 2.0, 1.0])
    assert tracker.observe(1, 5.0, 15.0) == pytest.approx(0.0)


def test_silence_does_not_make_it_forget() -> None:
    tracker = DelayTracker()
    tracker.observe(1, 0.0, 0.0)
    assert tracker.observe(1, 1.0, 600.0) == pytest.approx(599.0)


def test_a_path_that_grew_longer_stays_late_and_never_becomes_the_measure() -> None:
    # A radio link whose buffers have filled: every pose two seconds old, for ten minutes.
    tracker = DelayTracker()
    delays = [tracker.observe(1, 0.1 * i, 0.1 * i + (0.0 if i < 100 else 2.0)) for i in range(6000)]
    assert delays[100] == pytest.approx(2.0)
    assert delays[-1] > 1.3
    assert min(delays[100:]) == delays[-1]  # it gives way no faster than clocks drift


def test_a_drifting_clock_is_followed() -> None:
    tracker = DelayTracker()
    slow = 1.0 - 50e-6  # the writer loses 50 us a second
    delays = [tracker.observe(1, 0.1 * i * slow, 0.1 * i) for i in range(36000)]
    assert max(delays) < 0.004


def test_a_restarted_writer_starts_from_scratch() -> None:
    tracker = DelayTracker()
    tracker.observe(1, 100.0, 0.0)
    assert tracker.observe(2, 5.0, 1.0) == 0.0
    assert tracker.least == pytest.approx(-4.0)


@pytest.mark.parametrize(("at", "extra"), [(30.0, 1.0), (60.05, 1.0), (60.2, 0.97), (90.1, 0.97), (90.3, 0.94)])
def test_the_least_rises_by_30_ms_for_each_half_minute_that_is_over(at: float, extra: float) -> None:
    """From the first second on the path takes one second longer."""
    tracker = DelayTracker()
    tracker.observe(1, 0.0, 0.0)
    arrivals = [t for t in (1.0, 30.0, 30.1, 60.05, 60.2, 90.1, 90.3) if t <= at]
    assert [tracker.observe(1, t - 1.0, t) for t in arrivals][-1] == pytest.approx(extra)


def test_of_many_writers_the_four_heard_last_are_remembered() -> None:
    tracker = DelayTracker()
    for epoch in (1, 2, 3, 4, 1, 5):  # the one that goes is 2
        tracker.observe(epoch, 0.0, 0.0)
    assert tracker.observe(1, 0.0, 1.0) == pytest.approx(1.0)
    assert tracker.observe(2, 0.0, 1.0) == 0.0


def test_writers_by_turns_are_kept_apart() -> None:
    tracker = DelayTracker()
    offsets = {1: 0.0, 2: 900.0, 3: -50.0, 4: 2.0}
    for epoch, offset in offsets.items():
        tracker.observe(epoch, 10.0, 10.0 + offset)
    for epoch, offset in offsets.items():
        assert tracker.observe(epoch, 11.0, 11.7 + offset) == pytest.approx(0.7)
        assert tracker.least == pytest.approx(offset)


def test_ever_new_writers_fill_no_memory() -> None:
    tracker = DelayTracker()
    for epoch in range(10_000):
        tracker.observe(epoch, 0.0, 1.0)
    assert len(tracker._writers) == 4


@given(st.lists(st.tuples(st.integers(0, 6), st.floats(0.0, 100.0), st.floats(0.0, 1000.0)), max_size=60))
def test_a_delay_is_never_negative_and_never_beyond_the_least(samples: list[tuple[int, float, float]]) -> None:
    tracker = DelayTracker()
    arrival = 0.0
    for epoch, stamp, later in samples:
        arrival += later
        delay = tracker.observe(epoch, stamp, arrival)
        assert delay >= 0.0
        assert tracker.least == pytest.approx(arrival - stamp - delay)


# ---- a message that came


def test_age_is_the_time_since_the_arrival_and_the_extra_delay() -> None:
    received = Received("r1", VelocityCommand(v=0.0, omega=0.0), arrival=100.0, delay=0.25, least=-7.0)
    assert received.age(100.5) == pytest.approx(0.75)


def test_the_time_of_capture_is_the_stamp_by_our_clock_less_the_latency_of_the_path() -> None:
    """The writer's clock is 7 s ahead of ours, and its quickest message took 20 ms."""
    received = Received("r1", VelocityCommand(v=0.0, omega=0.0, stamp=107.0), arrival=100.5, delay=0.48, least=-6.98)
    assert received.captured() == pytest.approx(100.02)
    assert received.captured(0.02) == pytest.approx(100.0)
