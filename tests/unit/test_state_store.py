"""The kept state of the lab: orders, revisions, the file, and stops that were given while no base station ran."""

from __future__ import annotations

import asyncio
import json
import os
import threading
from pathlib import Path

import msgspec
import pytest

from basestation.fleet.kept_state import KeptState
from basestation.fleet.state_file import StateFile
from basestation.fleet.state_store import StateStore
from muro_zenoh.config import Scenario, parse_scenario
from muro_zenoh.errors import ConfigError, OrderRefused
from muro_zenoh.messages import Health, Resume, SetBehaviour, SetCircle, Stop, StopOrder, decode, encode
from muro_zenoh.safety.stop import MAX_REVISION_GAP, StopLatch
from tests.support.waiting import seconds


def scenario(robots: int = 3, **behaviour: object) -> Scenario:
    table = {"robots": robots, "behaviour": {"name": "pursuit", "cruise": 0.15, **behaviour}}
    return parse_scenario(table, "lab.toml", name="lab")


def fresh(path: Path | None = None, robots: int = 3) -> StateStore:
    return StateStore(scenario(robots), path)


def files_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def stopped(kept: StateStore) -> tuple[bool, tuple[str, ...]]:
    return kept.stop.all, kept.stop.names


def reports(latched: bool, revision: int, everybody: bool = False) -> Health:
    return Health(role="agent", state="x", stop_latched=latched, stop_all=everybody, stop_revision=revision)


# ---- the start


async def test_it_begins_as_the_scenario_says() -> None:
    kept = fresh()
    assert (kept.circle.x, kept.circle.y, kept.circle.radius, kept.circle.clockwise) == (0.0, 0.0, 0.8, False)
    assert kept.behaviour("r2").behaviour == "pursuit"
    assert kept.behaviour("r2").parameters == {"cruise": 0.15}
    assert stopped(kept) == (False, ())
    assert kept.stop.revision > 0


# ---- the circle


async def test_a_kept_circle_that_does_not_fit_a_smaller_arena_is_not_used(tmp_path: Path) -> None:
    path = tmp_path / "state.json"
    await fresh(path).set_circle(SetCircle(radius=1.2))
    assert fresh(path).circle.radius == 1.2
    table = {"robots": 3, "arena": {"y_min": -1.1, "y_max": 1.1}, "circle": {"radius": 0.7}}
    assert StateStore(parse_scenario(table, "lab.toml", name="lab"), path).circle.radius == 0.7


@pytest.mark.parametrize(
    ("order", "expected"),
    [
        (SetCircle(radius=0.9), (0.0, 0.0, 0.9, False)),
        (SetCircle(clockwise=True), (0.0, 0.0, 0.8, True)),
        (SetCircle(x=0.5), (0.5, 0.0, 0.8, False)),
        (SetCircle(y=-0.3), (0.0, -0.3, 0.8, False)),
        (SetCircle(), (0.0, 0.0, 0.8, False)),
    ],
)
async def test_a_circle_order_changes_what_it_names(order: SetCircle, expected: tuple[object, ...]) -> None:
    kept = fresh()
    before = kept.state.revision
    await kept.set_circle(order)
    assert kept.revision == kept.circle.revision == before + 1
    c = kept.circle
    assert (c.x, c.y, c.radius, c.clockwise) == expected


@pytest.mark.parametrize(
    "order", [SetCircle(radius=1.4), SetCircle(x=1.5), SetCircle(y=-9.0), SetCircle(x=1e12), SetCircle(radius=1e12)]
)
async def test_a_circle_that_leaves_the_arena_is_refused(order: SetCircle) -> None:
    kept = fresh()
    before = kept.state
    with pytest.raises(OrderRefused, match="stay inside the arena"):
        await kept.set_circle(order)
    assert kept.state == before


async def test_a_refusal_says_how_large_a_circle_may_be() -> None:
    with pytest.raises(OrderRefused, match=r"expected at most 1\.323 m"):  # 1.5 m to the wall less a body of 0.177 m
        await fresh().set_circle(SetCircle(radius=1.4))


async def test_a_circle_on_which_the_fleet_would_touch_is_refused() -> None:
    """Three robots of 0.177 m radius touch on a circle below 0.2044 m; two do not."""
    with pytest.raises(OrderRefused, match=r"^circle\.radius: got 3 robots on a circle of 0\.2 m"):
        await fresh().set_circle(SetCircle(radius=0.2))
    await fresh(robots=2).set_circle(SetCircle(radius=0.2))
    kept = fresh()
    await kept.set_behaviour(SetBehaviour(behaviour="hold", names=("r2",)))
    await kept.set_circle(SetCircle(radius=0.2))  # the one between them does not pursue
    with pytest.raises(OrderRefused, match=r"^circle\.radius: got 3 robots"):
        await kept.set_behaviour(SetBehaviour(behaviour="pursuit", parameters={"cruise": 0.15}, names=("r2",)))


async def test_robots_that_pursue_since_different_orders_share_the_circle_all_the_same() -> None:
    kept = fresh()
    for name in ("r1", "r2", "r3"):
        await kept.set_behaviour(SetBehaviour(behaviour="pursuit", names=(name,)))
    with pytest.raises(OrderRefused, match="got 3 robots on a circle"):
        await kept.set_circle(SetCircle(radius=0.2))


# ---- the behaviours


@pytest.mark.parametrize("known", [0, 1, 2])
async def test_each_robot_begins_with_its_own_goals(known: int, tmp_path: Path) -> None:
    """Also one that the file, kept for a smaller fleet, does not know."""
    goals = {"r1": [[0.5, 0.1]], "r2": [[-0.5, 0.2]]}

    def lab(robots: int) -> Scenario:
        table = {
            "robots": robots,
            "behaviour": {"name": "dubins"},
            "goals": {f"r{i + 1}": goals[f"r{i + 1}"] for i in range(robots)},
        }
        return parse_scenario(table, "lab.toml", name="lab")

    path = tmp_path / "state.json"
    if known:
        await StateStore(lab(known), path).set_circle(SetCircle(radius=0.7))
    kept = StateStore(lab(2), path)
    assert kept.behaviour("r1").parameters == {"goals": ((0.5, 0.1),)}
    assert kept.behaviour("r2").parameters == {"goals": ((-0.5, 0.2),)}


async def test_a_behaviour_carries_the_revision_at_which_it_was_ordered() -> None:
    kept = fresh()
    assert kept.behaviour("r1").revision == 0
    await kept.set_behaviour(SetBehaviour(behaviour="hold", names=("r1",)))
    ordered = kept.revision
    await kept.set_circle(SetCircle(radius=0.7))
    assert [kept.behaviour(name).revision for name in ("r1", "r2")] == [ordered, 0]


async def test_a_behaviour_order_changes_those_it_names() -> None:
    kept = fresh()
    await kept.set_behaviour(SetBehaviour(behaviour="circle", parameters={"speed": 0.1}, names=("r1", "r3")))
    assert [kept.behaviour(name).behaviour for name in ("r1", "r2", "r3")] == ["circle", "pursuit", "circle"]
    assert kept.behaviour("r1").parameters == {"speed": 0.1}


async def test_a_behaviour_order_without_names_is_for_everybody() -> None:
    kept = fresh()
    await kept.set_behaviour(SetBehaviour(behaviour="hold"))
    assert {kept.behaviour(name).behaviour for name in ("r1", "r2", "r3")} == {"hold"}


async def test_a_behaviour_has_the_revision_of_its_own_order(tmp_path: Path) -> None:
    """A robot whose behaviour failed starts it again at another revision, so other changes must not give it one."""
    path = tmp_path / "state.json"
    kept = fresh(path)
    await kept.set_behaviour(SetBehaviour(behaviour="circle", names=("r2",)))
    ordered = kept.revision
    assert (kept.behaviour("r1").revision, kept.behaviour("r2").revision) == (0, ordered)
    await kept.set_circle(SetCircle(radius=0.9))
    await kept.add_stop(Stop())
    await kept.resume(Resume(revision=kept.stop.revision))
    await kept.set_behaviour(SetBehaviour(behaviour="hold", names=("r3",)))
    assert kept.revision > ordered
    assert kept.behaviour("r2").revision == fresh(path).behaviour("r2").revision == ordered
    await kept.set_behaviour(SetBehaviour(behaviour="circle", names=("r2",)))
    assert kept.behaviour("r2").revision == kept.revision


async def test_robots_that_do_the_same_share_the_circle_whenever_that_was_ordered() -> None:
    kept = StateStore(parse_scenario({"robots": 5, "behaviour": {"name": "hold"}}, "lab.toml", name="lab"), None)
    await kept.set_circle(SetCircle(radius=0.29))  # room for four robots of 0.177 m radius
    for name in ("r1", "r2", "r3", "r4"):
        await kept.set_behaviour(SetBehaviour(behaviour="pursuit", names=(name,)))
    with pytest.raises(OrderRefused, match="5 robots on a circle"):
        await kept.set_behaviour(SetBehaviour(behaviour="pursuit", names=("r5",)))


async def test_a_behaviour_order_to_an_unknown_robot_is_refused() -> None:
    kept = fresh()
    before = kept.state
    with pytest.raises(OrderRefused, match=r"^robot r8, r9: expected names out of r1, r2, r3$"):
        await kept.set_behaviour(SetBehaviour(behaviour="hold", names=("r1", "r8", "r9")))
    assert kept.state == before


async def test_a_refused_behaviour_order_begins_with_the_key() -> None:
    with pytest.raises(OrderRefused, match=r"^behaviour\.cruise: got -1 \(integer\), expected a number at least 0"):
        await fresh().set_behaviour(SetBehaviour(behaviour="pursuit", parameters={"cruise": -1}))


# ---- stop and resume


async def test_stops_add_up() -> None:
    kept = fresh()
    await kept.add_stop(Stop(names=("r2",)))
    assert stopped(kept) == (False, ("r2",))
    await kept.add_stop(Stop(names=("r1",)))
    assert stopped(kept) == (False, ("r1", "r2"))
    await kept.add_stop(Stop())
    assert stopped(kept) == (True, ("r1", "r2"))


async def test_a_stop_by_name_does_not_reduce_a_stop_of_all() -> None:
    kept = fresh()
    await kept.add_stop(Stop())
    await kept.add_stop(Stop(names=("r1",)))
    assert stopped(kept) == (True, ("r1",))


async def test_a_stop_of_a_robot_that_no_file_names_is_kept_too() -> None:
    kept = fresh()
    await kept.add_stop(Stop(names=("visitor",)))
    assert stopped(kept) == (False, ("visitor",))


async def test_resume_lifts_everything() -> None:
    kept = fresh()
    await kept.add_stop(Stop(names=("r1",)))
    await kept.add_stop(Stop())
    before = kept.stop.revision
    await kept.resume(Resume(revision=before))
    assert stopped(kept) == (False, ())
    assert kept.stop.revision > before  # only a newer revision lifts what the robots latched


async def test_resume_of_one_leaves_the_others_stopped() -> None:
    kept = fresh()
    await kept.add_stop(Stop())
    await kept.resume(Resume(revision=kept.stop.revision, names=("r2",)))
    assert stopped(kept) == (False, ("r1", "r3"))
    await kept.resume(Resume(revision=kept.stop.revision, names=("r3",)))
    assert stopped(kept) == (False, ("r1",))


async def test_resume_of_one_leaves_those_stopped_that_no_file_names() -> None:
    kept = fresh()
    await kept.add_stop(Stop(names=("visitor",)))
    await kept.add_stop(Stop())
    await kept.resume(Resume(revision=kept.stop.revision, names=("r2",)))
    assert stopped(kept) == (False, ("r1", "r3", "visitor"))


async def test_resume_is_refused_when_a_stop_came_in_between() -> None:
    kept = fresh()
    await kept.add_stop(Stop(names=("r1",)))
    looked = kept.stop.revision
    await kept.add_stop(Stop(names=("r2",)))
    with pytest.raises(OrderRefused, match=f"got revision {looked}, expected {kept.stop.revision}"):
        await kept.resume(Resume(revision=looked))
    assert stopped(kept) == (False, ("r1", "r2"))


async def test_a_change_of_the_circle_is_no_reason_to_refuse_a_resume() -> None:
    kept = fresh()
    await kept.add_stop(Stop())
    looked = kept.stop.revision
    await kept.set_circle(SetCircle(radius=0.9))
    await kept.resume(Resume(revision=looked))


async def test_resume_of_an_unknown_robot_is_refused() -> None:
    kept = fresh()
    await kept.add_stop(Stop())
    with pytest.raises(OrderRefused, match=r"^robot r9: expected names out of r1, r2, r3$"):
        await kept.resume(Resume(revision=kept.stop.revision, names=("r9",)))
    assert stopped(kept) == (True, ())


async def test_a_stop_of_a_robot_that_no_file_names_can_be_lifted_by_its_name() -> None:
    kept = fresh()
    await kept.add_stop(Stop(names=("r1", "visitor")))
    with pytest.raises(OrderRefused, match=r"^robot r9: expected"):
        await kept.resume(Resume(revision=kept.stop.revision, names=("visitor", "r9")))
    await kept.resume(Resume(revision=kept.stop.revision, names=("visitor",)))
    assert stopped(kept) == (False, ("r1",))
    with pytest.raises(OrderRefused, match=r"^robot visitor: expected"):
        await kept.resume(Resume(revision=kept.stop.revision, names=("visitor",)))


async def test_resume_when_nobody_is_stopped_is_harmless() -> None:
    kept = fresh()
    await kept.resume(Resume(revision=0))
    assert stopped(kept) == (False, ())


async def test_every_change_raises_the_revision() -> None:
    kept = fresh()
    seen = [kept.state.revision]
    await kept.set_circle(SetCircle(radius=0.7))
    seen.append(kept.state.revision)
    await kept.set_behaviour(SetBehaviour(behaviour="hold"))
    seen.append(kept.state.revision)
    await kept.add_stop(Stop())
    seen.append(kept.state.revision)
    await kept.resume(Resume(revision=kept.stop.revision))
    seen.append(kept.state.revision)
    assert seen == sorted(set(seen))


async def test_only_a_change_of_the_stop_raises_its_revision() -> None:
    kept = fresh()
    before = kept.stop.revision
    await kept.set_circle(SetCircle(radius=0.7))
    await kept.set_behaviour(SetBehaviour(behaviour="hold"))
    assert kept.stop.revision == before
    await kept.add_stop(Stop(names=("r1",)))
    assert kept.stop.revision > before


# ---- stops that this process never received


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


# ---- the file


async def test_all_of_it_outlives_the_process(tmp_path: Path) -> None:
    path = tmp_path / "folder" / "state.json"
    kept = fresh(path)
    await kept.set_circle(SetCircle(x=0.2, y=-0.1, radius=0.6, clockwise=True))
    await kept.set_behaviour(
        SetBehaviour(behaviour="mylab.swarm:flock", parameters={"gain": 1, "goals": ((0.5, 1.0),)}, names=("r2",))
    )
    await kept.add_stop(Stop(names=("r3",)))
    again = fresh(path)
    assert again.state == kept.state
    assert again.behaviour("r2").parameters == {"gain": 1, "goals": ((0.5, 1.0),)}
    assert stopped(again) == (False, ("r3",))
    assert again.stop.revision == kept.stop.revision


async def test_without_a_file_nothing_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    await fresh(None).add_stop(Stop())
    assert files_in(tmp_path) == []


async def test_a_robot_that_the_file_does_not_know_begins_as_the_scenario_says(tmp_path: Path) -> None:
    path = tmp_path / "state.json"
    kept = fresh(path, robots=2)
    await kept.set_behaviour(SetBehaviour(behaviour="hold"))
    await kept.add_stop(Stop(names=("r1",)))
    stop = kept.stop
    again = fresh(path, robots=3)
    assert [again.behaviour(name).behaviour for name in ("r1", "r2", "r3")] == ["hold", "hold", "pursuit"]
    assert again.stop == stop  # a newer robot lifts nobody's stop
    assert fresh(path, robots=3).state == again.state


async def test_a_state_that_was_fitted_to_another_scenario_is_written_at_once(tmp_path: Path) -> None:
    """Else a robot would begin anew at each start, at a revision that it has seen."""
    path = tmp_path / "state.json"
    await fresh(path, robots=2).add_stop(Stop(names=("r2",)))
    fitted = fresh(path, robots=3).state
    assert msgspec.json.decode(path.read_bytes(), type=KeptState) == fitted
    assert "r3" in fitted.behaviour


async def test_a_kept_circle_that_is_not_used_is_named_in_the_log(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "state.json"
    await fresh(path).set_circle(SetCircle(radius=1.2))
    fresh(path)
    assert caplog.messages == []
    StateStore(parse_scenario({"robots": 3, "arena": {"y_min": -1.1, "y_max": 1.1}}, "lab.toml", name="lab"), path)
    (said,) = caplog.messages
    assert "radius=1.2" in said
    assert "radius=0.8" in said


async def test_a_disk_that_hangs_keeps_two_threads_and_not_the_end_of_the_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    released = threading.Event()
    monkeypatch.setattr(os, "fsync", lambda fd: released.wait(seconds(30)))
    file = StateFile(tmp_path / "state.json")
    state = fresh().state
    try:
        writing = [file.write(state) for _ in range(6)]
        assert sum(thread.name.startswith("state file") for thread in threading.enumerate()) == 2
        file.close()  # does not wait
        assert not any(write.done() for write in writing)
    finally:
        released.set()
    await asyncio.gather(*writing)


async def test_the_folders_above_the_file_are_made(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b" / "state.json"
    await fresh(path).add_stop(Stop())
    assert files_in(path.parent) == ["state.json"]
    await fresh(path).add_stop(Stop(names=("r1",)))


async def test_a_place_where_no_file_can_be_is_refused_with_the_reason(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("a file")
    with pytest.raises(ConfigError, match=r"state\.json: got (File exists|Not a directory)"):
        await fresh(tmp_path / "a" / "state.json").add_stop(Stop())


async def test_a_change_is_on_the_disk_before_it_is_answered(tmp_path: Path) -> None:
    path = tmp_path / "state.json"
    kept = fresh(path)
    await kept.add_stop(Stop())
    assert json.loads(path.read_text())["stop_all"] is True
    assert json.loads(path.read_text())["revision"] == kept.revision
    assert files_in(tmp_path) == ["state.json"]


async def test_all_of_it_is_in_the_file_when_that_is_synced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a buffer still holds is lost with the power."""
    synced: list[bytes] = []

    def sync(fd: int) -> None:
        file = Path(f"/proc/self/fd/{fd}")
        if file.is_file():
            synced.append(file.read_bytes())

    monkeypatch.setattr(os, "fsync", sync)
    path = tmp_path / "state.json"
    kept = fresh(path)
    await kept.add_stop(Stop(names=("r2",)))
    assert [msgspec.json.decode(data, type=KeptState) for data in synced] == [kept.state]
    assert path.read_bytes() == synced[0]


async def test_the_files_new_name_is_synced_before_a_stop_is_answered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "state.json"
    kept = fresh(path)
    steps: list[str] = []
    replace = Path.replace

    def sync(fd: int) -> None:
        steps.append(f"sync {Path(f'/proc/self/fd/{fd}').resolve().name}")

    def rename(file: Path, target: Path) -> Path:
        steps.append(f"rename {file.name} to {target.name}")
        return replace(file, target)

    monkeypatch.setattr(os, "fsync", sync)
    monkeypatch.setattr(Path, "replace", rename)
    await kept.add_stop(Stop())
    new, folder = "state.json.1.new", tmp_path.name
    assert steps == [f"sync {new}", f"rename {new} to state.json", f"sync {folder}"]


async def test_a_folder_that_hangs_keeps_no_other_write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = fresh(tmp_path / "state.json")
    hangs, released = threading.Event(), threading.Event()

    def sync(fd: int) -> None:
        if Path(f"/proc/self/fd/{fd}").is_dir() and not hangs.is_set():
            hangs.set()
            released.wait(seconds(30))

    monkeypatch.setattr(os, "fsync", sync)
    first = asyncio.ensure_future(kept.add_stop(Stop(names=("r1",))))
    try:
        assert await asyncio.to_thread(hangs.wait, seconds(10))
        await asyncio.wait_for(kept.add_stop(Stop(names=("r2",))), seconds(10))
        assert not first.done()
    finally:
        released.set()
    await first


async def test_a_half_written_file_is_never_the_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "state.json"
    kept = fresh(path)
    await kept.set_circle(SetCircle(radius=0.6))
    before = path.read_bytes()

    def crash(fd: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", crash)
    with pytest.raises(ConfigError, match=r"state\.json: got No space left on device"):
        await kept.set_circle(SetCircle(radius=0.7))
    assert path.read_bytes() == before
    assert kept.circle.radius == 0.6  # what was refused does not hold
    monkeypatch.undo()
    assert fresh(path).circle.radius == 0.6


async def test_a_stop_holds_even_where_the_disk_is_full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = fresh(tmp_path / "state.json")

    def full(fd: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(ConfigError):
        await kept.add_stop(Stop(names=("r1",)))
    assert stopped(kept) == (False, ("r1",))
    with pytest.raises(ConfigError):
        await kept.add_stop(Stop())
    assert stopped(kept) == (True, ("r1",))
    with pytest.raises(ConfigError):
        await kept.resume(Resume(revision=kept.stop.revision))
    assert stopped(kept) == (True, ("r1",))


async def test_a_resume_that_cannot_be_kept_lifts_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = fresh(tmp_path / "state.json")
    await kept.add_stop(Stop())
    before = kept.state

    def full(fd: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(ConfigError):
        await kept.resume(Resume(revision=kept.stop.revision, names=("r1",)))
    assert kept.state == before


@pytest.mark.parametrize(
    "content",
    [b"", b"{", b"\xff\xfe", b"[]", b'{"revision": 1}', b'{"revision": "one"}', b"null"],
    ids=["empty", "half", "no text", "a list", "incomplete", "wrong type", "null"],
)
async def test_a_file_that_is_no_state_is_refused_and_left_alone(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "state.json"
    path.write_bytes(content)
    with pytest.raises(ConfigError) as caught:
        fresh(path)
    assert str(path) in str(caught.value)
    assert "a stop order in it is then forgotten" in str(caught.value)
    assert path.read_bytes() == content


async def test_a_state_with_a_wrong_value_or_key_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "state.json"
    await fresh(path).add_stop(Stop())
    good = json.loads(path.read_text())
    for change in (
        {"circle": {**good["circle"], "radius": 0.0}},
        {"circle": {**good["circle"], "x": None}},
        {"circle": {"x": 0.0, "y": 0.0}},
        {"revision": -1},
        {"stop_all": "yes"},
        {"stop_names": ["R 1"]},
        {"speed": 1.0},
    ):
        path.write_text(json.dumps({**good, **change}))
        with pytest.raises(ConfigError, match="no kept state"):
            fresh(path)


async def test_a_file_of_the_layout_before_the_circle_was_one_value_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "state.json"
    await fresh(path).add_stop(Stop())
    old = json.loads(path.read_text())
    old["x"], old["y"], old["radius"], old["clockwise"] = old.pop("circle").values()
    path.write_text(json.dumps(old))
    with pytest.raises(ConfigError, match=r"state\.json: got a file that is no kept state: .*`x`") as caught:
        fresh(path)
    assert "Move it away to start from the scenario" in str(caught.value)
