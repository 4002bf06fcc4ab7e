"""Delta debugging on synthetic predicates: the smallest part that breaks is found, and a whole trial is shrunk."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from muro_zenoh.checking.judgement import Breach
from muro_zenoh.checking.minimal import AFTER, minimal
from muro_zenoh.checking.random_trial import random_trial
from muro_zenoh.checking.shrink import fewest
from muro_zenoh.config import Scenario


@given(st.sets(st.integers(0, 30), min_size=1, max_size=4))
def test_exactly_what_is_needed_is_left(needed: set[int]) -> None:
    assert fewest(range(31), lambda some: needed <= set(some)) == sorted(needed)


def test_nothing_is_left_when_nothing_is_needed() -> None:
    assert fewest(range(10), lambda some: True) == []


def test_of_two_causes_one_is_left() -> None:
    left = fewest(range(12), lambda some: {2, 3} <= set(some) or {8} <= set(some))
    assert left in ([2, 3], [8])


def test_a_guess_saves_runs() -> None:
    runs = []

    def breaks(some: Sequence[int]) -> bool:
        runs.append(some)
        return {4, 17} <= set(some)

    assert fewest(range(30), breaks, guesses=[[4, 17], [1]]) == [4, 17]
    assert len(runs) == 4  # [1], [4, 17], and without each


def breaks(scenario: Scenario, seed: int) -> Breach | None:
    """r2 and r5 touch at 6 s when a fault befalls the base station before."""
    befallen = any(fault.target == "basestation" and fault.at < 6.0 for fault in scenario.faults)
    if befallen and {"r2", "r5"} <= set(scenario.robots) and scenario.duration >= 6.0:
        return Breach("no contact", 6.0, ("r2", "r5"), "r2 touches r5")
    return None


class TestAWholeTrial:
    @pytest.fixture
    def scenario(self) -> Scenario:
        trial = random_trial(4)
        fault = msgspec.structs.replace(trial.faults[0], target="basestation", at=3.0)
        starts = dict.fromkeys(trial.robots, (0.0, 0.0, 0.0))
        return msgspec.structs.replace(trial, faults=(fault, *trial.faults), starts=starts)

    def test_is_shrunk_to_what_breaks(self, scenario: Scenario) -> None:
        breach = breaks(scenario, 4)
        assert breach is not None
        least = minimal(scenario, 4, breach, breaks)
        assert least.scenario.robots == ("r2", "r5")
        assert [fault.target for fault in least.scenario.faults] == ["basestation"]
        assert least.scenario.orders == ()
        assert least.scenario.duration == pytest.approx(6.0 + AFTER)
        assert set(least.scenario.starts) == set(least.scenario.goals) == {"r2", "r5"}
        assert least.seed == 4
        assert least.runs < 30

    def test_another_seed_is_taken_when_fewer_robots_need_it(self, scenario: Scenario) -> None:
        def breaks_with_luck(scenario: Scenario, seed: int) -> Breach | None:
            return breaks(scenario, seed) if len(scenario.robots) == 10 or seed == 6 else None

        breach = breaks(scenario, 4)
        assert breach is not None
        least = minimal(scenario, 4, breach, breaks_with_luck)
        assert (least.scenario.robots, least.seed) == (("r2", "r5"), 6)
