"""Stops and revisions that the base station has from the robots, because it never received them itself."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import pytest

from basestation.fleet.state_store import StateStore
from muro_zenoh.messages import MOST_NAMES, Health, Resume, SetCircle, Stop, StopOrder, decode, encode
from muro_zenoh.safety.stop import MAX_REVISION_GAP, StopLatch
from tests.support.kept_state import fresh, reports, scenario, stopped


@pytest.mark.parametrize("ahead", [0, 1, 7])
async def test_a_stop_to_everybody_is_adopted_from_a_robot(ahead: int) -> None:
    kept = fresh()
    revision = kept.stop.revision + ahead
    assert kept.adopt("r1", reports(True, revision, everybody=True))
    assert stopped(kept) == (True, ())
    assert kept.stop.revision > revision


async def test_a_stop_by_name_is_adopted_from_a_robot() -> None:
    kept = fresh()
    revision = kept.stop.revision
    assert kept.adopt("r1", reports(True, revision))
    assert kept.adopt("r2", reports(True, kept.stop.revision))
    assert stopped(kept) == (False, ("r1", "r2"))
    # They go on saying so; it is known now.
    assert not kept.adopt("r1", reports(True, kept.stop.revision))
    assert not kept.adopt("r1", reports(True, revision))


async def test_a_resume_of_one_is_not_undone_by_what_the_others_report() -> None:
    kept = fresh()
    latches = {name: StopLatch() for name in ("r1", "r2", "r3")}

    def publish() -> None:
        for name, latch in latches.items():
            order = kept.stop
            latches[name] = latch.receive(name, all_robots=order.all, names=order.names, revision=order.revision)

    publish()
    await kept.add_stop(Stop())
    publish()
    await kept.resume(Resume(revision=kept.stop.revision, names=("r1",)))
    publish()
    for name, latch in latches.items():
        assert not kept.adopt(name, reports(latch.stopped, latch.revision, latch.all_robots))
    assert stopped(kept) == (False, ("r2", "r3"))
    assert latches["r1"].may_drive


@pytest.mark.parametrize("latched", [1, 7, MAX_REVISION_GAP, MAX_REVISION_GAP + 1, 2**40, 2**53])
@pytest.mark.parametrize("heard_first", [True, False])
async def test_a_base_station_that_counts_from_1_again_lifts_no_stop_and_can_lift_it_by_a_resume(
    latched: int, heard_first: bool
) -> None:
    kept = fresh()
    latch = StopLatch().receive("r1", all_robots=True, names=(), revision=latched)

    def publish(latch: StopLatch) -> StopLatch:
        order = kept.stop
        return latch.receive("r1", all_robots=order.all, names=order.names, revision=order.revision)

    if not heard_first:
        latch = publish(latch)  # before it has heard the robot's health
        assert latch.stopped
    assert kept.adopt("r1", reports(latch.stopped, latch.revision, latch.all_robots))
    for _ in range(3):  # its own count may come near the robot's only by the first adoption
        latch = publish(latch)
        assert latch.stopped
        changed = kept.adopt("r1", reports(latch.stopped, latch.revision, latch.all_robots))
    assert not changed
    await kept.resume(Resume(revision=kept.stop.revision))
    assert publish(latch).may_drive


async def test_a_stop_that_was_kept_meanwhile_does_not_hide_one_that_a_robot_latched_before() -> None:
    kept = fresh()
    latched = kept.stop.revision
    await kept.add_stop(
        Stop(names=("r2",))
    )  # published before r1 has reported the operator's stop that it received itself
    assert kept.adopt("r1", reports(True, latched))
    assert stopped(kept) == (False, ("r1", "r2"))
    assert kept.stop.revision > latched + 1
    assert not kept.adopt("r1", reports(True, latched))
    assert not kept.adopt("r2", reports(True, latched + 1))


@pytest.mark.parametrize("restarted", [False, True])
async def test_a_stop_that_was_lifted_is_not_adopted_again(restarted: bool, tmp_path: Path) -> None:
    path = tmp_path / "state.json"
    kept = fresh(path)
    await kept.add_stop(Stop())
    old = kept.stop.revision
    await kept.resume(Resume(revision=old))
    if restarted:
        kept = fresh(path)
    assert not kept.adopt("r1", reports(True, old, everybody=True))
    assert not kept.adopt("r1", reports(True, old))
    assert stopped(kept) == (False, ())
    assert kept.adopt("r1", reports(True, kept.stop.revision))  # at this revision it was stopped since
    assert stopped(kept) == (False, ("r1",))


@pytest.mark.parametrize("restarted", [False, True])
async def test_a_stop_kept_since_the_resume_hides_no_other_one_over_a_restart_either(
    restarted: bool, tmp_path: Path
) -> None:
    """r1 received an operator's stop itself; before it reports that, r2 is stopped, and the base station restarts."""
    path = tmp_path / "state.json"
    kept = fresh(path)
    await kept.add_stop(Stop())
    await kept.resume(Resume(revision=kept.stop.revision))
    latched = kept.stop.revision
    await kept.add_stop(Stop(names=("r2",)))
    if restarted:
        kept = fresh(path)
    assert kept.adopt("r1", reports(True, latched))
    assert stopped(kept) == (False, ("r1", "r2"))


async def test_a_stop_latched_by_a_robot_that_received_no_state_is_adopted_whatever_was_lifted_before() -> None:
    """Its agent started while no base station ran, and `muro stop` could name no revision."""
    kept = fresh()
    await kept.add_stop(Stop())
    await kept.resume(Resume(revision=kept.stop.revision))
    assert kept.adopt("r1", reports(True, 0))
    assert stopped(kept) == (False, ("r1",))


async def test_a_stop_by_name_that_is_adopted_does_not_make_one_to_everybody_smaller() -> None:
    kept = fresh()
    await kept.add_stop(Stop())
    assert not kept.adopt("r1", reports(True, kept.stop.revision))
    assert stopped(kept) == (True, ())
    assert kept.adopt("r1", reports(True, kept.stop.revision + 3))
    assert stopped(kept) == (True, ())


@pytest.mark.parametrize("everybody", [False, True])
async def test_a_newer_revision_is_taken_over_with_a_stop_that_is_kept_already(everybody: bool) -> None:
    """Else no resume would be newer than what the robot knows."""
    kept = fresh()
    await kept.add_stop(Stop(names=() if everybody else ("r1",)))
    assert kept.adopt("r1", reports(True, 40, everybody))
    assert stopped(kept) == (everybody, () if everybody else ("r1",))
    assert kept.stop.revision == 40
    await kept.resume(Resume(revision=kept.stop.revision))
    latch = StopLatch(received=True, stopped=True, all_robots=everybody, revision=40)
    lifted = latch.receive("r1", all_robots=kept.stop.all, names=kept.stop.names, revision=kept.stop.revision)
    assert lifted.may_drive


async def test_a_change_of_the_circle_does_not_lift_a_stop_that_robots_received_straight_from_an_operator() -> None:
    kept = fresh()
    latched = kept.stop.revision  # the operator's order carries the revision that everybody had
    await kept.set_circle(SetCircle(radius=0.9))
    assert kept.stop.revision == latched  # at a tie the robots stay stopped
    assert kept.adopt("r1", reports(True, latched, everybody=True))
    assert stopped(kept) == (True, ())


async def test_a_robot_that_knows_a_newer_revision_is_caught_up_with() -> None:
    kept = fresh()
    assert kept.adopt("r1", reports(False, 40))
    assert kept.stop.revision == 40
    assert stopped(kept) == (False, ())
    await kept.add_stop(Stop())
    assert kept.stop.revision > 40
    await kept.resume(Resume(revision=kept.stop.revision))
    assert kept.stop.revision == kept.state.lifted_revision == 42


@pytest.mark.parametrize("revision", [0, 1, 7])
async def test_a_stop_of_another_robot_is_adopted_from_one_that_remembers_it(revision: int) -> None:
    """The other one's agent has restarted since, and has forgotten it."""
    kept = fresh()
    remembers = Health(role="agent", state="x", stop_names=("r1", "r3"), stop_revision=revision)
    assert kept.adopt("r1", reports(False, 0)) is None
    assert kept.adopt("r2", remembers)
    assert stopped(kept) == (False, ("r1", "r3"))
    assert kept.stop.revision > max(revision, 1)
    assert not kept.adopt("r2", remembers)  # it is known now


async def test_a_stop_of_another_robot_that_was_lifted_is_not_adopted_again() -> None:
    kept = fresh()
    await kept.add_stop(Stop(names=("r1",)))
    remembers = Health(role="agent", state="x", stop_names=("r1",), stop_revision=kept.stop.revision)
    await kept.resume(Resume(revision=kept.stop.revision))
    assert not kept.adopt("r2", remembers)
    assert stopped(kept) == (False, ())
    everybody = Health(role="agent", state="x", stop_latched=True, stop_all=True, stop_names=("r1",), stop_revision=3)
    assert kept.adopt("r2", everybody)
    assert stopped(kept) == (True, ("r1",))


@pytest.mark.parametrize("everybody", [False, True])
async def test_a_robot_that_missed_a_kept_stop_receives_it_at_a_newer_revision_than_it_knows(everybody: bool) -> None:
    """The file is older than the state that the robots heard last."""
    kept = fresh()
    await kept.add_stop(Stop(names=() if everybody else ("r1",)))
    assert kept.adopt("r2", reports(False, 40))
    if not everybody:
        assert kept.stop.revision == 40
        assert kept.adopt("r1", reports(False, 41))
    assert kept.stop.revision > 40 + (not everybody)
    assert stopped(kept) == (everybody, () if everybody else ("r1",))


@pytest.mark.parametrize("first", [None, (), ("r1",), ("r1", "r2")])
@pytest.mark.parametrize("second", [None, (), ("r1",), ("r3",)])
@pytest.mark.parametrize("ahead", [0, 1, 5])
async def test_two_base_stations_that_meet_agree_and_do_not_overtake_each_other_for_ever(
    first: tuple[str, ...] | None, second: tuple[str, ...] | None, ahead: int
) -> None:
    """The network was parted, and each half had one. Afterwards every robot hears both in turn."""
    both = [fresh(), fresh()]
    for kept, names in zip(both, (first, second), strict=True):
        if names is not None:
            await kept.add_stop(Stop(names=names))
    for _ in range(ahead):
        await both[0].resume(Resume(revision=both[0].stop.revision, names=("r2",)))
    latches = {name: StopLatch() for name in ("r1", "r2", "r3")}
    adoptions = 0

    def publish(kept: StateStore) -> None:
        order = kept.stop
        for name, latch in latches.items():
            latches[name] = latch.receive(name, all_robots=order.all, names=order.names, revision=order.revision)

    for _ in range(20):
        for kept in both:
            publish(kept)
            for name, latch in latches.items():
                for other in both:
                    if other.adopt(name, reports(latch.stopped, latch.revision, latch.all_robots)):
                        adoptions += 1
                        publish(other)
    assert adoptions <= 20
    assert both[0].stop.revision == both[1].stop.revision
    for name, latch in latches.items():
        assert latch.stopped == any(kept.stop.all or name in kept.stop.names for kept in both)
        assert latch.revision == both[0].stop.revision


async def test_a_robot_that_received_nothing_changes_nothing() -> None:
    kept = fresh()
    before = kept.state
    assert not kept.adopt("r1", reports(False, 0))
    assert kept.state == before


@pytest.mark.parametrize("absurd", [2**53 + 1, 2**64 - 1])
async def test_a_revision_that_no_count_can_reach_stops_but_is_not_adopted(absurd: int) -> None:
    kept = fresh()
    assert kept.adopt("r1", reports(True, absurd, everybody=True))
    assert stopped(kept) == (True, ())
    assert kept.stop.revision < 100
    assert not kept.adopt("r1", reports(True, absurd, everybody=True))
    await kept.resume(Resume(revision=absurd))
    assert stopped(kept) == (False, ())
    # It still goes over the wire.
    assert decode(encode(msgspec.structs.replace(kept.stop, stamp=1.0)), StopOrder).revision < 100


async def test_a_revision_that_robots_can_have_missed_is_adopted_and_one_of_another_count_is_not() -> None:
    kept = fresh()
    known = kept.stop.revision
    assert kept.adopt("r1", reports(False, known + 2**20)) is None
    assert kept.stop.revision == known
    assert kept.adopt("r1", reports(False, known + 2**20 - 1))
    assert kept.stop.revision == known + 2**20 - 1


async def test_a_count_that_begins_again_forgets_what_was_lifted(tmp_path: Path) -> None:
    """No robot accepts a revision above 2**53, so a state that has reached it is counted anew from 1."""
    path = tmp_path / "state.json"
    end = msgspec.structs.replace(fresh().state, revision=2**53, stop_revision=2**53, lifted_revision=2**53)
    path.write_bytes(msgspec.json.encode(end))
    kept = fresh(path)
    assert (kept.revision, kept.stop.revision) == (1, 1)
    # What a robot has latched since is newer than any resume of this count.
    assert kept.adopt("r1", reports(True, 1))
    assert kept.stop.names == ("r1",)


def test_a_count_goes_on_while_its_next_revision_is_accepted() -> None:
    nearly = msgspec.structs.replace(fresh().state, revision=2**53 - 1, stop_revision=2**53 - 1)
    assert nearly.fitted_to(scenario()) is nearly


def test_a_change_is_newer_than_all_that_was_changed_before() -> None:
    apart = msgspec.structs.replace(fresh().state, revision=3, stop_revision=9)
    assert apart.with_stop(("r1",), everybody=False).stop_revision == 10
    assert msgspec.structs.replace(apart, revision=12).with_stop((), everybody=True).stop_revision == 13


@pytest.mark.parametrize(
    "poison",
    [
        1,
        6,
        1000,
        MAX_REVISION_GAP - 1,
        MAX_REVISION_GAP,
        2 * MAX_REVISION_GAP,
        2**40,
        2**52,
        2**53 - 1,
        2**53,
        2**53 + 1,
        2**64 - 1,
    ],
)
@pytest.mark.parametrize("latched", [False, True])
@pytest.mark.parametrize("received", [False, True])
async def test_every_stop_can_be_lifted_whatever_revision_a_robot_has_received(
    poison: int, latched: bool, received: bool
) -> None:
    """Both sides as they talk: the robot receives what is kept, reports, and is adopted from; then one resume."""
    kept = fresh()
    robot = StopLatch()

    def talk() -> None:
        nonlocal robot
        for _ in range(3):
            kept.adopt("r1", reports(robot.stopped, max(robot.revision, 0), robot.all_robots))
            order = kept.stop
            robot = robot.receive("r1", all_robots=order.all, names=order.names, revision=order.revision)

    if received:  # one that has just started knows nothing, and believes the first that it receives
        talk()
    robot = robot.receive("r1", all_robots=latched, names=(), revision=poison)
    talk()
    await kept.add_stop(Stop(names=()))
    talk()
    assert robot.stopped
    await kept.resume(Resume(revision=kept.stop.revision))
    talk()
    assert robot.may_drive
    assert stopped(kept) == (False, ())
    assert kept.stop.revision <= 2 * MAX_REVISION_GAP


@pytest.mark.parametrize("revision", [2**53 - 1, 2**53, 2**53 + 1, 2**60])
async def test_a_file_with_a_revision_that_nobody_believes_is_counted_anew(tmp_path: Path, revision: int) -> None:
    path = tmp_path / "state.json"
    kept = fresh(path)
    await kept.add_stop(Stop(names=()))
    kept.close()
    state = json.loads(path.read_text())
    path.write_text(json.dumps({**state, "revision": revision, "stop_revision": revision}))
    kept = fresh(path)
    assert stopped(kept) == (True, ())
    robot = StopLatch().receive("r1", all_robots=True, names=(), revision=min(revision, 2**53))
    for order in (kept.stop, None):
        if order is None:
            await kept.resume(Resume(revision=kept.stop.revision))
            order = kept.stop
        robot = robot.receive("r1", all_robots=order.all, names=order.names, revision=order.revision)
    assert robot.may_drive
    kept.close()


async def test_more_stops_by_name_than_an_order_can_say_are_one_of_everybody() -> None:
    """Else no robot could read the stop state any more."""
    kept = fresh()
    names = tuple(f"x{number}" for number in range(MOST_NAMES))
    await kept.add_stop(Stop(names=names))
    assert stopped(kept) == (False, tuple(sorted(names)))
    order = msgspec.structs.replace(kept.stop, stamp=1.0)
    assert decode(encode(order), StopOrder).names == tuple(sorted(names))
    await kept.add_stop(Stop(names=("r1",)))
    assert stopped(kept) == (True, ())
    await kept.resume(Resume(revision=kept.stop.revision))
    assert stopped(kept) == (False, ())
