"""Robots that obey the separation certificate, and otherwise do their worst: the margin stays; planted flaws show.

The whole attack: ``python benchmarks/safety.py --attack --states 1000000``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.support.attack import KEPT, Game, play
from benchmarks.support.attack_games import random_game, search
from muro_zenoh.safety.separation import SeparationSettings, certificate
from muro_zenoh.safety.separation.line import Line, Stretch, line_between

SETTINGS = SeparationSettings()


def games(count: int, robots: int) -> Sequence[Game]:
    rng = np.random.default_rng(robots)
    return [random_game(rng, robots, SETTINGS) for _ in range(count)]


def least(played: Sequence[Game], settings: SeparationSettings = SETTINGS) -> float:
    return min(outcome.clearance for outcome in play(played, settings))


@pytest.mark.parametrize(("count", "robots"), [(80, 2), (30, 3), (12, 4)])
def test_robots_that_obey_keep_their_margin(count: int, robots: int) -> None:
    assert least(games(count, robots)) >= KEPT


def test_a_search_finds_no_way_round_it() -> None:
    assert search(SETTINGS, seed=1, generations=3, population=20).clearance >= KEPT


def test_robots_that_do_not_obey_touch(monkeypatch: pytest.MonkeyPatch) -> None:
    """So that the attack is one."""
    monkeypatch.setattr(certificate.Certificate, "blocker", lambda self, command: "")
    assert least(games(10, 2)) < 0.0


def test_a_flipped_sign_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    def flipped(mine: Stretch, theirs: Stretch, other: str) -> Line:
        line = line_between(mine, theirs, other)
        return line._replace(nx=-line.nx, ny=-line.ny, bound=-line.bound)

    monkeypatch.setattr(certificate, "line_between", flipped)
    assert least(games(10, 2)) < 0.0


def test_a_line_that_is_not_shared_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    def greedy(mine: Stretch, theirs: Stretch, other: str) -> Line:
        line = line_between(mine, theirs, other)
        return line._replace(bound=line.bound + 0.03)

    monkeypatch.setattr(certificate, "line_between", greedy)
    assert least(games(20, 2)) < KEPT


def test_a_path_without_the_hold_shows() -> None:
    assert least(games(80, 2), replace(SETTINGS, hold=0.05)) < 0.0


def test_half_the_margin_shows() -> None:
    assert least(games(80, 2), replace(SETTINGS, margin=0.5 * SETTINGS.margin)) < KEPT
