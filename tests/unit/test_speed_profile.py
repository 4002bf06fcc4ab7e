"""The speed along a path, driven without errors."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from muro_zenoh.control.speed_profile import SpeedProfile, path_speed
from muro_zenoh.geometry import Pose2
from muro_zenoh.planning.path import Path, Segment

DT = 0.05
PROFILE = SpeedProfile(v_min=0.1, v_max=0.3, acceleration=0.2, deceleration=0.3, reaction=0.1)
ORIGIN = Pose2(0.0, 0.0, 0.0)


def driven(path: Path, profile: SpeedProfile = PROFILE) -> list[tuple[float, float]]:
    """Distance and speed at each step until it stops."""
    s, v, rows = 0.0, 0.0, []
    for _ in range(5000):
        v = path_speed(path, s, v, DT, profile)
        rows.append((s, v))
        s += v * DT
        if v == 0.0:
            return rows
    raise AssertionError(f"still driving after {5000 * DT} s, at {s} of {path.length} m")


@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_slow_in_arcs_fast_on_the_straight_for_left_and_right_turns(turn: float) -> None:
    path = Path(ORIGIN, (Segment(0.5, turn * 3.0), Segment(2.0, 0.0), Segment(0.5, turn * 3.0)))
    rows = driven(path)
    assert all(v <= 0.1 + 1e-9 for s, v in rows if s < 0.5 or s > 2.5)
    assert max(v for _, v in rows) == pytest.approx(0.3)
    mirrored = driven(Path(ORIGIN, tuple(Segment(length, -c) for length, c in path.segments)))
    assert mirrored == rows


lengths = st.floats(0.0, 1.5)


@given(
    pieces=st.lists(st.tuples(lengths, st.sampled_from([0.0, 3.0, -3.0])), min_size=1, max_size=5),
    v_max=st.floats(0.1, 0.5),
    deceleration=st.floats(0.2, 1.0),
)
def test_limits_hold_and_it_stops_at_the_end(
    pieces: list[tuple[float, float]], v_max: float, deceleration: float
) -> None:
    profile = SpeedProfile(v_min=0.1, v_max=v_max, deceleration=deceleration)
    path = Path(ORIGIN, tuple(Segment(*piece) for piece in pieces))
    rows = driven(path, profile)
    for (_, v), (s, faster) in itertools.pairwise(rows):
        assert faster - v <= profile.acceleration * DT + 1e-9
        assert v - faster <= deceleration * DT + 1e-9 or path.length - s <= profile.tolerance
        assert faster <= v_max
        if s > 0.0 and s < path.length and path.curvature_at(s) != 0.0:
            # A step that begins on the straight may end a little inside the arc.
            assert faster <= profile.v_min + deceleration * DT
    assert abs(path.length - rows[-1][0]) <= profile.tolerance


def test_a_tight_arc_is_slower_than_v_min() -> None:
    profile = SpeedProfile(v_min=0.2, v_max=0.3, omega_max=0.5)
    path = Path(ORIGIN, (Segment(1.0, -5.0),))
    assert max(v for _, v in driven(path, profile)) == pytest.approx(0.1)


def test_a_path_of_no_length_is_arrived_at() -> None:
    assert path_speed(Path(ORIGIN, ()), 0.0, 0.0, DT, PROFILE) == 0.0


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"v_min": 0.0}, "v_min"),
        ({"v_max": 0.05}, "v_min: got 0.1, expected at most v_max, 0.05"),
        ({"reaction": -1.0}, "reaction"),
    ],
)
def test_an_invalid_profile_is_refused(changes: dict[str, float], what: str) -> None:
    with pytest.raises(ValueError, match=what):
        SpeedProfile(**changes)
