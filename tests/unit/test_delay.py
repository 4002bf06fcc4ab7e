"""How late a message is."""

from __future__ import annotations

import math
import random
from collections.abc import Callable

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


def offsets_of(offset: Callable[[float], float], period: float, hours: float) -> list[float]:
    """The delays of a writer that sends every ``period``, by the offset (arrival - stamp) of each message. They are
    observed in the order of their arrival and returned in the order of their stamps."""
    tracker = DelayTracker()
    stamps = [period * k for k in range(round(3600.0 * hours / period))]
    arriving = sorted((stamp + offset(stamp), stamp) for stamp in stamps)
    delays = {stamp: tracker.observe(1, stamp, arrival) for arrival, stamp in arriving}
    return [delays[stamp] for stamp in stamps]


def onset(t: float) -> float:
    """0 in the first minute, 1 from then on."""
    return float(t >= 60.0)


@pytest.mark.parametrize("late", [0.05, 0.45, 0.5, 2.0])
def test_a_path_that_grew_longer_stays_late_for_hours_and_never_becomes_the_measure(late: float) -> None:
    # A radio link whose buffers have filled: every pose two seconds old.
    delays = offsets_of(lambda t: late * onset(t), period=0.1, hours=4)
    assert delays[600:] == pytest.approx([late] * len(delays[600:]), abs=1e-6)


def test_lateness_that_varies_stays_late_for_hours() -> None:
    rng = random.Random(1)
    delays = offsets_of(lambda t: onset(t) * (0.45 + rng.expovariate(200.0)), period=0.1, hours=4)
    assert min(delays[600:]) >= 0.45 - 1e-6


def test_every_fourth_message_late_is_late_by_that_for_hours() -> None:
    rng = random.Random(1)
    delays = offsets_of(
        lambda t: onset(t) * (0.35 if round(t / 0.05) % 4 == 0 else rng.uniform(0.0, 0.05)), period=0.05, hours=2
    )
    assert min(delays[1200::4]) >= 0.35 - 1e-6


@pytest.mark.parametrize("drift", [100e-6, -100e-6, 20e-6])
@pytest.mark.parametrize("jitter", [0.0, 0.003])
def test_clocks_that_drift_for_a_day_are_followed(drift: float, jitter: float) -> None:
    rng = random.Random(1)
    delays = offsets_of(lambda t: drift * t + jitter * rng.expovariate(1.0), period=0.5, hours=24)
    assert min(delays) >= 0.0
    assert max(delays) < 0.01 + 15 * jitter
    assert sum(delays) / len(delays) < 0.007 + jitter  # the window's own minute of drift


def test_drift_that_went_on_during_a_few_late_minutes_is_caught_up_with() -> None:
    delays = offsets_of(lambda t: 100e-6 * t + (0.5 if 600.0 <= t < 780.0 else 0.0), period=0.1, hours=1)
    assert min(delays[6000:7800]) > 0.49
    assert max(delays[7800:]) < 0.03
    assert max(delays[20000:]) < 0.01


@pytest.mark.parametrize("silence", [120.0, 900.0])
def test_clocks_that_drifted_apart_during_a_silence_are_followed(silence: float) -> None:
    tracker = DelayTracker()
    times = [0.1 * k for k in range(6000)]
    times += [times[-1] + silence + 0.1 * k for k in range(1000)]
    delays = [tracker.observe(1, t * (1.0 - 100e-6), t) for t in times]
    assert delays[6000] > 100e-6 * silence
    assert max(delays[6700:]) < 0.012


@pytest.mark.parametrize("late", [0.14, 0.45, 2.0])
def test_a_path_that_is_slow_after_hours_of_silence_is_late(late: float) -> None:
    tracker = DelayTracker()
    for k in range(6000):
        tracker.observe(1, 0.1 * k, 0.1 * k)
    delays = [tracker.observe(1, 20000.0 + 0.1 * k, 20000.0 + late + 0.1 * k) for k in range(12000)]
    assert min(delays) == pytest.approx(late)


@pytest.mark.parametrize(("slope", "crept"), [(1e-3, 0.04), (1e-2, 0.01), (300e-6, 0.07)])
def test_lateness_that_grows_slowly_creeps_in_no_faster_than_clocks_drift(slope: float, crept: float) -> None:
    delays = offsets_of(lambda t: min(slope * max(t - 60.0, 0.0), 2.0), period=0.1, hours=2)
    assert delays[-1] > 2.0 - crept
    for k in range(600, len(delays), 100):
        late = min(slope * (0.1 * k - 60.0), 2.0)
        assert late - delays[k] <= 200e-6 * (0.1 * k)


def test_a_restarted_writer_starts_from_scratch() -> None:
    tracker = DelayTracker()
    tracker.observe(1, 100.0, 0.0)
    assert tracker.observe(2, 5.0, 1.0) == 0.0
    assert tracker.least == pytest.approx(-4.0)


@pytest.mark.parametrize(
    ("at", "extra"), [(30.0, 0.02), (60.0, 0.02), (60.2, 0.01398), (90.2, 0.01398), (90.3, 0.00796), (180.0, 0.0)]
)
def test_the_least_rises_by_6_ms_for_each_half_minute_that_is_over(at: float, extra: float) -> None:
    """From the first second on the path takes 20 ms longer, which may be drift."""
    tracker = DelayTracker()
    arrivals = [0.1 * k for k in range(2000) if 0.1 * k <= at + 1e-9]
    delays = [tracker.observe(1, t - (0.02 if t >= 1.0 else 0.0), t) for t in arrivals]
    assert delays[-1] == pytest.approx(extra, abs=1e-4)


@pytest.mark.parametrize(("late", "after_an_hour"), [(0.033, 0.0), (0.039, 0.039)])
def test_a_path_that_grew_by_up_to_30_ms_and_the_drift_is_taken_in(late: float, after_an_hour: float) -> None:
    """The drift of half a minute is 6 ms, so the limit is at 36 ms."""
    delays = offsets_of(lambda t: late if t >= 120.0 else 0.0, period=0.1, hours=1)
    assert delays[-1] == pytest.approx(after_an_hour, abs=1e-6)


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


def test_lateness_that_begins_right_after_the_measure_was_confirmed_does_not_raise_it() -> None:
    tracker = DelayTracker()
    delays = [tracker.observe(1, 0.05 * i - (0.0 if i < 5 else 2.0), 0.05 * i) for i in range(100)]
    assert delays[5:] == pytest.approx([2.0] * 95)


def confirmed(*epochs: int) -> DelayTracker:
    """A tracker that knows writers well, whose clocks are 8 s behind ours; the last one was heard last, at 64 s."""
    tracker = DelayTracker()
    for epoch in epochs:
        for i in range(9):
            tracker.observe(epoch, 48.0 + i, 56.0 + i)
    return tracker


@pytest.mark.parametrize(("ahead", "delay"), [(0.25, 0.0), (0.5, 0.0), (0.75, -0.75), (40.0, -40.0)])
def test_a_stamp_more_than_half_a_second_ahead_is_reported_by_how_much(ahead: float, delay: float) -> None:
    tracker = confirmed(1)
    assert tracker.observe(1, 57.0 + ahead, 65.0) == delay
    assert tracker.least == 8.0 - ahead


def test_a_fifth_writer_displaces_the_one_heard_least_recently_where_all_are_well_known() -> None:
    tracker = confirmed(1, 2, 3, 4, 5)
    assert tracker.observe(2, 56.0, 65.0) == 1.0  # it is remembered
    assert tracker.observe(1, 56.0, 65.0) == 0.0  # it is not


def learned_from(tracker: DelayTracker, arrival: float) -> float:
    """By how much a stamp 0.3 s ahead makes the next message late: 0 where the measure is confirmed already."""
    tracker.observe(1, arrival + 0.3, arrival)
    return tracker.observe(1, arrival + 0.02, arrival + 0.02)


@pytest.mark.parametrize(("jitter", "confirmed_by_then"), [(0.0, True), (0.09, True), (0.11, False)])
def test_a_measure_is_confirmed_by_five_spans_that_agree_within_a_tenth_of_a_second(
    jitter: float, confirmed_by_then: bool
) -> None:
    tracker = DelayTracker()
    for i in range(10):
        tracker.observe(1, 0.05 * i - jitter * (i % 2), 0.05 * i)
    assert learned_from(tracker, 0.5) == pytest.approx(0.0 if confirmed_by_then else 0.3)


@pytest.mark.parametrize(
    ("period", "messages", "confirmed_by_then"), [(0.045, 6, True), (0.035, 6, False), (0.035, 11, True)]
)
def test_messages_less_than_40_ms_apart_share_a_span(period: float, messages: int, confirmed_by_then: bool) -> None:
    tracker = DelayTracker()
    for i in range(messages):
        tracker.observe(1, period * i, period * i)
    assert learned_from(tracker, period * messages) == pytest.approx(0.0 if confirmed_by_then else 0.3)


# ---- a message that came


def test_age_is_the_time_since_the_arrival_and_the_extra_delay() -> None:
    received = Received("r1", VelocityCommand(v=0.0, omega=0.0), arrival=100.0, delay=0.25, least=-7.0)
    assert received.age(100.5) == pytest.approx(0.75)


def test_the_time_of_capture_is_the_stamp_by_our_clock_less_the_latency_of_the_path() -> None:
    """The writer's clock is 7 s ahead of ours, and its quickest message took 20 ms."""
    received = Received("r1", VelocityCommand(v=0.0, omega=0.0, stamp=107.0), arrival=100.5, delay=0.48, least=-6.98)
    assert received.captured() == pytest.approx(100.02)
    assert received.captured(0.02) == pytest.approx(100.0)


# ---- nothing learned from one message lasts

PERIOD = 0.05


class Writer:
    """A writer at 20 Hz and its reader; the way takes no time, and the clocks differ by ``ahead``."""

    def __init__(self, ahead: float = 0.0, epoch: int = 7) -> None:
        self.tracker = DelayTracker()
        self.ahead = ahead
        self.late = 0.0
        self._epoch = epoch
        self._ticks = 0

    @property
    def now(self) -> float:
        """By the reader's clock."""
        return 1000.0 + PERIOD * self._ticks

    def send(self, times: int = 1) -> list[float]:
        """The delays of so many messages, a period apart."""
        delays = []
        for _ in range(times):
            self._ticks += 1
            delays.append(self.tracker.observe(self._epoch, self.now + self.ahead - self.late, self.now))
        return delays

    def pause(self, time: float) -> None:
        """Nothing is sent for so long [s]."""
        self._ticks += round(time / PERIOD)

    def fall_behind(self, late: float) -> None:
        """The way freezes for so long, and what is sent from then on comes so late, in order [s]."""
        self.pause(late)
        self.late = late

    def forged(self, ahead: float) -> float:
        """A stranger's message in this writer's name, with a stamp this far ahead of its clock."""
        return self.tracker.observe(self._epoch, self.now + self.ahead + ahead, self.now + 1e-3)

    def recovers(self) -> float:
        """How long until its messages are on time again [s]; a minute is for ever."""
        for k in range(1200):
            (delay,) = self.send()
            if 0.0 <= delay < 0.01:
                return (k + 1) * PERIOD
        return math.inf


@pytest.mark.parametrize("ahead", [0.05, 0.2, 0.49, 0.51, 1.0, 40.0, 1e6, 1e11, -0.3, -1.0, -1e9])
@pytest.mark.parametrize("known", [1, 3, 6, 100])
def test_one_wrong_stamp_of_a_known_writer_does_not_outlast_it(known: int, ahead: float) -> None:
    writer = Writer(ahead=-70.0)
    writer.send(known)
    writer.forged(ahead)
    assert writer.recovers() <= 0.5
    assert max(map(abs, writer.send(100))) < 0.01
    assert writer.tracker.least == pytest.approx(70.0)


@pytest.mark.parametrize("ahead", [0.3, 40.0, -5.0])
def test_a_wrong_stamp_that_comes_first_does_not_outlast_its_moment(ahead: float) -> None:
    writer = Writer()
    writer.forged(ahead)
    assert writer.recovers() <= 0.5
    assert max(map(abs, writer.send(100))) < 0.01


def test_a_stamp_far_ahead_is_not_believed_and_a_little_ahead_is_on_time() -> None:
    writer = Writer()
    writer.send(20)
    assert writer.forged(0.51) == pytest.approx(-0.51, abs=2e-3)
    assert writer.tracker.least == pytest.approx(-0.51, abs=2e-3)  # never captured after it arrived
    assert writer.forged(0.49) == 0.0
    assert writer.send(50) == pytest.approx([0.0] * 50, abs=1e-9)


def test_many_wrong_stamps_do_not_walk_the_measure_away() -> None:
    writer = Writer()
    writer.send(20)
    for step in range(1, 200):
        writer.forged(0.005 * step)
        (delay,) = writer.send()
        assert delay == pytest.approx(0.0, abs=1e-6)


def test_wrong_stamps_between_those_of_a_slower_writer_are_not_learned_either() -> None:
    writer = Writer()
    writer.send(20)
    for _ in range(100):
        writer.pause(PERIOD)
        writer.forged(0.3)
        (delay,) = writer.send()
        assert delay == pytest.approx(0.0, abs=1e-6)


def test_a_clock_that_was_set_back_is_followed_only_when_its_messages_agree() -> None:
    # Learned while a backlog drains, the measure would be that of the backlog.
    writer = Writer()
    writer.send(100)
    writer.ahead -= 5.0
    for step in range(12, 0, -1):
        writer.late = 0.2 * step
        assert min(writer.send()) > 4.0
    writer.late = 0.0
    assert writer.recovers() <= 0.5
    assert writer.tracker.least == pytest.approx(5.0)


def test_a_burst_is_one_moment_however_many_messages_it_has() -> None:
    writer = Writer()
    writer.send(20)
    for _ in range(1000):
        assert writer.forged(40.0) < 0.0
    assert writer.send(20) == pytest.approx([0.0] * 20, abs=1e-6)


@pytest.mark.parametrize("step", [0.6, 1.0, 40.0, 3600.0, -0.3, -1.0, -40.0, -3600.0])
@pytest.mark.parametrize("epoch", [0, 7])
def test_a_clock_that_is_set_is_followed_within_half_a_second(epoch: int, step: float) -> None:
    # A camera host restarts with its clock behind; NTP steps the clock of a foreign writer that gives no epoch.
    writer = Writer(epoch=epoch)
    writer.send(100)
    writer.ahead += step
    assert writer.recovers() <= 0.5
    assert writer.send(100) == pytest.approx([0.0] * 100, abs=1e-6)


@pytest.mark.parametrize("late", [0.2, 1.0, 40.0])
def test_after_a_clock_was_set_what_is_late_is_late_again(late: float) -> None:
    writer = Writer()
    writer.send(100)
    writer.ahead -= 5.0
    writer.send(20)
    writer.fall_behind(late)
    assert min(writer.send(400)) > late - 0.07


@pytest.mark.parametrize("known", [1, 3, 6, 100])
def test_lateness_alone_never_becomes_the_measure(known: int) -> None:
    writer = Writer()
    writer.send(known)
    writer.fall_behind(2.0)
    assert min(writer.send(1200)) > 1.9


@pytest.mark.parametrize("back", [0.11, 0.15, 0.2, 1.0, 5.0, 60.0])
@pytest.mark.parametrize("times", [1, 3, 50])
def test_an_old_message_in_a_backlog_does_not_make_it_fresh(times: int, back: float) -> None:
    """One that comes twice, or was overtaken."""
    writer = Writer()
    writer.send(100)
    writer.fall_behind(2.0)
    writer.send(200)
    for _ in range(times):
        writer.forged(-2.0 - back)
        assert writer.send(7) == pytest.approx([2.0] * 7)
    assert writer.send(2000) == pytest.approx([2.0] * 2000)


def test_an_old_message_just_before_a_backlog_does_not_make_it_fresh() -> None:
    writer = Writer()
    writer.send(100)
    writer.forged(-0.4)
    writer.fall_behind(2.0)
    assert writer.send(2000) == pytest.approx([2.0] * 2000)


@pytest.mark.parametrize("ahead", [0.2, 0.5, 1.5])
def test_a_message_that_overtakes_others_in_a_backlog_does_not_make_it_fresh(ahead: float) -> None:
    writer = Writer()
    writer.send(100)
    writer.fall_behind(2.0)
    writer.send(200)
    assert writer.forged(ahead - 2.0) == pytest.approx(2.0 - ahead, abs=2e-3)
    assert writer.send(2000) == pytest.approx([2.0] * 2000)


@pytest.mark.parametrize("step", [0.3, 0.5, 3600.0])
def test_a_clock_that_is_set_back_after_a_backlog_is_followed(step: float) -> None:
    writer = Writer()
    writer.send(100)
    writer.fall_behind(2.0)
    writer.send(200)
    writer.late = 0.0
    writer.send(20)
    writer.ahead -= step
    assert writer.recovers() <= 0.5


def test_replayed_stamps_do_not_make_a_backlog_fresh() -> None:
    writer = Writer()
    writer.send(100)
    for _ in range(100):
        writer.forged(-3.0)
        (delay,) = writer.send()
        assert delay == pytest.approx(0.0, abs=1e-6)
    writer.fall_behind(2.0)
    assert min(writer.send(400)) > 1.9


@pytest.mark.parametrize("ahead", [0.15, 0.45, 40.0])
def test_a_stamp_ahead_does_not_make_a_backlog_fresh(ahead: float) -> None:
    # The true stamps after it lie behind it; that is no clock that was set back.
    writer = Writer()
    writer.send(100)
    writer.forged(ahead)
    writer.fall_behind(2.0)
    assert min(writer.send(400)) > 1.9


def test_a_stranger_who_holds_the_name_for_a_while_is_forgotten_when_its_owner_is_back() -> None:
    writer = Writer()
    writer.send(100)
    for _ in range(20):  # its owner is silent meanwhile
        writer.pause(PERIOD)
        writer.forged(40.0)
    assert writer.recovers() <= 0.5


def test_strangers_with_ever_new_epochs_displace_no_writer_that_is_known() -> None:
    writer = Writer()
    writer.send(100)
    for epoch in range(100, 200):
        writer.tracker.observe(epoch, 5.0, writer.now)
    writer.fall_behind(2.0)
    assert writer.send() == pytest.approx([2.0])
