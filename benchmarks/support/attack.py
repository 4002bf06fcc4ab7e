"""An attack on the separation certificate: robots that obey it, and otherwise do their worst.

Each robot has a certificate of its own, from its own snapshots, and drives the most aggressive of its ideas that the
certificate accepts; when it accepts none, it brakes. The world does its worst, too: old snapshots, lost ones, links
that are cut while the robot drives on, processes that freeze while the wheels go on, wheels that brake at any moment.
The bodies then are moved by the plant, which the certificate does not know.

Whatever happens, the clearance between two bodies must not fall below what the certificate leaves of its margin.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.support.crowd import ROBOT
from benchmarks.support.crowd_methods import BODY
from muro_zenoh.behaviours.interface import Neighbour, Snapshot
from muro_zenoh.estimation.wheel_model import WheelLimits
from muro_zenoh.geometry import STILL, Bounds, State, Twist2, wrap_to_pi
from muro_zenoh.safety.separation import Body, SeparationSettings
from muro_zenoh.safety.separation.certificate import Certificate
from muro_zenoh.safety.separation.knowledge import Knowledge
from muro_zenoh.simulation.plant import Plant

TICK = 0.0125
"""The plant's step [s]."""
PERIOD = 4
"""Of cameras and control loops [ticks]."""
SECONDS = 3.0
"""Length of a game [s]."""
KEPT = 0.04
"""What must remain of the margin (0.046 m by default) between two bodies [m]; the rest is for paths seen in points."""
ARENA = Bounds(-50.0, 50.0, -50.0, 50.0)
NEVER = 10**6
CAMERA_AGE = 0.05
_BEFORE = 80  # so long do the robots stand and are seen before the game begins [ticks]
TICKS = round(SECONDS / TICK)


class Player(NamedTuple):
    """One robot of a game, and what the world does to it. Times in ticks.

    ``x``, ``y`` [m], ``theta`` [rad]: its start, at rest; ``delay``: of its snapshots; ``loss``: the share of them that
    it never receives; ``cut`` and ``mended``: no snapshot taken from the one to the other arrives; ``phase``: of its
    control loop; ``freezes`` and ``wakes``: its control loop decides nothing from the one to the other, and its base
    sets the wheels to zero ``holds`` after it froze; ``waits``: it stands until then; ``idea``: how it attacks;
    ``seed``: of its luck; ``scale``: its wheels do so much more than nominal ones, which the others do not know;
    ``every``: it receives one snapshot of so many, the one whose ``turn`` it is.
    """

    x: float
    y: float
    theta: float
    delay: int = 8
    loss: float = 0.0
    cut: int = NEVER
    mended: int = NEVER
    phase: int = 0
    freezes: int = NEVER
    wakes: int = NEVER
    holds: int = 28
    waits: int = 0
    idea: int = 0
    seed: int = 0
    scale: float = 1.0
    every: int = 1
    turn: int = 0


Game = Sequence[Player]
Idea = Callable[[State, State, np.random.Generator], list[Twist2]]
"""``idea(me, victim, rng)``: commands, the most aggressive first. The victim is seen as it is, without delay."""


def _towards(me: State, x: float, y: float, gain: float) -> list[Twist2]:
    """As fast as possible to a place, forwards or backwards, whichever is quicker to begin."""
    alpha = wrap_to_pi(math.atan2(y - me.y, x - me.x) - me.theta)
    sign = 1.0 if abs(alpha) < math.pi / 2 else -1.0
    error = alpha if sign > 0.0 else wrap_to_pi(alpha + math.pi)
    omega = min(max(gain * error, -BODY.omega_max), BODY.omega_max)
    shares = (1.0, 0.8, 0.6, 0.4, 0.3, 0.2, 0.1, 0.05)
    return [Twist2(sign * BODY.v_max * share, omega) for share in shares] + [Twist2(0.0, omega)]


def chase(me: State, victim: State, rng: np.random.Generator) -> list[Twist2]:
    return _towards(me, victim.x, victim.y, 4.0)


def intercept(me: State, victim: State, rng: np.random.Generator) -> list[Twist2]:
    reach = rng.uniform(0.2, 1.0)
    return _towards(
        me,
        victim.x + reach * victim.v * math.cos(victim.theta),
        victim.y + reach * victim.v * math.sin(victim.theta),
        4.0,
    )


def swerve(me: State, victim: State, rng: np.random.Generator) -> list[Twist2]:
    """Full speed, turning as hard as is accepted, to either side."""
    side = rng.choice((-1.0, 1.0)) * BODY.omega_max
    turns = (side, 0.5 * side, 0.0, -0.5 * side, -side)
    return [Twist2(BODY.v_max * share, turn) for share in (1.0, 0.6, 0.3) for turn in turns]


def luck(me: State, victim: State, rng: np.random.Generator) -> list[Twist2]:
    v, omega = rng.uniform(-1.0, 1.0, (4, 2)).T * ((BODY.v_max,), (BODY.omega_max,))
    return [Twist2(*twist) for twist in zip(v.tolist(), omega.tolist(), strict=True)]


def curl(me: State, victim: State, rng: np.random.Generator) -> list[Twist2]:
    """Towards the victim, then away in a curve at the last moment: the tail of the braking path sweeps over."""
    commands = _towards(me, victim.x, victim.y, 4.0)
    if rng.random() < 0.5:
        commands = [command._replace(omega=math.copysign(BODY.omega_max, -command.omega)) for command in commands]
    return commands


IDEAS: tuple[Idea, ...] = (chase, intercept, swerve, luck, curl)


class Outcome(NamedTuple):
    """The least ``clearance`` of two bodies in a game [m], negative when they touched; the tick at which it was."""

    clearance: float
    tick: int


def play(games: Sequence[Game], settings: SeparationSettings) -> list[Outcome]:
    """Play games with the same number of robots, side by side.

    Args:
        games: the robots of each.
        settings: of the filter.
    """
    count = len(games[0])
    players = [player for game in games for player in game]
    starts = np.array([player[:3] for player in players])
    rng = np.random.default_rng(0)
    plant = Plant(
        starts,
        rng,
        limits=[_wheels(player.scale) for player in players],
        radius=ROBOT.radius,
        drive_error=0.0,
        slip=0.0,
        count_contacts=False,
        add_odometry=False,
    )
    names = [f"r{i}" for i in range(count)]
    minds = [
        _Mind(player, i % count, Knowledge(names[i % count], BODY, dict.fromkeys(names, BODY), settings), settings)
        for i, player in enumerate(players)
    ]
    first, second = np.triu_indices(count, k=1)
    least = np.full(len(games), np.inf)
    when = np.zeros(len(games), dtype=int)
    commands = np.zeros((len(players), 2))
    history: list[list[tuple[Neighbour, ...]]] = []
    for tick in range(-_BEFORE, TICKS):
        rows = np.column_stack((plant.pose, plant.twist)).tolist()
        states = [State(*row) for row in rows]
        if tick % PERIOD == 0:
            seen = [Neighbour(names[i % count], *row, CAMERA_AGE) for i, row in enumerate(rows)]
            history.append([tuple(seen[g : g + count]) for g in range(0, len(seen), count)])
        for i, mind in enumerate(minds):
            game = i // count * count
            command = mind.step(tick, states[i], states[game : game + count], history, i // count)
            if command is not None:
                commands[i] = command
        plant.step(commands, TICK)
        x, y = plant.pose[:, 0].reshape(-1, count), plant.pose[:, 1].reshape(-1, count)
        apart = np.hypot(x[:, first] - x[:, second], y[:, first] - y[:, second]).min(axis=1) - 2.0 * ROBOT.radius
        when[apart < least] = tick
        least = np.minimum(least, apart)
    return [Outcome(*outcome) for outcome in zip(least.tolist(), when.tolist(), strict=True)]


def _wheels(scale: float) -> WheelLimits:
    nominal = ROBOT.wheels
    return nominal._replace(
        a_max=scale * nominal.a_max, alpha_max=scale * nominal.alpha_max, brake=scale * nominal.brake
    )


def _body(scale: float) -> Body:
    wheels = _wheels(scale)
    return BODY._replace(
        v_max=scale * BODY.v_max,
        omega_max=scale * BODY.omega_max,
        a_max=wheels.a_max,
        alpha_max=wheels.alpha_max,
        brake=wheels.brake,
    )


class _Mind:
    """The control loop of one robot that attacks.

    Args:
        player: the robot.
        me: its index within the game.
        known: what it knows of the others.
        settings: of its filter.
    """

    def __init__(self, player: Player, me: int, known: Knowledge, settings: SeparationSettings) -> None:
        self._player, self._me, self._known, self._settings = player, me, known, settings
        self._body = _body(player.scale)
        self._rng = np.random.default_rng(player.seed)
        taken = np.arange(-_BEFORE, TICKS + PERIOD, PERIOD)
        self._lost = (taken > 0) & (self._rng.random(len(taken)) < player.loss)
        self._lost |= (taken >= player.cut) & (taken < player.mended)
        self._lost |= (taken > 0) & (np.arange(len(taken)) % player.every != player.turn)
        self._newest = -1
        self._victim, self._until = 0, 0

    def step(
        self, tick: int, state: State, states: Sequence[State], history: list[list[tuple[Neighbour, ...]]], game: int
    ) -> Twist2 | None:
        """The command of this tick; None when it stays as it is."""
        player = self._player
        arrived = (tick + _BEFORE - player.delay) // PERIOD
        if arrived > self._newest and not self._lost[arrived]:
            self._newest = arrived
        if player.freezes <= tick < player.wakes:
            return STILL if tick - player.freezes >= player.holds else None
        if (tick - player.phase) % PERIOD or self._newest < 0:
            return None
        now = tick * TICK
        sent = (self._newest * PERIOD - _BEFORE) * TICK + CAMERA_AGE
        snapshot = Snapshot(history[self._newest][game], sent, 1, now - sent)
        if self._known.learn(now, snapshot) or tick < max(player.waits, 0):
            return STILL
        certificate = Certificate(state, self._body, ARENA, self._known, self._settings, self._body.v_max)
        for command in self._ideas(tick, state, states):
            scaled = Twist2(self._player.scale * command.v, self._player.scale * command.omega)
            if not certificate.blocker(scaled):
                return scaled
        return STILL

    def _ideas(self, tick: int, state: State, states: Sequence[State]) -> list[Twist2]:
        if tick >= self._until:  # whom to attack, for a while
            others = [i for i in range(len(states)) if i != self._me]
            self._victim = int(self._rng.choice(others))
            self._until = tick + int(self._rng.integers(10, 80))
        return IDEAS[self._player.idea % len(IDEAS)](state, states[self._victim], self._rng)
