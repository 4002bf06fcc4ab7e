"""Robots that are not what they say: the base station notices from their movement, the base from its wheels."""

from __future__ import annotations

import math

import pytest

from agents.base.obedience import LASTING, Obedience
from basestation.fleet.doubts import Doubts
from muro_zenoh.estimation.wheel_model import WheelLimits, step_wheels
from muro_zenoh.geometry import Pose2

FRAME = 0.05


def watched(
    v: float, omega: float, *, says: tuple[float, float] | None = None, carried: float = 0.0, silent: float = math.inf
) -> str:
    """What is doubted of a robot after a second of driving on an arc."""
    doubts = Doubts()
    says_v, says_omega = says or (v, omega)
    x = y = theta = 0.0
    for k in range(21):
        t = k * FRAME
        doubts.saw("r1", Pose2(x, y + carried * t, theta), t)
        if t <= silent:
            doubts.said("r1", says_v, says_omega, t + 0.02)
        theta += omega * FRAME
        x += v * FRAME * math.cos(theta - 0.5 * omega * FRAME)
        y += v * FRAME * math.sin(theta - 0.5 * omega * FRAME)
    return doubts.of("r1")


class TestMovement:
    @pytest.mark.parametrize(("v", "omega"), [(0.0, 0.0), (0.5, 0.0), (0.3, 1.5), (-0.3, -1.0)])
    def test_one_that_moves_as_it_says(self, v: float, omega: float) -> None:
        assert watched(v, omega) == ""

    def test_an_uncalibrated_drive_is_no_lie(self) -> None:
        assert watched(0.4, 0.8, says=(0.48, 0.96)) == ""

    def test_a_wrong_speed(self) -> None:
        assert watched(0.1, 0.0, says=(0.5, 0.0)) == "r1 does not move as it says (0.18 m off within 0.4 s)"

    def test_a_wrong_turning_rate(self) -> None:
        assert watched(0.0, 0.0, says=(0.0, 1.5))

    def test_one_that_is_carried(self) -> None:
        assert watched(0.0, 0.0, carried=0.5)

    def test_one_that_stands_and_is_carried_slowly(self) -> None:
        assert watched(0.0, 0.0, carried=0.2)
        assert watched(0.0, 0.0, carried=0.1) == "", "or every bump of a camera would be a doubt"

    def test_one_that_drives_may_be_off_by_more(self) -> None:
        assert watched(0.4, 0.0, carried=0.2) == ""

    def test_one_that_stands_and_is_turned_slowly(self) -> None:
        assert watched(0.0, 0.8, says=(0.0, 0.0))
        assert watched(0.0, 0.4, says=(0.0, 0.0)) == ""

    def test_nothing_is_said_of_one_that_is_silent(self) -> None:
        assert watched(0.5, 0.0, says=(0.0, 0.0), silent=0.5) == ""

    def test_one_that_is_forgotten(self) -> None:
        doubts = Doubts()
        doubts.saw("r1", Pose2(0.0, 0.0, 0.0), 0.0)
        doubts.forget("r1")
        assert doubts.of("r1") == ""


class TestWheels:
    BEAT = 0.02

    def driven(self, seconds: float, obedience: Obedience, command: tuple[float, float], **does: float) -> None:
        """Beats with wheels that follow the command late, or do something else."""
        v, omega = self.speeds
        obedience.command(*command, self.time)
        for _ in range(round(seconds / self.BEAT)):
            v, omega = step_wheels(v, omega, *command, WheelLimits(), self.BEAT)
            self.time += self.BEAT
            obedience.read(does.get("v", v), does.get("omega", omega), self.time)
        self.speeds = v, omega

    @pytest.fixture
    def obedience(self) -> Obedience:
        self.time, self.speeds = 0.0, (0.0, 0.0)
        return Obedience(WheelLimits())

    def test_wheels_that_follow(self, obedience: Obedience) -> None:
        for command in ((0.5, 1.5), (-0.5, -1.5), (0.0, 0.0)):
            self.driven(1.0, obedience, command)
            assert not obedience.unruly

    def test_wheels_that_somebody_turns(self, obedience: Obedience) -> None:
        self.driven(1.0, obedience, (0.0, 0.0))
        self.driven(LASTING - 0.02, obedience, (0.0, 0.0), v=0.2)
        assert not obedience.unruly
        self.driven(0.06, obedience, (0.0, 0.0), v=0.2)
        assert obedience.unruly
        self.driven(0.02, obedience, (0.0, 0.0))
        assert not obedience.unruly

    def test_wheels_that_are_blocked(self, obedience: Obedience) -> None:
        self.driven(1.0, obedience, (0.3, 0.0), v=0.0)
        assert obedience.unruly

    def test_after_a_pause_nothing_is_known(self, obedience: Obedience) -> None:
        self.driven(1.0, obedience, (0.3, 0.0))
        self.time += 1.0
        obedience.read(0.0, 0.0, self.time)
        assert not obedience.unruly
