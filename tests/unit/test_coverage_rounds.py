"""When the rounds of a deployment begin: by the stamps of the snapshots, whatever a stranger stamped in between."""

from __future__ import annotations

import pytest

from muro_zenoh.behaviours.coverage import Coverage, Parameters
from muro_zenoh.behaviours.interface import Seen, Snapshot, Vehicle
from muro_zenoh.geometry import Bounds, State
from muro_zenoh.messages import RobotState

VEHICLE = Vehicle("r1", 0.177, 0.5, 1.5, 0.1, Bounds(-2.0, 2.0, -1.5, 1.5))
AT = State(0.5, 0.0, 0.0, 0.0, 0.0)
ROBOTS = (RobotState("r1", 0.5, 0.0, 0.0, 0.0, 0.0, 0.0, "tracking"),)


def cells(coverage: Coverage, stamps: list[float], epoch: int = 7) -> int:
    """How many cells it shows while it looks at snapshots of these stamps."""
    shown = 0
    for stamp in stamps:
        seen = Seen(stamp, AT, AT, snapshot=Snapshot(ROBOTS, stamp, epoch, 0.0), snapshot_age=0.0)
        shown += coverage.step(seen).cell is not None
    return shown


def steady(begin: float, seconds: float) -> list[float]:
    return [begin + 0.05 * k for k in range(round(20 * seconds))]


@pytest.mark.parametrize("ahead", [1.2, 40.0, 1e9])
def test_a_stamp_far_ahead_silences_the_rounds_for_no_longer_than_itself(ahead: float) -> None:
    coverage = Coverage(Parameters(), VEHICLE)
    assert cells(coverage, steady(100.0, 3.0)) >= 3
    cells(coverage, [103.0 + ahead])
    assert cells(coverage, steady(103.0, 3.0)) >= 3


def test_a_snapshot_that_is_a_little_older_is_not_looked_at() -> None:
    coverage = Coverage(Parameters(), VEHICLE)
    cells(coverage, steady(100.0, 3.0))
    before = coverage._round
    assert cells(coverage, [102.9, 102.0]) == 0
    assert coverage._round is before


def test_another_base_station_begins_anew() -> None:
    coverage = Coverage(Parameters(), VEHICLE)
    cells(coverage, steady(100.0, 3.0))
    assert cells(coverage, steady(60.0, 3.0), epoch=8) >= 3


@pytest.mark.parametrize("jitter", [0.01, 0.04])
def test_robots_that_receive_the_same_snapshots_at_different_times_decide_alike(jitter: float) -> None:
    """By the snapshots' stamps, and not by a clock of one's own."""

    def shown(jitter: float) -> list[float]:
        coverage, stamps = Coverage(Parameters(), VEHICLE), []
        for k, stamp in enumerate(steady(100.0, 6.0)):
            seen = Seen(stamp + jitter * (k % 3), AT, AT, snapshot=Snapshot(ROBOTS, stamp, 7, 0.0), snapshot_age=0.0)
            if coverage.step(seen).cell is not None:
                stamps.append(stamp)
        return stamps

    assert len(shown(0.0)) >= 5
    assert shown(jitter) == shown(0.0)
