"""The kept state of the lab: what each order makes of it, and its revisions."""

from __future__ import annotations

from pathlib import Path

import pytest

from basestation.fleet.state_store import StateStore
from muro_zenoh.config import Scenario, parse_scenario
from muro_zenoh.errors import OrderRefused
from muro_zenoh.messages import Resume, SetBehaviour, SetCircle, Stop
from tests.support.kept_state import fresh, stopped

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
    with pytest.raises(
        OrderRefused, match=r"expected at most 1\.303 m"
    ):  # 1.5 m to the wall less a body of 0.177 m and 0.02 m
        await fresh().set_circle(SetCircle(radius=1.4))


async def test_a_circle_on_which_the_fleet_would_touch_is_refused() -> None:
    """Three robots of 0.177 m radius need 0.4 m between their centres, and a circle of 0.231 m; two do not."""
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
    await kept.set_circle(SetCircle(radius=0.3))  # room for four robots of 0.177 m radius
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
