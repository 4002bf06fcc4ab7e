"""The wheels' recent past: odometry and what the model adds to it, in any order."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from muro_zenoh.estimation.filter_settings import FilterSettings
from muro_zenoh.estimation.wheel_model import WheelLimits
from muro_zenoh.estimation.wheel_track import LONGEST_ARC, WheelTrack


def track() -> WheelTrack:
    return WheelTrack(FilterSettings(), WheelLimits())


def distance(of: WheelTrack, start: float, end: float) -> float:
    arcs, _ = of.walk(start, end)
    assert sum(dt for _, _, dt in arcs) == pytest.approx(end - start)
    return sum(v * dt for v, _, dt in arcs)


@pytest.mark.parametrize("t", [-100.0, 0.0, 12.3, 60.0])
def test_the_first_odometry_after_minutes_of_commands_alone_is_taken(t: float) -> None:
    # Commands alone make more knots than are kept; those that were thinned out must not be looked for.
    it = track()
    for k in range(1200):
        it.command(0.05 * k, 0.2, 0.0)
    it.twist(t, 0.1, 0.0)
    it.twist(61.0, 0.3, 0.0)
    assert it.walk(60.9, 61.0)[1] == (0.3, 0.0)


def test_forgetting_before_any_odometry_forgets_only_the_past() -> None:
    it = track()
    for k in range(100):
        it.command(0.05 * k, 0.2, 0.0)
    before = distance(it, 3.0, 5.0)
    it.forget(2.0)
    assert it._knots[0][0] == pytest.approx(2.0, abs=0.06)
    assert distance(it, 3.0, 5.0) == before
    assert distance(it, 2.0, 5.0) == pytest.approx(0.6, abs=0.01)


def test_odometry_that_comes_late_replaces_what_the_model_has_added() -> None:
    it = track()
    it.twist(0.0, 0.2, 0.0)
    for k in range(1, 40):
        it.command(0.05 * k, 0.2, 0.0)
    it.forget(1.5)
    it.twist(0.1, 0.0, 0.0)  # they had stopped
    assert it.walk(0.1, 0.1)[1] == (0.0, 0.0)
    assert distance(it, 0.0, 0.1) == pytest.approx(0.015)


def test_odometry_that_is_not_newer_is_ignored() -> None:
    it = track()
    it.twist(1.0, 0.2, 0.0)
    it.twist(1.0, 0.9, 0.0)
    it.twist(0.5, 0.9, 0.0)
    assert it.walk(0.5, 1.0)[1] == (0.2, 0.0)


@pytest.mark.parametrize("silent", [1.0, 3600.0, 60 * 3600.0])
def test_wheels_at_rest_take_one_step_however_long_they_are_silent(silent: float) -> None:
    # A computer that was suspended: its first update must not block the loop.
    it = track()
    it.twist(0.0, 0.3, -0.5)
    it.command(0.0, 0.3, -0.5)
    ahead = it._ahead(5.0 + silent)
    assert len(ahead) < 80
    assert [knot[0] for knot in ahead] == sorted({knot[0] for knot in ahead})
    assert ahead[-1] == pytest.approx((5.0 + silent, 0.0, 0.0), abs=1e-6)
    arcs, speeds = it.walk(0.0, 5.0 + silent)
    assert len(arcs) < 80
    assert speeds == pytest.approx((0.0, 0.0), abs=1e-6)
    assert sum(dt for _, _, dt in arcs) == pytest.approx(5.0 + silent)
    assert distance(it, 0.0, 5.0 + silent) == pytest.approx(distance(it, 0.0, 3.0), abs=1e-5)


@pytest.mark.parametrize(("v", "omega"), [(0.3, 0.0), (0.0, -1.0)])
def test_wheels_that_still_roll_take_short_steps(v: float, omega: float) -> None:
    it = track()
    it.twist(0.0, v, omega)
    it.command(0.0, 0.0, 0.0)
    braking = it._ahead(0.3)
    assert max(b - a for (a, *_), (b, *_) in itertools.pairwise([(0.0,), *braking])) <= LONGEST_ARC + 1e-9


def test_wheels_at_rest_take_short_steps_from_their_next_command_on() -> None:
    it = track()
    it.twist(0.0, 0.0, 0.0)
    it.command(0.0, 0.0, 0.0)
    it.command(0.1, 0.3, 0.0)  # at rest until then
    assert [knot[0] for knot in it._ahead(0.2)] == pytest.approx([0.1, 0.15, 0.2], abs=1e-6)


events = st.tuples(st.sampled_from(["twist", "command", "forget"]), st.floats(-10.0, 40.0), st.floats(-1.0, 1.0))


@given(st.lists(events, max_size=40), st.integers(0, 700))
def test_it_bears_any_order_of_events(said: list[tuple[str, float, float]], before: int) -> None:
    it = track()
    for k in range(before):
        it.command(0.05 * k, 0.1, 0.0)
    for what, t, v in said:
        if what == "twist":
            it.twist(t, v, -v)
        elif what == "command":
            it.command(t, v, -v)
        else:
            it.forget(t)
        times = [knot[0] for knot in it._knots]
        assert times == sorted(set(times))
    arcs, (v, omega) = it.walk(0.0, 41.0)
    assert all(map(math.isfinite, (v, omega, *(number for arc in arcs for number in arc))))
