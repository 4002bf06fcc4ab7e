"""Robots that obey keep apart, whatever they want and whichever snapshots each of them has; and they get past."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from muro_zenoh.behaviours.interface import Neighbour, Snapshot
from muro_zenoh.control.point_forward import GoToGoal
from muro_zenoh.geometry import STILL, Bounds, State, Twist2, wrap_to_pi
from muro_zenoh.safety.separation import Body, Separation, SeparationSettings
from muro_zenoh.safety.separation.certificate import Certificate
from muro_zenoh.safety.separation.guidance import FIDGET
from muro_zenoh.safety.separation.knowledge import Knowledge
from muro_zenoh.safety.separation.path import braking_path
from muro_zenoh.simulation.plant import Plant
from muro_zenoh.walls import Wall

BODY = Body()
SETTINGS = SeparationSettings()
KEEP = 2 * BODY.radius + SETTINGS.margin
PERIOD = 0.05
DEAD_MAN = 0.3

Decide = Callable[[int, float, State, Snapshot | None], Twist2 | None]
"""A robot's command; None when its process is frozen."""


class World:
    """Robots, and what each receives of the snapshots: 50 ms after the capture they are sent, then delayed and lost."""

    def __init__(
        self, starts: list[tuple[float, float, float]], seed: int, delays: list[float], loss: float = 0.0
    ) -> None:
        self.plant = Plant(np.array(starts), np.random.default_rng(seed), drive_error=0.0, slip=0.0, add_odometry=False)
        self.time = 0.0
        self.names = [f"r{k}" for k in range(len(starts))]
        self._random = random.Random(seed)
        self._delays, self._loss = delays, loss
        self._before: tuple[Neighbour, ...] | None = None
        self._underway: list[list[tuple[float, float, tuple[Neighbour, ...]]]] = [[] for _ in starts]
        self._newest: list[tuple[float, tuple[Neighbour, ...]] | None] = [None] * len(starts)
        self._commands = [STILL] * len(starts)
        self._commanded = [-math.inf] * len(starts)

    def states(self) -> list[State]:
        rows = np.hstack((self.plant.pose, self.plant.twist)).tolist()
        return [State(*row) for row in rows]

    def step(self, decide: Decide) -> None:
        now, states = self.time, self.states()
        if self._before is not None:
            for box, delay in zip(self._underway, self._delays, strict=True):
                if self._random.random() >= self._loss:
                    box.append((now + delay, now, self._before))
        self._before = tuple(Neighbour(name, *state, 0.05) for name, state in zip(self.names, states, strict=True))
        for k, state in enumerate(states):
            for arrival, sent, rows in self._underway[k]:
                if arrival <= now + 1e-9:
                    self._newest[k] = sent, rows
            self._underway[k] = [each for each in self._underway[k] if each[0] > now + 1e-9]
            newest = self._newest[k]
            snapshot = None if newest is None else Snapshot(newest[1], newest[0], 1, now - newest[0])
            command = decide(k, now, state, snapshot)
            if command is not None:
                self._commands[k], self._commanded[k] = command, now
        alive = [now - at < DEAD_MAN - 1e-9 for at in self._commanded]
        driven = [command if lives else STILL for command, lives in zip(self._commands, alive, strict=True)]
        for _ in range(2):
            self.plant.step(np.array(driven), PERIOD / 2)
        self.time = round(now + PERIOD, 6)


def knowledge(names: list[str], settings: SeparationSettings = SETTINGS) -> list[Knowledge]:
    return [Knowledge(me, BODY, {name: BODY for name in names if name != me}, settings) for me in names]


@pytest.mark.parametrize("seed", range(3))
def test_robots_that_drive_at_each_other_with_whatever_is_certified_keep_apart(seed: int) -> None:
    """Each takes, of many commands that are certified, the one that ends nearest to the others. Links delay up to 0.4 s
    and lose a fifth; one process freezes again and again."""
    rng = random.Random(seed)
    starts = [(-0.6, 0.0, 0.0), (0.6, 0.1, math.pi), (0.0, 0.7, -math.pi / 2)]
    world = World(starts, seed, delays=[0.0, 0.4, rng.choice([0.0, 0.1, 0.2])], loss=0.2)
    known = knowledge(world.names)
    inside = Bounds(-1.0, 1.0, -1.0, 1.0)
    frozen_until = 0.0
    driven = 0.0

    def decide(k: int, now: float, state: State, snapshot: Snapshot | None) -> Twist2 | None:
        nonlocal frozen_until
        if k == 2 and now >= frozen_until and rng.random() < 0.02:
            frozen_until = now + 1.0
        if k == 2 and now < frozen_until:
            return None
        if known[k].learn(now, snapshot):
            return STILL
        others = [(other.x, other.y) for j, other in enumerate(world.states()) if j != k]
        aim = min(others, key=lambda place: math.dist(place, (state.x, state.y)))
        if math.fmod(now + k, 6.0) < 2.0:  # away, so that there is something to drive
            aim = (2.0 * state.x - aim[0], 2.0 * state.y - aim[1])
        alpha = wrap_to_pi(math.atan2(aim[1] - state.y, aim[0] - state.x) - state.theta)
        certificate = Certificate(state, BODY, inside, known[k], SETTINGS, BODY.v_max)
        wild = [Twist2(rng.uniform(0.0, 0.5), rng.uniform(-1.5, 1.5)) for _ in range(4)]
        straight = [Twist2(v, max(-1.5, min(1.5, 4.0 * alpha))) for v in (0.5, 0.3, 0.15, 0.05, 0.0)]
        passing = [command for command in (*wild, *straight) if not certificate.blocker(command)]
        return min(
            passing, key=lambda c: math.dist(braking_path(state, c, SETTINGS.hold, BODY)[-1], aim), default=STILL
        )

    while world.time < 12.0:
        world.step(decide)
        driven += float(abs(world.plant.twist[:, 0]).sum()) * PERIOD
    assert world.plant.min_separation > KEEP - 0.005
    assert world.plant.min_separation < KEEP + 0.1  # they did come close
    assert driven > 1.0


def test_braking_at_any_moment_keeps_apart() -> None:
    """Two that drive at each other at full speed; one link is cut."""
    for cut in np.arange(0.9, 2.4, 0.1):
        world = World([(-1.2, 0.0, 0.0), (1.2, 0.1, math.pi)], 0, delays=[0.1, 0.1])
        known = knowledge(world.names)

        def decide(k: int, now: float, state: State, snapshot: Snapshot | None) -> Twist2 | None:
            if k == 0 and now >= cut:  # noqa: B023
                return None
            if known[k].learn(now, snapshot):  # noqa: B023
                return STILL
            certificate = Certificate(state, BODY, Bounds(-2.0, 2.0, -2.0, 2.0), known[k], SETTINGS, 0.5)  # noqa: B023
            return next(
                (Twist2(v, 0.0) for v in (0.5, 0.3, 0.2, 0.1) if not certificate.blocker(Twist2(v, 0.0))), STILL
            )

        while world.time < 6.0:
            world.step(decide)
        assert KEEP - 0.005 < world.plant.min_separation < KEEP + 0.25


def test_a_lost_robot_is_an_obstacle_to_keep_the_whole_distance_from() -> None:
    known = Knowledge("r0", BODY, {"r1": BODY}, SETTINGS)
    for k in range(-20, 1):
        rows = (Neighbour("r0", 0.0, 0.0, 0.0, 0.0, 0.0, 0.05), Neighbour("r1", 0.6, 0.0, 0.0, 0.0, 0.0, 3.0, "lost"))
        assert known.learn(0.05 * k, Snapshot(rows, 0.05 * k, 1, 0.0)) in ("", "it listens before it drives")
    near = State(0.15, 0.0, 0.0, 0.0, 0.0)
    certificate = Certificate(near, BODY, Bounds(-2.0, 2.0, -2.0, 2.0), known, SETTINGS, 0.5)
    assert certificate.blocker(Twist2(0.5, 0.0)) == "r1"
    assert certificate.blocker(Twist2(0.0, 1.5)) == ""


def test_four_robots_swap_places() -> None:
    angles = [0.5 * math.pi * k for k in range(4)]
    starts = [(math.cos(a), math.sin(a), a + math.pi) for a in angles]
    world = World(starts, 0, delays=[0.05] * 4)
    arena = Bounds(-2.1, 2.1, -1.5, 1.5)
    filters = [Separation(me, BODY, dict.fromkeys(world.names, BODY), arena, SETTINGS) for me in world.names]
    law = GoToGoal(speed=0.4, tolerance=0.03)
    reasons = set()

    def decide(k: int, now: float, state: State, snapshot: Snapshot | None) -> Twist2:
        x, y = -starts[k][0], -starts[k][1]
        step = filters[k].step(now, state, law.twist(state.pose, x, y), snapshot, (x, y))
        reasons.add(step.reason)
        return step.twist

    def away() -> float:
        return max(math.dist((s.x, s.y), (-x, -y)) for s, (x, y, _) in zip(world.states(), starts, strict=True))

    while away() > 0.1 and world.time < 40.0:
        world.step(decide)
    assert world.time < 20.0
    assert world.plant.min_separation > KEEP - 0.005
    assert {"", "keeps clear of r0"} <= reasons


@pytest.mark.parametrize(
    ("start", "goal"),
    [
        ((0.075, 0.419, -1.544), (0.178, -0.554)),
        ((-0.316, 0.412, 1.218), (0.105, -0.544)),
        ((0.262, 0.501, 0.112), (0.037, -0.557)),
    ],
)
def test_a_robot_gets_round_a_parked_one(start: tuple[float, float, float], goal: tuple[float, float]) -> None:
    """It does not begin on one side, and then on the other."""
    world = World([start, (0.0, 0.0, -0.85)], 0, delays=[0.1] * 2)
    arena = Bounds(-2.1, 2.1, -1.5, 1.5)
    separation = Separation("r0", BODY, dict.fromkeys(world.names, BODY), arena, SETTINGS)
    law = GoToGoal(speed=0.4, tolerance=0.03)

    def decide(k: int, now: float, state: State, snapshot: Snapshot | None) -> Twist2:
        return separation.step(now, state, law.twist(state.pose, *goal), snapshot, goal).twist if k == 0 else STILL

    while math.dist(world.states()[0][:2], goal) > 0.1 and world.time < 25.0:
        world.step(decide)
    assert world.time < 14.0
    assert world.plant.min_separation > KEEP - 0.005


def test_robots_of_both_sides_get_through_a_doorway() -> None:
    starts = [(-0.8, 0.5, 0.0), (-0.8, -0.5, 0.0), (0.8, 0.5, math.pi), (0.8, -0.5, math.pi)]
    goals = [(1.5, 0.9), (1.5, -0.9), (-1.5, 0.9), (-1.5, -0.9)]
    walls = (Wall(0.0, 0.4, 0.0, 1.5), Wall(0.0, -1.5, 0.0, -0.4))
    world = World(starts, 0, delays=[0.1] * 4)
    arena = Bounds(-2.1, 2.1, -1.5, 1.5)
    filters = [Separation(me, BODY, dict.fromkeys(world.names, BODY), arena, SETTINGS, walls) for me in world.names]
    law = GoToGoal(speed=0.4, tolerance=0.03)

    def decide(k: int, now: float, state: State, snapshot: Snapshot | None) -> Twist2:
        return filters[k].step(now, state, law.twist(state.pose, *goals[k]), snapshot, goals[k]).twist

    def away() -> float:
        return max(math.dist((s.x, s.y), goal) for s, goal in zip(world.states(), goals, strict=True))

    while away() > 0.1 and world.time < 60.0:
        world.step(decide)
    assert world.time < 40.0
    assert world.plant.min_separation > KEEP - 0.005


@pytest.mark.parametrize("between", ["another place", "a hold", "no positions"])
def test_a_robot_that_begins_anew_has_not_stood_yet(between: str) -> None:
    """It does not take the other side, or back off, because of how long it was blocked before."""
    arena = Bounds(-2.1, 2.1, -1.5, 1.5)
    blocked, briefly = (Separation("r0", BODY, {"r0": BODY, "r1": BODY}, arena, SETTINGS) for _ in range(2))
    still = State(0.0, 0.0, 0.0, 0.0, 0.0)
    rows = (Neighbour("r0", 0.0, 0.0, 0.0, 0.0, 0.0, 0.05), Neighbour("r1", 0.41, 0.0, math.pi, 0.0, FIDGET, 0.05))
    before, after = ((1.5, -0.3) if between == "another place" else (1.5, 0.3)), (1.5, 0.3)
    law = GoToGoal(speed=0.4)

    def step(each: Separation, now: float, goal: tuple[float, float] | None, sees: bool = True) -> Twist2:
        desired = None if goal is None else law.twist(still.pose, *goal)
        return each.step(now, still, desired, Snapshot(rows, now, 1, 0.0) if sees else None, goal).twist

    for k in range(80):  # 4 s: then it tries the other side; and 1.5 s
        step(blocked, PERIOD * k, before)
        step(briefly, PERIOD * k, before if k >= 50 else None)
    for each in (blocked, briefly):
        if between == "no positions":
            step(each, PERIOD * 80, before, sees=False)
        elif between == "a hold":
            step(each, PERIOD * 80, None)
    assert [step(blocked, PERIOD * k, after) for k in range(81, 100)] == [
        step(briefly, PERIOD * k, after) for k in range(81, 100)
    ]


def test_the_turning_rate_does_not_alternate_in_a_crowd() -> None:
    """Eight robots that swap places: the filter acts most of the time, and its commands must suit wheels."""
    angles = [0.25 * math.pi * k for k in range(8)]
    starts = [(1.3 * math.cos(a), 1.3 * math.sin(a), a + math.pi) for a in angles]
    world = World(starts, 0, delays=[0.05] * 8)
    filters = [
        Separation(me, BODY, dict.fromkeys(world.names, BODY), Bounds(-2.1, 2.1, -1.5, 1.5), SETTINGS)
        for me in world.names
    ]
    law = GoToGoal(speed=0.4, tolerance=0.03)
    rates: list[list[float]] = [[] for _ in starts]

    def decide(k: int, now: float, state: State, snapshot: Snapshot | None) -> Twist2:
        x, y = -starts[k][0], -starts[k][1]
        step = filters[k].step(now, state, law.twist(state.pose, x, y), snapshot, (x, y))
        rates[k].append(step.twist.omega)
        return step.twist

    while world.time < 12.0:
        world.step(decide)
    pairs = [pair for each in rates for pair in pairwise(each)]
    flips = sum(before * after < 0.0 and abs(before - after) > 1.0 for before, after in pairs)
    assert flips < 0.03 * len(pairs)


def test_robots_on_a_ring_pass_unchanged() -> None:
    n, radius, v = 10, 1.2, 0.2
    names = [f"r{k}" for k in range(n)]
    others = dict.fromkeys(names, BODY)
    filters = [Separation(me, BODY, others, Bounds(-2.1, 2.1, -1.5, 1.5), SETTINGS) for me in names]

    def at(k: int, t: float) -> State:
        a = 2.0 * math.pi * k / n + v / radius * t
        return State(radius * math.cos(a), radius * math.sin(a), wrap_to_pi(a + math.pi / 2), v, v / radius)

    desired = Twist2(v, v / radius)
    for step in range(60):
        now = PERIOD * step
        rows = tuple(Neighbour(name, *at(k, now - 0.1), 0.05) for k, name in enumerate(names))
        for k, each in enumerate(filters):
            got = each.step(now, at(k, now), desired, Snapshot(rows, now - 0.05, 1, 0.05))
            assert got.reason in ("", "brakes: it listens before it drives")
            if step > 20:
                assert got.twist is desired
