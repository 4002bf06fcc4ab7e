"""Robots that obey the separation certificate, and otherwise do their worst: the margin stays; planted flaws show.

The whole attack: ``python benchmarks/safety.py --attack --states 1000000``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.support.attack import KEPT, NEVER, Game, Player, play
from benchmarks.support.attack_games import random_game, search
from muro_zenoh.safety.separation import SeparationSettings, certificate, knowledge
from muro_zenoh.safety.separation.line import Line, Stretch, line_between

SETTINGS = SeparationSettings()


def games(count: int, robots: int) -> Sequence[Game]:
    rng = np.random.default_rng(robots)
    return [random_game(rng, robots, SETTINGS) for _ in range(count)]


def least(played: Sequence[Game], settings: SeparationSettings = SETTINGS) -> float:
    return min(outcome.clearance for outcome in play(played, settings))


@pytest.mark.parametrize(("count", "robots"), [(60, 2), (24, 3), (10, 4)])
def test_robots_that_obey_keep_their_margin(count: int, robots: int) -> None:
    assert least(games(count, robots)) >= KEPT


@pytest.mark.parametrize(
    "game",
    [
        # the lines of the last common snapshot given up while the one that goes blind still drives by them
        (
            Player(0.130, 0.209, -2.133, 22, cut=71, freezes=112, wakes=237, mended=202, idea=2, seed=1605467077),
            Player(-0.100, -0.356, 1.563, 24, loss=0.2, cut=4, mended=169, phase=3, waits=107, seed=34801515),
        ),
        # a robot at rest that faces away sets off backwards as it goes blind
        (Player(0.0, 0.0, 2.947, cut=5, freezes=48, wakes=NEVER, waits=42), Player(0.5252, 0.0, 3.2145, 4)),
    ],
    ids=["window", "backwards"],
)
def test_what_the_attack_once_found(game: Game) -> None:
    assert play([game], SETTINGS)[0].clearance >= KEPT


def test_a_search_finds_no_way_round_it() -> None:
    assert search(SETTINGS, seed=1, generations=2, population=10).clearance >= KEPT


def test_robots_that_do_not_obey_touch(monkeypatch: pytest.MonkeyPatch) -> None:
    """So that the attack is one."""
    monkeypatch.setattr(certificate.Certificate, "blocker", lambda self, command: "")
    assert least(games(10, 2)) < 0.0


def test_a_flipped_sign_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    def flipped(mine: Stretch, theirs: Stretch, other: str) -> Line:
        line = line_between(mine, theirs, other)
        return line._replace(nx=-line.nx, ny=-line.ny, bound=-line.bound)

    monkeypatch.setattr(knowledge, "line_between", flipped)
    assert least(games(10, 2)) < 0.0


def test_a_line_that_is_not_shared_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    def greedy(mine: Stretch, theirs: Stretch, other: str) -> Line:
        line = line_between(mine, theirs, other)
        return line._replace(bound=line.bound + 0.03)

    monkeypatch.setattr(knowledge, "line_between", greedy)
    assert least(games(20, 2)) < KEPT


def test_a_path_without_the_hold_shows() -> None:
    assert least(games(80, 2), replace(SETTINGS, hold=0.05)) < KEPT


def test_half_the_margin_shows() -> None:
    assert least(games(80, 2), replace(SETTINGS, margin=0.5 * SETTINGS.margin)) < KEPT
