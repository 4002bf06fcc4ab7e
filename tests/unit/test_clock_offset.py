"""What two clocks differ by, from round trips."""

from __future__ import annotations

import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from muro_zenoh.messages import SpeedReference, encode, encoding_of
from muro_zenoh.transport.clock_offset import DRIFT, KnownClocks, OffsetEstimate, RoundTrip
from muro_zenoh.transport.delay import DelayTracker
from tests.unit.test_mailboxes import Box, Latest

times = st.floats(0.0, 2.0)


def trip(at: float, offset: float, there: float, back: float, thinking: float = 0.0) -> RoundTrip:
    """A round trip that begins at a time, to a clock that is so far ahead."""
    return RoundTrip(at, at + there + offset, at + there + thinking + offset, at + there + thinking + back)


@given(offset=st.floats(-1e6, 1e6), there=times, back=times, thinking=times)
def test_the_offset_is_wrong_by_half_of_what_one_way_takes_longer(
    offset: float, there: float, back: float, thinking: float
) -> None:
    measured = trip(1e9, offset, there, back, thinking)
    assert measured.offset == pytest.approx(offset + 0.5 * (there - back), abs=1e-5)
    assert measured.duration == pytest.approx(there + back, abs=1e-5)
    assert measured.is_possible


@given(st.lists(st.tuples(times, times), min_size=1, max_size=40), st.floats(-100e-6, 100e-6))
def test_the_true_offset_is_always_within_the_bound(ways: list[tuple[float, float]], drift: float) -> None:
    estimate, at = OffsetEstimate(), 1e6
    for there, back in ways:
        at += 5.0
        measured = trip(at, 3.0 + drift * (at - 1e6), there, back)
        assert estimate.add(measured) == 0.0  # no clock was set
        now = measured.returned
        assert estimate.best is not None
        assert abs(estimate.best.offset - (3.0 + drift * (now - 1e6))) <= estimate.bound(now) + 1e-6


def test_the_quickest_round_trip_counts_until_drift_makes_a_newer_one_better() -> None:
    estimate = OffsetEstimate()
    estimate.add(trip(100.0, 0.0, 0.001, 0.001))
    estimate.add(trip(101.0, 0.0, 0.2, 0.0))
    assert estimate.best is not None
    assert estimate.best.offset == pytest.approx(0.0, abs=1e-9)
    assert estimate.bound(102.0) == pytest.approx(0.001 + DRIFT * (102.0 - 100.0))
    estimate.add(trip(110.0, 0.0, 0.002, 0.0))  # bounded by 1 ms; the first one by 3 ms now
    assert estimate.best.offset == pytest.approx(0.001)


def test_a_path_that_becomes_slow_during_a_question_does_not_mislead() -> None:
    rng, estimate = random.Random(1), OffsetEstimate()
    estimate.add(trip(100.0, 5.0, 0.0, 0.14))  # the quickest for long, and wrong by 70 ms
    for k in range(1, 17):
        estimate.add(trip(100.0 + k, 5.0, rng.uniform(0.1, 0.15), rng.uniform(0.1, 0.15)))
        if k >= 4:
            assert estimate.offset == pytest.approx(5.0, abs=0.02)


def test_before_the_first_nothing_is_known() -> None:
    assert OffsetEstimate().bound(0.0) == math.inf
    assert OffsetEstimate().best is None


@pytest.mark.parametrize("step", [0.06, 1.0, 3600.0, -0.06, -1.0, -3600.0])
def test_a_clock_that_was_set_is_noticed_with_the_next_answer(step: float) -> None:
    rng, estimate = random.Random(1), OffsetEstimate()
    for k in range(20):
        assert estimate.add(trip(1e6 + k, 5.0, rng.uniform(0.0, 0.02), rng.uniform(0.0, 0.02))) == 0.0
    assert estimate.add(trip(1e6 + 20.0, 5.0 + step, 0.001, 0.002)) == pytest.approx(step, abs=0.02)
    assert estimate.best is not None
    assert estimate.best.offset == pytest.approx(5.0 + step, abs=1e-3)
    assert estimate.steps == 1


def test_a_clock_that_was_set_by_little_is_measured_and_not_counted() -> None:
    estimate = OffsetEstimate()
    for k in range(10):
        estimate.add(trip(1e6 + k, 5.0 + 0.04 * (k >= 5), 1e-4, 1e-4))
    assert estimate.offset == pytest.approx(5.04)
    assert estimate.steps == 0


def test_after_a_clock_was_set_a_slow_answer_counts_more_than_the_quick_ones_before() -> None:
    estimate = OffsetEstimate()
    for k in range(10):
        estimate.add(trip(1e6 + k, 5.0, 1e-4, 1e-4))
    assert estimate.add(trip(1e6 + 10.0, 4.0, 0.05, 0.05)) == pytest.approx(-1.0)
    assert estimate.best is not None
    assert estimate.best.offset == pytest.approx(4.0)


def test_a_way_that_grew_longer_is_no_clock_that_was_set() -> None:
    estimate = OffsetEstimate()
    for k in range(100):
        slow = 0.3 if k >= 10 else 0.0
        assert estimate.add(trip(1e6 + k, 5.0, 0.001, 0.001 + slow)) == 0.0


@pytest.mark.parametrize(
    "impossible",
    [RoundTrip(10.0, 5.0, 4.9, 10.1), RoundTrip(10.0, 5.0, 5.1, 9.9), RoundTrip(10.0, 5.0, 7.0, 10.1)],
    ids=["answered before it came", "back before it was sent", "answered longer than it took"],
)
def test_an_impossible_answer_is_ignored(impossible: RoundTrip) -> None:
    estimate = OffsetEstimate()
    assert estimate.add(impossible) == 0.0
    assert estimate.best is None


# ---- what it is used for


def test_a_clock_that_was_not_measured_and_nobodys_tell_nothing() -> None:
    clocks = KnownClocks()
    clocks.note(0, 5.0, 0.0)
    clocks.note(7, math.nan, 0.0)
    assert (clocks.offset(0, 1.0), clocks.offset(7, 1.0)) == (math.inf, math.inf)


def test_a_measured_clock_stays_known_and_drifts() -> None:
    clocks = KnownClocks()
    clocks.note(7, 5.0, 100.0)
    assert clocks.offset(7, 100.0) == 5.0
    assert clocks.offset(7, 3700.0) == pytest.approx(5.0 + 0.72)


def test_ever_new_clocks_fill_no_memory() -> None:
    clocks = KnownClocks()
    for epoch in range(1, 10_000):
        clocks.note(epoch, 1.0, 0.0)
    assert len(clocks._behind) == 256
    assert clocks.offset(9_999, 0.0) == 1.0


@given(st.lists(st.tuples(times, st.floats(-5.0, 5.0)), min_size=1, max_size=40))
def test_no_answer_makes_a_message_younger_than_without_it(messages: list[tuple[float, float]]) -> None:
    """Whatever the base station, or who stands in for it, says of its clock."""
    believing, alone = DelayTracker(), DelayTracker()
    for k, (late, measured) in enumerate(messages):
        stamp = 1e6 + 0.05 * k
        ours = believing.observe(1, stamp, stamp + 2.0 + late, measured)
        theirs = alone.observe(1, stamp, stamp + 2.0 + late)
        assert (ours < 0.0) == (theirs < 0.0)
        assert ours >= theirs
        assert believing.least == alone.least


async def test_a_mailbox_adds_the_delay_that_all_messages_have_had() -> None:
    box = Box(Latest)
    box.clocks.note(3, 8.0, box.clock.now())  # the writer's clock is 8 s behind ours
    for _ in range(20):
        box.clock.advance(0.05)
        box.file("r1", 0.1, stamp=box.clock.now() - 8.3)
    received = box.inbox.get("r1")
    now = box.clock.now()
    assert received.delay == pytest.approx(0.3, abs=1e-3)
    assert received.age(now) == pytest.approx(0.3, abs=1e-3)
    assert received.captured() == pytest.approx(now - 0.3, abs=1e-3)
    other = encode(SpeedReference(speed=0.1, stamp=now - 8.3, epoch=4))  # of a writer that was not measured
    box.inbox.file("muro/velocity/r2", other, encoding_of(SpeedReference))
    assert box.inbox.get("r2").delay == 0.0


@pytest.mark.parametrize("step", [1.9, -1.9])
async def test_after_our_own_clock_was_set_messages_are_as_late_as_they_are(step: float) -> None:
    box = Box(Latest)
    box.clocks.note(3, 8.0, box.clock.now())  # the writer's clock is 8 s behind ours
    delays = []
    for k in range(80):
        box.clock.advance(0.05)
        if k == 40:
            box.clock.advance(step)
        if k == 60:  # ... which is measured a second later
            box.clocks.note(3, 8.0 + step, box.clock.now(), steps=1)
        late = 0.3 if k >= 70 else 0.0
        box.file("r1", 0.1, stamp=box.clock.now() - 8.0 - step * (k >= 40) - late)
        delays.append(box.inbox.get("r1").delay)
    assert delays[:40] == pytest.approx([0.0] * 40, abs=1e-3)
    if step > 0:
        assert delays[40:60] == pytest.approx([1.9] * 20, abs=1e-2), "nobody knows yet"
    assert delays[60:70] == pytest.approx([0.0] * 10, abs=1e-3)
    assert delays[70:] == pytest.approx([0.3] * 10, abs=1e-3)


async def test_a_writer_that_takes_another_ones_place_is_judged_by_its_clock_until_its_own_is_known() -> None:
    box = Box(Latest)
    box.clocks.note(3, 8.0, box.clock.now())  # the writer's clock is 8 s behind ours
    box.file("r1", 0.1, stamp=box.clock.now() - 8.0, epoch=3)
    assert box.inbox.get("r1").delay == pytest.approx(0.0, abs=1e-3)
    delays = []
    for _ in range(120):  # restarted, on a path that takes 0.9 s now, and never measured
        box.clock.advance(0.05)
        box.file("r1", 0.1, stamp=box.clock.now() - 8.9, epoch=4)
        delays.append(box.inbox.get("r1").delay)
    assert delays[:99] == pytest.approx([0.9] * 99, abs=2e-3)
    assert delays[-1] == 0.0  # after 5 s its clock may be another one
    box.clocks.note(4, 8.0, box.clock.now())
    box.file("r1", 0.1, stamp=box.clock.now() - 8.9, epoch=4)
    received = box.inbox.get("r1")
    assert received.delay == pytest.approx(0.9, abs=2e-3)
    assert received.captured() == pytest.approx(box.clock.now() - 0.9, abs=2e-3)
