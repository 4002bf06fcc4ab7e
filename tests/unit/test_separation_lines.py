"""Line, stopping path and reach: numbers worked by hand, and what holds for any."""

from __future__ import annotations

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from muro_zenoh.estimation.wheel_model import WheelLimits, follow
from muro_zenoh.geometry import State, Twist2
from muro_zenoh.safety.separation import Body
from muro_zenoh.safety.separation.line import Stretch, line_between, nearest_points
from muro_zenoh.safety.separation.path import advance, braking_path, stopping_distance
from muro_zenoh.safety.separation.reach import travel_toward

BODY = Body()
coordinate = st.floats(-2.0, 2.0)


def stretch(x: float, y: float, dx: float = 0.0, dy: float = 0.0, v: float = 0.0, keep: float = 0.2) -> Stretch:
    size = math.hypot(dx, dy) or 1.0
    return Stretch(x, y, x + dx, y + dy, v * dx / size, v * dy / size, keep)


class TestLine:
    def test_two_that_stand_a_metre_apart_get_a_half_of_the_free_sixty_centimetres_each(self) -> None:
        *line, other = line_between(stretch(0.0, 0.0), stretch(1.0, 0.0), "r2")
        assert line == pytest.approx([1.0, 0.0, 0.3])
        assert other == "r2"

    def test_the_larger_one_keeps_more_of_the_floor(self) -> None:
        mine, theirs = stretch(0.0, 0.0, keep=0.1), stretch(1.0, 0.0, keep=0.3)
        assert line_between(mine, theirs, "r2").bound == pytest.approx(0.3)
        # 0.3 + 0.1 of me and 0.3 + 0.3 of it: the line is at 0.4
        assert line_between(theirs, mine, "r1").bound == pytest.approx(-0.7)

    def test_two_that_meet_get_a_half_each_beyond_their_braking(self) -> None:
        mine, theirs = stretch(0.0, 0.0, 0.1, 0.0, v=0.3), stretch(1.0, 0.0, -0.1, 0.0, v=0.3)
        assert line_between(mine, theirs, "r2").bound == pytest.approx(0.1 + 0.5 * (0.8 - 0.4))

    def test_a_follower_gets_most_of_what_is_free_behind_the_one_ahead(self) -> None:
        mine, theirs = stretch(0.0, 0.0, 0.05, 0.0, v=0.2), stretch(0.8, 0.0, 0.05, 0.0, v=0.2)
        # needs: 0.1 + 0.2 and 0.1; three quarters of the free 0.35 m
        assert line_between(mine, theirs, "r2").bound == pytest.approx(0.05 + 0.75 * 0.35)

    def test_of_two_that_are_too_close_each_gives_half_of_what_lacks(self) -> None:
        assert line_between(stretch(0.0, 0.0), stretch(0.3, 0.0), "r2").bound == pytest.approx(-0.05)

    @given(*[coordinate] * 8, st.floats(0.0, 0.5), st.floats(0.0, 0.5))
    def test_both_sides_of_a_line_are_apart(
        self,
        ax: float,
        ay: float,
        adx: float,
        ady: float,
        bx: float,
        by: float,
        bdx: float,
        bdy: float,
        v: float,
        w: float,
    ) -> None:
        a, b = stretch(ax, ay, 0.1 * adx, 0.1 * ady, v), stretch(bx, by, 0.1 * bdx, 0.1 * bdy, w, keep=0.15)
        mine, theirs = line_between(a, b, "b"), line_between(b, a, "a")
        assert math.hypot(mine.nx, mine.ny) == pytest.approx(1.0)
        if math.dist(*nearest_points(a, b)) > 1e-6:  # the same line, seen from both sides
            assert (mine.nx, mine.ny) == pytest.approx((-theirs.nx, -theirs.ny), abs=1e-6)
            assert mine.bound + theirs.bound == pytest.approx(-0.35, abs=1e-6)

    @given(*[coordinate] * 8)
    def test_who_is_apart_already_is_on_its_side_with_all_of_its_stretch(
        self, ax: float, ay: float, adx: float, ady: float, bx: float, by: float, bdx: float, bdy: float
    ) -> None:
        a, b = stretch(ax, ay, 0.1 * adx, 0.1 * ady, 0.3), stretch(bx, by, 0.1 * bdx, 0.1 * bdy, 0.1)
        if math.dist(*nearest_points(a, b)) >= 0.4:
            line = line_between(a, b, "b")
            for x, y in ((a.x, a.y), (a.x_end, a.y_end)):
                assert line.nx * x + line.ny * y <= line.bound + 1e-9


class TestPath:
    def test_braking_from_half_a_metre_per_second(self) -> None:
        # 1 m/s^2 down to 0.1 m/s in 0.4 s: 0.12 m; then the lag's exponential: 0.1 m/s * 0.1 s
        assert stopping_distance(0.5, BODY) == pytest.approx(0.13)

    def test_a_command_is_held_and_then_braked(self) -> None:
        points = braking_path(State(0.0, 0.0, 0.0, 0.2, 0.0), Twist2(0.2, 0.0), 0.35, BODY)
        assert points[0] == (0.0, 0.0)
        assert points[-1] == pytest.approx((0.07 + stopping_distance(0.2, BODY), 0.0))

    def test_a_turning_robot_turns_while_it_brakes(self) -> None:
        end = braking_path(State(0.0, 0.0, 0.0, 0.4, 1.0), Twist2(0.0, 0.0), 0.0, BODY)[-1]
        assert end[1] > 0.005

    @given(st.floats(-0.6, 0.6), st.floats(-0.6, 0.6), st.floats(0.01, 0.6))
    @example(0.306, -0.00199, 0.6)  # nearly the most that it is too far
    @example(0.0918, -0.0275, 0.15)
    def test_speed_and_distance_are_those_of_the_wheel_model(self, speed: float, target: float, dt: float) -> None:
        limits = WheelLimits()
        after, distance = advance(speed, target, limits.a_max, limits.brake, limits.lag, dt)
        steps, at, come = 400, speed, 0.0
        for _ in range(steps):
            to = follow(at, target, limits.a_max, limits.brake, limits.lag, dt / steps)
            at, come = to, come + 0.5 * (at + to) * dt / steps
        assert after == pytest.approx(at, abs=1e-6)
        # The distance to a standstill on the way to the other sign is that of a ramp: it errs to the far side.
        too_far = math.copysign(1.0, speed) * (distance - come)
        most = 1e-4 if speed * target >= 0.0 else 1e-4 + 0.12 * dt * dt
        assert -1e-4 <= too_far <= most


class TestReach:
    @given(
        st.floats(-0.5, 0.5),
        st.floats(0.0, math.pi),
        st.floats(0.0, 0.9),
        st.lists(st.tuples(st.floats(-0.5, 0.5), st.floats(-1.5, 1.5)), min_size=6, max_size=6),
    )
    def test_no_drive_comes_further(
        self, v: float, turn: float, time: float, commands: list[tuple[float, float]]
    ) -> None:
        state = State(0.0, 0.0, turn, v, 0.0)  # the direction is +x
        best = 0.0
        for command in commands:
            dt = time / len(commands)
            x, y, theta, speed, omega = state
            end = braking_path(state, Twist2(*command), dt, BODY) if dt else [(x, y)]
            best = max(best, *(px for px, _ in end))
            omega2, angle = advance(omega, command[1], 3.0, 6.0, 0.1, dt)
            speed2, length = advance(speed, command[0], 0.5, 1.0, 0.1, dt)
            along = theta + 0.5 * angle
            state = State(x + length * math.cos(along), y + length * math.sin(along), theta + angle, speed2, omega2)
        assert best <= travel_toward(v, turn, BODY, time) + 0.01

    def test_one_that_drives_off_fast_cannot_come_back_in_a_second(self) -> None:
        assert travel_toward(0.5, math.pi, BODY, 0.9) == 0.0

    def test_one_that_stands_and_faces_away_can_back_up(self) -> None:
        # 0.5 m/s^2 for 0.8 s, and 0.08 m to brake
        assert travel_toward(0.0, math.pi, BODY, 0.8) >= 0.24

    def test_one_that_drives_backwards_can(self) -> None:
        assert travel_toward(-0.3, math.pi, BODY, 0.5) > 0.15
