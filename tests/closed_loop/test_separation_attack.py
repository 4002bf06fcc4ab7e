"""Robots that obey the separation certificate, and otherwise do their worst: the margin stays; planted flaws show.

The whole attack: ``python benchmarks/safety.py --attack --states 1000000``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.support.attack import KEPT, NEVER, Game, Player, play
from benchmarks.support.attack_games import random_game, search
from muro_zenoh.safety.separation import Body, SeparationSettings, certificate, knowledge
from muro_zenoh.safety.separation.line import Line, Stretch, line_between
from muro_zenoh.safety.separation.reach import travel_toward

SETTINGS = SeparationSettings()


def games(count: int, robots: int) -> Sequence[Game]:
    rng = np.random.default_rng(robots)
    return [random_game(rng, robots, SETTINGS) for _ in range(count)]


def least(played: Sequence[Game], settings: SeparationSettings = SETTINGS) -> float:
    return min(outcome.clearance for outcome in play(played, settings))


@pytest.mark.parametrize(("count", "robots"), [(60, 2), (24, 3), (10, 4)])
def test_robots_that_obey_keep_their_margin(count: int, robots: int) -> None:
    assert least(games(count, robots)) >= KEPT


GOES_BLIND = (
    Player(
        0.072915,
        0.380371,
        -1.671023,
        10,
        0.2,
        46,
        160,
        phase=2,
        freezes=57,
        wakes=148,
        holds=16,
        waits=9,
        idea=4,
        seed=2046118312,
    ),
    Player(
        -0.349683,
        0.012478,
        -0.443633,
        7,
        cut=20,
        mended=253,
        freezes=60,
        wakes=219,
        waits=35,
        seed=1339054785,
        scale=0.97655,
    ),
)
"""Both go by an old snapshot, then blind."""  # fmt: skip
BACKS_UP = (Player(0.0, 0.0, 2.947, cut=5, freezes=48, wakes=NEVER, waits=42), Player(0.5252, 0.0, 3.2145, 4))
"""The first stands, faces away, and sets off backwards as it goes blind."""


@pytest.mark.parametrize("game", [GOES_BLIND, BACKS_UP])
def test_what_the_attack_once_found(game: Game) -> None:
    assert play([game], SETTINGS)[0].clearance >= KEPT


def test_lines_given_up_too_early_show(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(knowledge.Knowledge, "_span", 0.2)
    assert play([GOES_BLIND], SETTINGS)[0].clearance < KEPT


def test_one_that_is_taken_not_to_back_up_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    def forwards(v: float, turn: float, body: Body, time: float) -> float:
        return travel_toward(v, turn, body, time) if turn < 0.5 * math.pi else 0.0

    monkeypatch.setattr(knowledge, "travel_toward", forwards)
    assert play([BACKS_UP], SETTINGS)[0].clearance < KEPT


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
