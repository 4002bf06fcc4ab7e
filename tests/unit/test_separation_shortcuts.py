"""What the filter leaves out because it cannot matter, does not matter: beside it one that leaves out nothing."""

from __future__ import annotations

import math
import random

import pytest

from muro_zenoh.behaviours.interface import Neighbour, Snapshot
from muro_zenoh.geometry import STILL, Bounds, State, Twist2
from muro_zenoh.safety.separation import Body, Separation, SeparationSettings
from muro_zenoh.safety.separation import certificate as certificates
from muro_zenoh.safety.separation import filter as filters
from muro_zenoh.safety.separation.body import RobotSeen
from muro_zenoh.safety.separation.certificate import Certificate
from muro_zenoh.safety.separation.knowledge import _TOGETHER, WALL, Knowledge, _Mate, _Received
from muro_zenoh.safety.separation.line import Line
from muro_zenoh.safety.separation.path import advance, braking_path
from muro_zenoh.safety.separation.reach import travel_toward

ARENA = Bounds(-2.1, 2.1, -1.5, 1.5)
NAMES = [f"r{k}" for k in range(10)]
BODIES = {name: Body(radius=0.1 + 0.01 * k) for k, name in enumerate(NAMES)}
PERIOD = 0.05


class Thorough(Knowledge):
    """It looks at every older line of every robot."""

    def lines(self, x: float, y: float, reach: float) -> list[Line]:
        found: list[Line] = []
        *older, newest = self._received
        for row, mate, v in self._tracked:
            line = self._line(newest, row.name)
            if line is not None and line.nx * x + line.ny * y + reach > line.bound:
                found.append(line)
            self._older_lines(x, y, reach, row, mate, v, math.inf, older, found)
        return found

    def _older_lines(
        self,
        x: float,
        y: float,
        reach: float,
        row: RobotSeen,
        mate: _Mate,
        v: float,
        comes: float,
        older: list[_Received],
        found: list[Line],
    ) -> None:
        c, s = math.cos(row.theta), math.sin(row.theta)
        for start in range(0, len(older), _TOGETHER):
            group = older[start : start + _TOGETHER]
            lines = [line for received in group if (line := self._line(received, row.name)) is not None]
            crossed = [line for line in lines if line.nx * x + line.ny * y + reach > line.bound]
            if not crossed:
                continue
            ahead = max(-line.nx * c - line.ny * s for line in crossed)
            drives = group[-1].sent + self._span - (self._sent - row.age)
            come = travel_toward(v, math.acos(min(1.0, ahead)), mate.body, drives)
            for nx, ny, bound, other in crossed:
                there = max(bound, nx * row.x + ny * row.y - mate.keep - come)
                if nx * x + ny * y + reach > there:
                    found.append(Line(nx, ny, there, other))


class Patient(Certificate):
    """It looks at every line at every point of every path."""

    def blocker(self, command: Twist2) -> str:
        for held in (self._hold, PERIOD):
            points = braking_path(self._state, command, held, self._body)
            for nx, ny, bound, other, _ in self._lines:
                if any(nx * x + ny * y > bound for x, y in points):
                    return other
        return ""


def drive(seed: int) -> list[tuple[Twist2, str]]:
    """Ten robots that start close together and want to go anywhere; the snapshots come late, and one in ten is lost."""
    rng = random.Random(seed)
    settings = SeparationSettings()
    states = [
        State(0.8 * (k % 4) - 1.2 + rng.uniform(-0.1, 0.1), 0.8 * (k // 4) - 0.8, rng.uniform(-3.1, 3.1), 0.0, 0.0)
        for k in range(len(NAMES))
    ]
    crowd = [Separation(name, BODIES[name], BODIES, ARENA, settings) for name in NAMES]
    targets = [(rng.uniform(-1.7, 1.7), rng.uniform(-1.1, 1.1)) for _ in NAMES]
    sent: list[tuple[Neighbour, ...]] = []
    newest = [0] * len(NAMES)
    decisions = []
    for k in range(110):
        now = PERIOD * k
        sent.append(tuple(Neighbour(name, *state, 0.05) for name, state in zip(NAMES, states, strict=True)))
        for i, state in enumerate(states):
            if rng.random() > 0.1:
                newest[i] = max(0, k - i % 3)
            stamp = PERIOD * newest[i]
            snapshot = Snapshot(sent[newest[i]], stamp, 1, now - stamp)
            away = math.atan2(targets[i][1] - state.y, targets[i][0] - state.x)
            turn = math.remainder(away - state.theta, math.tau)
            wanted = Twist2(0.4 * math.cos(turn), 2.0 * math.sin(turn))
            target = targets[i] if i % 2 else None
            decision = crowd[i].step(now, state, wanted, snapshot, target)
            decisions.append((decision.twist, decision.reason))
            body = BODIES[NAMES[i]]
            v, length = advance(state.v, decision.twist.v, body.a_max, body.brake, body.lag, PERIOD)
            omega, turned = advance(state.omega, decision.twist.omega, body.alpha_max, 6.0, body.lag, PERIOD)
            along = state.theta + 0.5 * turned
            x, y = state.x + length * math.cos(along), state.y + length * math.sin(along)
            states[i] = State(x, y, state.theta + turned, v, omega)
    return decisions


@pytest.mark.parametrize("seed", range(3))
def test_the_decisions_are_those_of_a_filter_without_shortcuts(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    decisions = drive(seed)
    monkeypatch.setattr(filters, "Knowledge", Thorough)
    monkeypatch.setattr(filters, "Certificate", Patient)
    expected = drive(seed)
    assert decisions == expected
    changed = [twist for twist, reason in expected if reason.startswith("keeps clear")]
    assert len(changed) > 100
    assert any(not reason for _, reason in expected)


def test_a_shortcut_that_is_too_short_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    expected = drive(0)
    monkeypatch.setattr(certificates, "stopping_distance", lambda v, body: 0.0)
    assert drive(0) != expected


@pytest.mark.parametrize("short", [0.01, 0.03, 0.05, 0.08])
def test_a_robot_that_cannot_stop_before_a_wall_may_brake(short: float) -> None:
    known = Knowledge("r0", BODIES["r0"], {}, SeparationSettings())
    state = State(ARENA.x_max - short, 0.0, 0.0, 0.4, 0.0)  # comes to rest after 0.085 m
    certificate = Certificate(state, BODIES["r0"], ARENA, _seen(known, state), SeparationSettings(), 0.4)
    assert certificate.blocker(STILL) == ""
    assert certificate.blocker(Twist2(0.1, 0.0)) == WALL


def _seen(known: Knowledge, state: State) -> Knowledge:
    known.learn(0.0, Snapshot((Neighbour("r0", *state, 0.0),), 0.0, 1, 0.0))
    return known
