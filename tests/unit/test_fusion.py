"""Several cameras, one fix: hand-over, weights, a camera that was moved, and what is not believed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from basestation.localization.agreement import Agreement
from basestation.localization.belief import Belief, Reach
from basestation.localization.detector import TagDetector
from basestation.localization.floor_map import FloorMap
from basestation.localization.fusion import Fix, Fusion
from basestation.localization.localizer import Localizer
from basestation.localization.sightings import Sighting, Sightings
from basestation.localization.tracks import Track
from muro_zenoh.config import find_scenario
from muro_zenoh.config.cameras import camera_models
from muro_zenoh.geometry import Bounds, Pose2, TagMount, wrap_to_pi
from muro_zenoh.optics.camera_model import CameraModel, hung
from muro_zenoh.simulation.camera import OverheadCamera

ARENA = Bounds(-2.1, 2.1, -1.5, 1.5)
REACH = Reach(0.177, 0.5, 1.5)
COVARIANCE = (1e-7, 0.0, 0.0, 0.0, 1e-7, 0.0, 0.0, 0.0, 4e-6)
Way = Callable[[float], Pose2]


@dataclass
class Eye:
    """A camera that sees where robots are, with noise and an error of its own, to the left or right of a border."""

    name: str
    period: float
    latency: float
    right: bool
    bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    noise: float = 0.0003
    phase: float = 0.0
    bumped: tuple[float, float, float] = (0.0, 0.0, 0.0)
    bumped_at: float = math.inf
    bump_takes: float = 0.0
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(7))

    def inside(self, x: float) -> float:
        """It sees 0.4 m beyond the border; within 0.25 m of the edge its weight falls to nothing."""
        return min(max(((x + 0.4) if self.right else (0.4 - x)) / 0.25, -1.0), 1.0)

    def look(self, t: float, ways: dict[str, Way]) -> Sightings:
        robots = []
        for name, way in ways.items():
            x, y, theta = way(t)
            inside = self.inside(x)
            if inside < 0.0:
                continue
            part = float(t >= self.bumped_at)
            if self.bump_takes:
                part = min(max((t - self.bumped_at) / self.bump_takes, 0.0), 1.0)
            dx, dy, turn = np.add(self.bias, np.multiply(part, self.bumped)).tolist()
            nx, ny, nt = (self.rng.normal(0.0, (self.noise, self.noise, 0.002))).tolist()
            pose = Pose2(x + dx + nx, y + dy + ny, wrap_to_pi(theta + turn + nt))
            robots.append(Sighting(name, pose, COVARIANCE, inside))
        return Sightings(camera=self.name, captured=t, robots=tuple(robots))


def frames(eyes: list[Eye], seconds: float) -> Iterator[tuple[float, Eye, float]]:
    """Arrival time, camera and capture time of all frames, in the order in which they arrive."""
    arrivals = [
        (eye.phase + k * eye.period + eye.latency, i, eye.phase + k * eye.period)
        for i, eye in enumerate(eyes)
        for k in range(int(seconds / eye.period))
    ]
    for now, i, captured in sorted(arrivals):
        yield now, eyes[i], captured


def fixes_of(eyes: list[Eye], ways: dict[str, Way], seconds: float) -> tuple[Fusion, list[tuple[float, str, Fix]]]:
    fusion = Fusion(ARENA, dict.fromkeys(ways, REACH))
    given = []
    for now, eye, captured in frames(eyes, seconds):
        given += [(captured, eye.name, fix) for fix in fusion.take(eye.look(captured, ways), now)]
    return fusion, given


def west() -> Eye:
    return Eye("west", 0.05, 0.05, right=False, bias=(0.0012, -0.0008, 0.001))


def east() -> Eye:
    return Eye("east", 1 / 15, 0.08, right=True, bias=(-0.001, 0.001, -0.001), phase=0.013)


def to_and_fro(t: float) -> Pose2:
    """Along x through the border, 0.4 m/s at most, turning a little."""
    return Pose2(0.8 * math.sin(0.5 * t), 0.2 * math.sin(0.31 * t), 0.3 * math.sin(0.7 * t))


class TestHandOver:
    def test_there_is_no_jump_and_one_fix_at_a_time(self) -> None:
        """Two cameras 3 mm apart, with other rates and latencies: the error never steps by 5 mm."""
        _, given = fixes_of([west(), east()], {"r1": to_and_fro}, 120.0)
        times = np.array([t for t, _, _ in given])
        errors = np.array([np.subtract(fix.pose[:2], to_and_fro(t)[:2]) for t, _, fix in given])
        steps = np.hypot(*np.diff(errors, axis=0).T)
        assert {camera for _, camera, _ in given} == {"west", "east"}
        assert np.quantile(steps, 0.99) < 0.003
        assert steps.max() < 0.005
        assert np.hypot(*errors.T).max() < 0.004
        assert np.diff(times).min() > 0.0, "in order of capture"
        assert np.diff(times).max() < 0.12
        assert len(given) < 120 * 21, "not a fix per camera"

    def test_a_robot_is_handed_over_bit_by_bit(self) -> None:
        """Cameras that are 5 mm apart, without noise: no step is a third of that, once both have seen it."""
        a, b = west(), east()
        a.noise = b.noise = 0.0
        a.bias, b.bias = (0.0025, 0.0, 0.0), (-0.0025, 0.0, 0.0)
        _, given = fixes_of([a, b], {"r1": to_and_fro}, 60.0)
        errors = [fix.pose.x - to_and_fro(t).x for t, _, fix in given if t > 1.0]
        assert np.ptp(errors) > 0.004
        assert np.abs(np.diff(errors)).max() < 0.0016

    def test_without_the_other_cameras_weight_it_would_jump(self) -> None:
        """The test above can fail: the two cameras' own sightings are apart by the difference of their errors."""
        a, b = west(), east()
        _, given = fixes_of([a], {"r1": to_and_fro}, 30.0)
        _, others = fixes_of([b], {"r1": to_and_fro}, 30.0)
        mean = [np.mean([np.subtract(f.pose[:2], to_and_fro(t)[:2]) for t, _, f in g], axis=0) for g in (given, others)]
        assert np.hypot(*(mean[0] - mean[1])) > 0.0025

    def test_both_weigh_in_by_their_covariance(self) -> None:
        def still(t: float) -> Pose2:
            return Pose2(0.0, 0.5, 1.0)

        a, b = west(), east()
        a.bias, b.bias = (0.0, 0.0, 0.0), (0.003, 0.0, 0.01)
        a.noise = b.noise = 0.0
        _, given = fixes_of([a, b], {"r1": still}, 2.0)
        _, _, fix = given[-1]
        assert fix.pose.x == pytest.approx(0.0015, abs=2e-4)
        assert fix.pose.theta == pytest.approx(1.005, abs=2e-3)
        assert fix.covariance[0] == pytest.approx(0.5 * COVARIANCE[0], rel=0.05)

    def test_the_quicker_camera_leads_where_both_see_well(self) -> None:
        def still(t: float) -> Pose2:
            return Pose2(0.0, 0.5, 1.0)

        slow, quick = west(), east()
        slow.latency, quick.latency = 0.15, 0.05
        _, given = fixes_of([slow, quick], {"r1": still}, 4.0)
        assert {camera for t, camera, _ in given if t > 1.0} == {"east"}

    def test_a_camera_that_stops_is_followed_by_the_other_within_two_frames(self) -> None:
        def still(t: float) -> Pose2:
            return Pose2(0.0, 0.5, 1.0)

        a, b = west(), east()
        fusion = Fusion(ARENA, {"r1": REACH})
        given = []
        for now, eye, captured in frames([a, b], 4.0):
            if eye is a and captured > 2.0:
                continue
            given += [captured for _ in fusion.take(eye.look(captured, {"r1": still}), now)]
        assert np.diff(given).max() < 0.2
        assert max(given) > 3.8


class TestAMovedCamera:
    """0.3 degrees at 3 m are 16 mm on the floor."""

    @staticmethod
    def round_about(phase: float) -> Way:
        return lambda t: Pose2(0.3 * math.cos(0.8 * t + phase), 0.9 * math.sin(0.5 * t + phase), wrap_to_pi(0.8 * t))

    @staticmethod
    def circling(number: int) -> Way:
        """As wheels drive: forwards, along a circle."""

        def way(t: float) -> Pose2:
            angle = 0.8 * t + 1.7 * number
            place = (0.2 * math.cos(angle), 0.5 * number - 0.75 + 0.2 * math.sin(angle))
            return Pose2(*place, wrap_to_pi(angle + 0.5 * math.pi))

        return way

    @pytest.mark.parametrize("which", ["west", "east"])
    def test_it_is_named_within_two_seconds_and_weighs_less(self, which: str) -> None:
        eyes = [west(), east()]
        bumped = next(eye for eye in eyes if eye.name == which)
        bumped.bumped, bumped.bumped_at = (0.012, 0.010, 0.002), 5.0
        ways = {f"r{i}": self.round_about(1.7 * i) for i in range(3)}
        fusion = Fusion(ARENA, dict.fromkeys(ways, REACH))
        named, errors = math.inf, []
        for now, eye, captured in frames(eyes, 12.0):
            for fix in fusion.take(eye.look(captured, ways), now):
                if captured > 8.0:
                    errors.append(math.dist(fix.pose[:2], ways[fix.name](captured)[:2]))
            if fusion.moved:
                named = min(named, captured)
                assert set(fusion.moved) == {which}
            assert captured >= 5.0 or not fusion.moved
        assert named - 5.0 < 2.0
        assert "was it moved? Calibrate it anew" in fusion.moved[which]
        # Where the other camera sees the robot well it decides.
        assert np.median(errors) < 0.005

    @pytest.mark.parametrize("which", ["west", "east"])
    def test_one_that_was_moved_far_is_named_and_the_good_one_goes_on_being_believed(self, which: str) -> None:
        """By 3 degrees: its robots are not believed, so that nothing but what is not believed shows it.

        One robot drives to and fro between the cameras: where the bumped one alone has seen it, the good one must be
        believed again.
        """
        eyes = [west(), east()]
        bumped = next(eye for eye in eyes if eye.name == which)
        good = next(eye for eye in eyes if eye.name != which)
        bumped.bumped, bumped.bumped_at = (0.12, 0.10, 0.05), 5.0
        ways = {"r1": self.round_about(0.0), "r2": self.round_about(1.7), "r3": to_and_fro}
        fusion = Fusion(ARENA, dict.fromkeys(ways, REACH))
        named, errors, doubted = math.inf, [], 0
        for now, eye, captured in frames(eyes, 40.0):
            fixes = fusion.take(eye.look(captured, ways), now)
            if captured > 8.0:
                errors += [
                    math.dist(fix.pose[:2], ways[fix.name](captured)[:2])
                    for fix in fixes
                    if good.inside(ways[fix.name](captured).x) > 0.5
                ]
                doubted += any(camera == good.name and t > 8.0 for (camera, _), (_, t) in fusion.doubts.items())
            if fusion.moved:
                named = min(named, captured)
                assert set(fusion.moved) == {which}
        assert named - 5.0 < 2.0
        assert set(fusion.moved) == {which}
        assert len(errors) > 1000
        assert max(errors) < 0.005
        assert not doubted

    @pytest.mark.parametrize("which", ["west", "east"])
    def test_one_that_moved_over_several_frames_is_named_alone(self, which: str) -> None:
        eyes = [west(), east()]
        bumped = next(eye for eye in eyes if eye.name == which)
        bumped.bumped, bumped.bumped_at, bumped.bump_takes = (0.012, 0.010, 0.002), 5.0, 0.2
        fusion, _ = fixes_of(eyes, {f"r{i}": self.circling(i) for i in range(4)}, 9.0)
        assert set(fusion.moved) == {which}

    @pytest.mark.parametrize(("jump", "blamed"), [(1.0, {"east", "west"}), (7.5, {"east"}), (15.0, {"east", "west"})])
    def test_only_a_jump_about_when_the_cameras_began_to_disagree_is_blamed(
        self, jump: float, blamed: set[str]
    ) -> None:
        """They agree until 8 s; what jumped long before, or long after, was something else."""
        agreement, here = Agreement(), Pose2(0.0, 0.0, 0.0)
        for k in range(400):
            t = 0.05 * k
            if abs(t - jump) < 0.01:
                assert agreement.jumped("east", [(0.016, 0.0), (0.015, 0.0)], t)
            agreement.compare("west", "east", here, Pose2(0.016 * (t >= 8.0), 0.0, 0.0), t)
            agreement.judge(t)
        assert set(agreement.moved) == blamed

    def test_a_second_print_of_one_robots_tag_is_no_camera_that_moved(self) -> None:
        fusion = Fusion(ARENA, dict.fromkeys(("r1", "r2"), REACH))
        for k in range(200):
            t = 0.025 * k
            there = (Pose2(0.0, 0.5, 0.0), Pose2(0.2, 0.4, 0.3))[k % 2]
            robots = (Sighting("r1", there, COVARIANCE),)
            fusion.take(Sightings(camera=("west", "east")[k % 2], captured=t, robots=robots), t)
            assert not fusion.moved
        assert fusion.disbelieved == 100

    def test_its_jump_is_no_motion_of_the_robots(self) -> None:
        """Taken for their speed, it would count twice in the next fixes."""

        def still(t: float) -> Pose2:
            return Pose2(0.0, 0.5, 1.0)

        eyes = [west(), east()]
        for eye in eyes:
            eye.noise, eye.bias = 0.0, (0.0, 0.0, 0.0)
        eyes[1].bumped, eyes[1].bumped_at = (0.016, 0.0, 0.0), 2.0
        _, given = fixes_of(eyes, {"r1": still}, 4.0)
        assert max(math.dist(fix.pose[:2], (0.0, 0.5)) for _, _, fix in given) < 0.0085

    def test_where_it_alone_sees_a_robot_the_fix_is_as_uncertain_as_the_camera(self) -> None:
        ways = {"r1": self.round_about(0.0), "r2": lambda t: Pose2(1.5, 0.0, 0.0)}
        eyes = [west(), east()]
        eyes[1].bumped, eyes[1].bumped_at = (0.012, 0.010, 0.0), 2.0
        fusion, given = fixes_of(eyes, ways, 6.0)
        assert set(fusion.moved) == {"east"}
        alone = {t: fix.covariance for t, _, fix in given if fix.name == "r2"}
        assert all(covariance[0] == COVARIANCE[0] for t, covariance in alone.items() if t < 2.0)
        assert all(covariance[0] > 9e-5 < covariance[4] for t, covariance in alone.items() if t > 4.5)

    def test_where_both_may_have_been_moved_the_fix_of_both_is_uncertain_too(self) -> None:
        """Half of each: 10 mm and 0.3 degrees are 7 mm and 0.2 degrees then, and not the noise of the corners."""

        def still(t: float) -> Pose2:
            return Pose2(0.0, 0.5, 1.0)

        eyes = [west(), east()]
        eyes[0].bias = (0.012, 0.010, 0.0)
        fusion, given = fixes_of(eyes, {"r1": still}, 4.0)
        assert set(fusion.moved) == {"west", "east"}
        _, _, fix = given[-1]
        assert len(fix.cameras) == 2
        assert 0.006 < math.sqrt(fix.covariance[0]) < 0.012
        assert math.sqrt(fix.covariance[4]) == pytest.approx(math.sqrt(fix.covariance[0]), rel=0.01)
        assert math.radians(0.2) < math.sqrt(fix.covariance[8]) < math.radians(0.4)

    def test_robots_that_are_pushed_apart_are_no_camera_that_moved(self) -> None:
        agreement = Agreement()
        assert agreement.jumped("north", [(0.02, 0.001), (0.021, 0.0), (0.02, -0.001)], 1.0)
        assert not agreement.jumped("north", [(0.02, 0.0), (0.021, 0.05), (0.0, -0.05)], 1.0)
        assert not agreement.jumped("north", [(0.006, 0.0)], 1.0), "one robot may brake hard"
        assert not agreement.jumped("north", [], 1.0)

    def test_robots_that_all_stop_at_once_are_soon_seen_to_stand(self) -> None:
        """Their speeds would otherwise be what they were for ever: each frame would be a jump."""
        fusion = Fusion(ARENA, {"r1": REACH, "r2": REACH})
        for k in range(40):
            x = 0.4 * min(0.05 * k, 1.0)
            robots = tuple(Sighting(f"r{i}", Pose2(x, 0.5 * i, 0.0), COVARIANCE) for i in (1, 2))
            (first, _) = fusion.take(Sightings(camera="west", captured=0.05 * k, robots=robots), 0.05 * k)
            seen = Sighting("r1", Pose2(x, 0.5, 0.0), COVARIANCE)
            fusion.take(Sightings(camera="east", captured=0.05 * k + 0.03, robots=(seen,)), 0.05 * k + 0.03)
        assert first.pose.x == pytest.approx(0.4, abs=1e-6)
        assert not fusion.moved

    def test_one_that_was_moved_before_the_start_is_one_of_two(self) -> None:
        eyes = [west(), east()]
        eyes[0].bias = (0.012, 0.010, 0.0)
        fusion, _ = fixes_of(eyes, {"r1": self.round_about(0.0), "r2": self.round_about(2.0)}, 4.0)
        assert set(fusion.moved) == {"west", "east"}

    def test_a_single_camera_is_named_by_the_tags_on_the_floor(self) -> None:
        """Seen in whole pictures, twice a second; four of them, of which one was kicked away before."""
        fusion, named = Fusion(ARENA, {"r1": REACH}), math.inf
        for k in range(200):
            t = 0.05 * k
            shift = 0.012 if t >= 5.0 else 0.001
            tags = ((shift, shift), (shift, 0.0), (0.0, shift), (0.3, 0.2)) if k % 10 == 0 else ()
            fusion.take(Sightings(camera="west", captured=t, floor_off=tags), t + 0.05)
            if fusion.moved:
                named = min(named, t)
            assert t >= 5.0 or not fusion.moved
        assert named - 5.0 < 2.0
        assert fusion.moved["west"] == (
            "camera west sees the floor tags 12 mm off their places: was it moved? Calibrate it anew"
        )
        seen = Sighting("r1", Pose2(1.0, 0.0, 0.0), COVARIANCE)
        (fix,) = fusion.take(Sightings(camera="west", captured=10.0, robots=(seen,)), 10.05)
        assert fix.covariance[0] > 9e-5, "and its fixes are as uncertain as it is"

    def test_one_of_two_floor_tags_that_was_kicked_away_is_no_camera_that_moved(self) -> None:
        fusion = Fusion(ARENA, {"r1": REACH})
        for k in range(20):
            fusion.take(Sightings(camera="west", captured=0.5 * k, floor_off=((0.0, 0.0), (0.3, 0.2))), 0.5 * k)
        assert not fusion.moved

    def test_of_two_cameras_the_floor_says_which(self) -> None:
        eyes = [west(), east()]
        eyes[0].bias = (0.012, 0.010, 0.0)  # since before the start: no jump was seen
        ways = {"r1": self.round_about(0.0), "r2": self.round_about(2.0)}
        fusion = Fusion(ARENA, dict.fromkeys(ways, REACH))
        for now, eye, captured in frames(eyes, 4.0):
            off = (eye.bias[:2],) * 4
            fusion.take(replace(eye.look(captured, ways), floor_off=off), now)
        assert set(fusion.moved) == {"west"}

    def test_cameras_as_good_as_ours_agree(self) -> None:
        ways = {f"r{i}": self.round_about(1.1 * i) for i in range(5)}
        fusion, _ = fixes_of([west(), east()], ways, 30.0)
        assert not fusion.moved
        assert fusion.disbelieved == 0


class TestBelief:
    def belief(self) -> Belief:
        return Belief(ARENA, {"r1": REACH})

    def test_outside_the_arena_is_nobody(self) -> None:
        belief = self.belief()
        assert belief.doubt("r1", "north", Pose2(2.2, 0.0, 0.0), 1.0) == ""
        doubt = belief.doubt("r1", "north", Pose2(2.3, 0.0, 0.0), 1.05)
        assert doubt == "camera north sees r1 at 2.30, 0.00 m, outside the arena"

    def test_a_robot_can_drive_and_turn_but_not_jump(self) -> None:
        for pose, believed in (
            (Pose2(0.08, 0.0, 0.0), True),
            (Pose2(0.10, 0.0, 0.0), False),
            (Pose2(0.0, 0.0, 0.45), True),
            (Pose2(0.0, 0.0, 0.50), False),
        ):
            belief = self.belief()
            belief.doubt("r1", "north", Pose2(0.0, 0.0, 0.0), 1.0)
            assert (belief.doubt("r1", "north", pose, 1.05) == "") == believed
        assert "0.50 m from where it was 0.05 s before" in belief.doubt("r1", "north", Pose2(0.5, 0.0, 0.0), 1.05)

    def test_a_robot_that_was_hidden_may_be_farther_away(self) -> None:
        belief = self.belief()
        belief.doubt("r1", "north", Pose2(0.0, 0.0, 0.0), 1.0)
        assert belief.doubt("r1", "north", Pose2(0.7, 0.0, 1.0), 2.0) == ""

    def test_a_reflection_beside_the_robot_is_never_believed(self) -> None:
        """The robot is seen by one camera, its reflection by another one, for a minute."""
        belief = self.belief()
        for k in range(1200):
            t = 0.05 * k
            assert belief.doubt("r1", "north", Pose2(0.0, 0.0, 0.0), t) == ""
            assert belief.doubt("r1", "south", Pose2(1.0, 0.0, 0.0), t + 0.02) != ""

    FAR = Pose2(1.5, 0.0, 0.0)
    """Too far from HOME to be reached in two seconds."""
    HOME = Pose2(-1.5, 0.0, 0.0)

    def test_flashes_here_and_there_are_never_believed(self) -> None:
        """The robot is hidden, and something is seen in another place each time, for longer than a second."""
        belief = self.belief()
        belief.doubt("r1", "north", self.HOME, 0.0)
        for k in range(1, 40):
            place = Pose2(1.5, 1.2 * (-1.0) ** k, 0.0)
            assert belief.doubt("r1", "north", place, 0.05 * k) != ""

    def test_two_short_rows_of_sightings_elsewhere_are_no_long_one(self) -> None:
        belief = self.belief()
        belief.doubt("r1", "north", self.HOME, 0.0)
        for t in (0.05, 0.25, 0.5, 1.2, 1.4, 1.6):  # nothing for 0.7 s in between
            assert belief.doubt("r1", "north", self.FAR, t) != ""

    def test_a_reflection_in_another_camera_does_not_keep_a_carried_robot_out(self) -> None:
        belief = self.belief()
        belief.doubt("r1", "north", self.HOME, 0.0)
        believed = []
        for k in range(1, 30):
            believed.append(belief.doubt("r1", "north", self.FAR, 0.05 * k) == "")
            belief.doubt("r1", "south", Pose2(1.5, 1.2, 0.0), 0.05 * k + 0.02)
        assert believed == [False] * 20 + [True] * 9

    def test_an_older_sighting_does_not_take_the_place_of_a_newer_one(self) -> None:
        belief = self.belief()
        belief.doubt("r1", "north", Pose2(0.0, 0.0, 0.0), 2.0)
        assert belief.doubt("r1", "south", Pose2(0.4, 0.0, 0.0), 1.0) == ""
        assert belief.doubt("r1", "north", Pose2(0.5, 0.0, 0.0), 2.05) != ""

    def test_a_robot_that_was_carried_is_believed_after_a_second(self) -> None:
        belief = self.belief()
        for k in range(20):
            belief.doubt("r1", "north", Pose2(0.0, 0.0, 0.0), 0.05 * k)
        away = [Pose2(1.5, 0.5 + 0.01 * k, 2.0) for k in range(40)]
        believed = [belief.doubt("r1", "north", pose, 1.0 + 0.05 * k) == "" for k, pose in enumerate(away)]
        assert believed == [False] * 20 + [True] * 20

    def test_forgotten_it_may_be_anywhere(self) -> None:
        belief = self.belief()
        belief.doubt("r1", "north", Pose2(0.0, 0.0, 0.0), 1.0)
        belief.forget("r1")
        assert belief.doubt("r1", "north", Pose2(1.5, 0.5, 2.0), 1.05) == ""

    def test_the_fusion_counts_and_keeps_the_reason(self) -> None:
        fusion = Fusion(ARENA, {"r1": REACH})
        for t, x in ((1.0, 0.0), (1.05, 1.0)):
            sighting = Sighting("r1", Pose2(x, 0.0, 0.0), COVARIANCE)
            fixes = fusion.take(Sightings(camera="north", captured=t, robots=(sighting,)), t + 0.05)
            assert len(fixes) == (t == 1.0)
        assert fusion.disbelieved == 1
        (text, captured) = fusion.doubts["north", "r1"]
        assert text.endswith("0.05 s before: not believed")
        assert captured == 1.05


def test_a_track_goes_on_along_its_arc() -> None:
    def way(t: float) -> Pose2:
        return Pose2(math.sin(0.8 * t), 1.0 - math.cos(0.8 * t), 0.8 * t)

    track = Track(Sighting("r1", way(0.0), COVARIANCE), 0.0)
    assert track.at(0.1) is None
    track.add(Sighting("r1", way(0.05), COVARIANCE), 0.05)
    for t in (0.0, 0.06, 0.1, 0.2):
        assert track.at(t) == pytest.approx(way(t), abs=2e-4)
    track.add(Sighting("r1", way(0.6), COVARIANCE), 0.6)
    assert track.at(0.65) is None, "too long ago for a speed"


class TestWithPictures:
    """Two rendered cameras with lenses, one of which is bumped by 0.3 degrees."""

    @staticmethod
    def model(x: float) -> CameraModel:
        lens = (-0.1, 0.02, 4e-4, -3e-4, 0.0)
        at = (x, 0.0, 3.0)
        return hung(960, 540, position=at, heading=math.pi / 2, fov=1.06, distortion=lens)

    def test_a_bump_is_named_and_a_crossing_does_not_jump(self) -> None:
        models = {"west": self.model(-0.6), "east": self.model(0.6)}
        mounts = [TagMount(i, 0.16, x=-0.03, y=0.02, yaw=0.3, z=0.15) for i in range(3)]
        tags = {mount.id: (f"r{mount.id}", mount) for mount in mounts}
        finders = {name: Localizer(name, FloorMap(model), TagDetector(), tags) for name, model in models.items()}
        eyes = {name: OverheadCamera(model, exposure=0.005, shade=0.3) for name, model in models.items()}
        bumped = OverheadCamera(models["east"].moved((math.radians(0.3), 0.0, 0.0)), exposure=0.005, shade=0.3)
        rng = np.random.default_rng(1)
        fusion = Fusion(ARENA, {f"r{i}": REACH for i in range(3)})
        named, errors = math.inf, []
        for k in range(200):
            name, t = ("west", "east")[k % 2], 0.025 * k
            poses = np.array(
                [[0.5 * math.cos(0.7 * t + 2.1 * i), 0.9 * math.sin(0.45 * t + 2.1 * i), 0.7 * t] for i in range(3)]
            )
            eye = bumped if name == "east" and t >= 3.0 else eyes[name]
            picture = eye.render(poses, mounts, [0.177] * 3, rng)
            seen = Sightings(camera=name, captured=t, robots=tuple(finders[name].locate(picture)))
            for fix in fusion.take(seen, t + 0.05):
                if t < 3.0:
                    errors.append(np.subtract(fix.pose[:2], poses[int(fix.name[1:])][:2]))
            if fusion.moved:
                named = min(named, t)
        assert set(fusion.moved) == {"east"}
        assert 0.0 < named - 3.0 < 2.0
        assert np.quantile(np.hypot(*np.transpose(errors)), 0.95) < 0.002

    def test_a_robot_that_leaves_a_picture_makes_no_camera_look_moved(self) -> None:
        """A tag that the picture's edge cuts off can still be read, and is 7 degrees and 14 mm off then.

        Within a second and a half the robot is seen by both for less and less, and worse and worse.
        """
        scenario = find_scenario("pursuit", robots=10)
        models = camera_models(scenario.camera, scenario.arena)
        robot = scenario.robot["r1"]
        finders = {
            name: Localizer(name, FloorMap(model), TagDetector(), {robot.mount.id: ("r1", robot.mount)})
            for name, model in models.items()
        }
        eyes = {name: OverheadCamera(model, exposure=0.005, shade=0.3) for name, model in models.items()}
        rng = np.random.default_rng(1)
        for start in (0.40, 0.42, 0.44):
            fusion = Fusion(scenario.arena, {"r1": REACH})
            for k in range(120):
                name, t = tuple(models)[k % 2], 0.025 * k
                pose = Pose2(1.944 - 0.012 * t, start + 0.1 * t, 1.65)
                picture = eyes[name].render(np.array([pose]), [robot.mount], [robot.radius], rng)
                robots = tuple(finders[name].locate(picture))
                for sighting in robots:
                    assert math.dist(sighting.pose[:2], pose[:2]) < 0.004
                    assert abs(wrap_to_pi(sighting.pose.theta - pose.theta)) < math.radians(1.5)
                fusion.take(Sightings(camera=name, captured=t, robots=robots), t + 0.05)
                assert not fusion.moved
