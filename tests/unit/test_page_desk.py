"""Orders from pages that safety depends on, in virtual time: no stop is lost, no resume and no wish is late."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable
from typing import Any

import msgpack
import pytest

from basestation.dashboard import stops
from basestation.dashboard.access import Right
from basestation.dashboard.desk import Desk
from basestation.dashboard.watching import FleetWatch
from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.errors import TransportError
from muro_zenoh.messages import Behaviour, DriveWish, Lease, LeaseState
from muro_zenoh.orders.stop import StopResult, resume_robots, stop_robots
from muro_zenoh.transport import Bus, Every
from tests.support.stop_lab import LAB, Agent, Lab, cut_off, virtual


class Client:
    """A connected browser: what it was answered."""

    def __init__(self, number: int = 1, right: Right = Right.STEER) -> None:
        self.number = number
        self.right = right
        self.replies: dict[int, dict[str, Any]] = {}

    def reply(self, **values: Any) -> None:
        self.replies[values["id"]] = values

    def robots(self, number: int) -> set[str]:
        """The robots that a receipt has."""
        return set(self.replies[number]["receipt"]["robots"])


class Page:
    """The desk of a page."""

    def __init__(self, there: Lab) -> None:
        self.desk = Desk(there.operator, LAB, FleetWatch(there.operator, LAB))
        self.client = Client()

    def order(self, order: str, number: int, client: Client | None = None, **values: Any) -> None:
        data = msgpack.packb({"order": order, "id": number, **values})
        self.desk.take(client or self.client, data)  # type: ignore[arg-type]


class Counted:
    """Counts confirmations: how many there were, and how many at once."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.all = 0
        self.now: Counter[bool] = Counter()
        self.most: Counter[bool] = Counter()
        patch.setattr(stops, "stop_robots", self._stop)

    async def _stop(self, bus: Bus, names: tuple[str, ...], arrived: Callable[[], None]) -> StopResult:
        viewers = names != OPERATORS
        self.all += 1
        self.now[viewers] += 1
        self.most[viewers] = max(self.most[viewers], self.now[viewers])
        try:
            return await stop_robots(bus, names, arrived)
        finally:
            self.now[viewers] -= 1


OPERATORS = ("r1", "r2")
"""What the operator stops while viewers flood."""


def stopped(agents: dict[str, Agent]) -> set[str]:
    return {name for name, agent in agents.items() if agent.latch.stopped}


@virtual
async def test_a_stop_is_sent_before_anything_else_runs(there: Lab) -> None:
    agents, page = await there.agents("r1", "r2"), Page(there)
    page.order("stop", 1)
    await page.desk.close()  # the process ends: the task that confirms has never run
    await asyncio.sleep(0.001)
    assert stopped(agents) == {"r1", "r2"}


@virtual
async def test_a_stop_of_one_ends_no_stop_of_all(there: Lab) -> None:
    """Both in one segment; each press gets its own receipt."""
    agents, page = await there.agents("r1", "r2"), Page(there)
    await there.base_station()
    page.order("stop", 1, names=[])
    page.order("stop", 2, names=["r1"])
    await asyncio.sleep(1.0)
    assert stopped(agents) == {"r1", "r2"}
    assert page.client.robots(1) == {"r1", "r2"}
    assert page.client.robots(2) == {"r1"}


@virtual
async def test_a_resume_behind_a_stop_is_refused_and_the_stop_holds(there: Lab) -> None:
    agents, page = await there.agents("r1", "r2"), Page(there)
    store = await there.base_station()
    page.order("stop", 1)
    page.order("resume", 2, revision=store.stop.revision + 1)
    await asyncio.sleep(1.0)
    assert page.client.replies[2]["outcome"] == "refused"
    assert "pressed just now" in page.client.replies[2]["reason"]
    assert page.client.replies[1]["receipt"]["confirmed"]
    assert stopped(agents) == {"r1", "r2"}
    assert store.stop.all


@virtual
async def test_a_resume_of_one_robot_ends_no_stop_of_all_that_has_not_arrived_yet(there: Lab) -> None:
    agents, page = await there.agents("r1", "r2"), Page(there)
    store = await there.base_station()
    other = await there.join(Role.OPERATOR)
    await resume_robots(other, ())
    await stop_robots(other, ("r1",))
    async with cut_off(there.operator):
        page.order("stop", 1)
        await asyncio.sleep(0.7)
        page.order("resume", 2, names=["r1"], revision=store.stop.revision)
        assert page.client.replies[2]["outcome"] == "refused"
        assert "still sent" in page.client.replies[2]["reason"]
        await asyncio.sleep(0.3)
    await asyncio.sleep(0.3)
    assert stopped(agents) == {"r1", "r2"}
    page.order("resume", 3, names=["r1"], revision=store.stop.revision)
    assert "still sent" in page.client.replies[3]["reason"], "it has arrived, and is repeated for a moment"
    await asyncio.sleep(0.5)
    page.order("resume", 4, names=["r1"], revision=store.stop.revision)
    await asyncio.sleep(1.0)
    assert page.client.replies[4]["outcome"] == "taken"
    assert stopped(agents) == {"r2"}


@virtual
async def test_a_resume_while_a_robot_does_not_confirm_says_that_it_did_not(there: Lab) -> None:
    await there.agents("r1", "r2", deaf="r2")
    page = Page(there)
    store = await there.base_station()
    page.order("stop", 1)
    await asyncio.sleep(0.5)
    page.order("resume", 9, revision=store.stop.revision)
    assert "pressed just now" in page.client.replies.pop(9)["reason"], "it is still repeated"
    await asyncio.sleep(0.5)
    assert page.client.replies == {}
    page.order("resume", 2, revision=store.stop.revision)
    await asyncio.sleep(3.0)
    assert page.client.replies[1]["outcome"] == "unanswered"
    assert page.client.replies[2]["outcome"] == "taken"


@virtual
async def test_a_resume_lifts_no_stop_that_came_after_the_question(there: Lab) -> None:
    agents, page = await there.agents("r1", "r2"), Page(there)
    store = await there.base_station()
    page.order("stop", 1)
    await asyncio.sleep(1.0)
    asked = store.stop.revision
    page.order("stop", 1, Client(2))
    await asyncio.sleep(1.0)
    page.order("resume", 2, revision=asked)
    await asyncio.sleep(1.0)
    assert page.client.replies[2]["outcome"] == "refused"
    assert "came in between" in page.client.replies[2]["reason"]
    assert stopped(agents) == {"r1", "r2"}
    page.order("resume", 3, revision=store.stop.revision)
    await asyncio.sleep(1.0)
    assert page.client.replies[3]["outcome"] == "taken"
    assert stopped(agents) == set()


@virtual
async def test_a_stop_of_nobody_is_not_taken(there: Lab) -> None:
    """Without a base station nobody keeps it for a robot of this name."""
    await there.agents("r1")
    page = Page(there)
    page.order("stop", 1, names=["r3"])
    await asyncio.sleep(5.0)
    assert page.client.replies[1]["outcome"] == "unanswered"
    assert page.client.replies[1]["receipt"]["robots"]["r3"]["status"] == "unknown"


@virtual
async def test_robots_that_the_fleet_file_does_not_have_are_stopped_and_not_waited_for(there: Lab) -> None:
    """Nor does the page have names kept that anybody may make up; the base station keeps those that robots report."""
    agents, page = await there.agents("r1", "r7"), Page(there)
    store = await there.base_station()
    page.order("stop", 1, names=["r1", *(f"x{number}" for number in range(900))])
    page.order("stop", 2, names=["x1"])
    page.order("stop", 3, names=["r7"])
    await asyncio.sleep(0.001)
    assert stopped(agents) == {"r1", "r7"}
    assert [page.client.replies[number]["outcome"] for number in (2, 3)] == ["refused", "refused"]
    await asyncio.sleep(1.0)
    assert page.client.robots(1) == {"r1"}
    assert set(store.stop.names) >= {"r1", "r7"}


@virtual
async def test_presses_of_one_button_share_a_receipt_and_a_later_one_is_sent_anew(there: Lab) -> None:
    agents, page = await there.agents("r1"), Page(there)
    await there.base_station()
    with pytest.MonkeyPatch.context() as patch:
        counted = Counted(patch)
        for number in range(4):
            page.order("stop", number)
        await asyncio.sleep(0.1)
        page.order("stop", 4)
        await asyncio.sleep(0.2)
        page.order("stop", 5)
        await asyncio.sleep(1.0)
    assert counted.all == 2
    assert set(page.client.replies) == set(range(6))
    assert all(page.client.robots(number) == {"r1"} for number in range(6))
    assert stopped(agents) == {"r1"}


@virtual
async def test_what_fails_is_answered(there: Lab) -> None:
    page = Page(there)
    with pytest.MonkeyPatch.context() as patch:

        async def fails(*_: object) -> None:
            raise RuntimeError("no more memory")

        def unsent(*_: object) -> None:
            raise TransportError("no router")

        patch.setattr(stops, "stop_robots", fails)
        patch.setattr(stops, "send_stop", unsent)
        page.order("stop", 1)
        await asyncio.sleep(0.1)
    assert page.client.replies[1]["outcome"] == "unanswered"
    assert "no more memory" in page.client.replies[1]["reason"]
    page.order("stop", 2)
    await asyncio.sleep(4.0)
    assert 2 in page.client.replies


def hold_all_places(page: Page, first: int = 2) -> None:
    """As many viewers as are confirmed at once stop r2, which is deaf."""
    for number in range(first, first + stops._MOST_AT_ONCE):
        page.order("stop", 1, Client(number, Right.VIEW), names=["r2"])


@virtual
async def test_a_resume_is_not_undone_by_a_stop_before_it_that_waits_for_its_turn(there: Lab) -> None:
    agents, page, ninth = await there.agents("r1", "r2", deaf="r2"), Page(there), Client(99, Right.VIEW)
    store = await there.base_station()
    hold_all_places(page)
    page.order("stop", 1, ninth)
    await asyncio.sleep(2.0)
    assert stopped(agents) == {"r1"}
    page.order("resume", 2, revision=store.stop.revision)
    await asyncio.sleep(10.0)
    assert page.client.replies[2]["outcome"] == "taken"
    assert (ninth.replies[1]["outcome"], ninth.replies[1]["reason"][:7]) == ("unanswered", "resumed")
    assert stopped(agents) == set()
    assert not store.stop.all


@virtual
async def test_a_stop_just_before_a_resume_is_sent_anew_at_its_turn(there: Lab) -> None:
    """The base station may not have known of it; whatever it is, it is not lost."""
    agents, page, ninth = await there.agents("r1", "r2", deaf="r2"), Page(there), Client(99, Right.VIEW)
    store = await there.base_station()
    hold_all_places(page)
    await asyncio.sleep(2.0)
    seen = store.stop.revision
    agents["r1"].deaf = True  # the stop does not arrive
    page.order("stop", 1, ninth, names=["r1"])
    page.order("resume", 2, revision=seen)
    await asyncio.sleep(0.5)
    agents["r1"].deaf = False
    assert page.client.replies[2]["outcome"] == "taken"
    assert stopped(agents) == set()
    await asyncio.sleep(3.0)
    assert stopped(agents) == {"r1"}


@virtual
async def test_a_stop_after_a_resume_that_a_robot_does_not_follow_is_confirmed_at_its_turn(there: Lab) -> None:
    agents, page, last = await there.agents("r1", "r2", "r3", deaf="r2"), Page(there), Client(99, Right.VIEW)
    store = await there.base_station()
    page.order("stop", 1, last, names=["r3"])
    await asyncio.sleep(1.0)
    agents["r3"].deaf = True  # it stays stopped
    hold_all_places(page)
    hold_all_places(page, 50)  # these wait
    await asyncio.sleep(0.3)
    page.order("resume", 2, revision=store.stop.revision)
    await asyncio.sleep(0.5)
    page.order("stop", 2, last, names=["r1"])
    await asyncio.sleep(10.0)
    assert page.client.replies[2]["reason"].startswith("still stopped:"), "it was waited for"
    assert last.replies[2]["receipt"]["confirmed"]
    assert stopped(agents) == {"r1", "r3"}


@virtual
async def test_a_refused_resume_ends_nobodys_receipt(there: Lab) -> None:
    agents, page, ninth = await there.agents("r1", "r2", deaf="r2"), Page(there), Client(99, Right.VIEW)
    store = await there.base_station()
    hold_all_places(page)
    page.order("stop", 1, ninth, names=["r1"])
    await asyncio.sleep(2.0)
    page.order("resume", 2, revision=store.stop.revision - 1)
    await asyncio.sleep(6.0)
    assert page.client.replies[2]["outcome"] == "refused"
    assert ninth.replies[1]["receipt"]["confirmed"]
    assert stopped(agents) == {"r1"}


@virtual
async def test_what_a_client_that_is_gone_has_stopped_is_sent_and_its_receipts_wait_no_longer(there: Lab) -> None:
    agents, page = await there.agents("r1", "r2", deaf="r2"), Page(there)
    await there.base_station()
    hold_all_places(page)
    with pytest.MonkeyPatch.context() as patch:
        counted = Counted(patch)
        for number in range(100, 400):
            gone = Client(number, Right.VIEW)
            page.order("stop", 1, gone)
            page.order("stop", 2, gone, names=["r1"])
            page.desk.leave(gone)  # type: ignore[arg-type]
            await asyncio.sleep(0.001)
            assert stopped(agents) == {"r1"}
        assert len(page.desk._stops._under_way) <= stops._MOST_AT_ONCE
        await asyncio.sleep(10.0)
    assert counted.all <= stops._MOST_AT_ONCE


@virtual
async def test_a_stop_that_could_not_be_sent_outlives_its_client(there: Lab) -> None:
    agents, page, gone = await there.agents("r1", "r2", deaf="r2"), Page(there), Client(99, Right.VIEW)
    hold_all_places(page)
    with pytest.MonkeyPatch.context() as patch:

        def unsent(*_: object) -> None:
            raise TransportError("no router")

        patch.setattr(stops, "send_stop", unsent)
        page.order("stop", 1, gone, names=["r1"])
    page.desk.leave(gone)  # type: ignore[arg-type]
    assert stopped(agents) == set()
    await asyncio.sleep(5.0)
    assert stopped(agents) == {"r1"}


@virtual
async def test_viewers_that_flood_cost_a_few_confirmations_and_an_operator_none_of_his(there: Lab) -> None:
    agents, page = await there.agents(*OPERATORS), Page(there)
    await there.base_station()
    viewers = [Client(number, Right.VIEW) for number in range(2, 34)]
    with pytest.MonkeyPatch.context() as patch:
        counted = Counted(patch)
        for turn in range(100):
            for viewer in viewers:
                page.order("stop", turn, viewer, names=[f"r{1 + turn % 3}"] if turn % 4 else [])
            if turn == 50:
                page.order("stop", turn, names=OPERATORS)
            await asyncio.sleep(0.01)
        assert stopped(agents) == set(OPERATORS)
        await asyncio.sleep(1.0)
        assert len(page.desk._stops._under_way) <= stops._MOST_OF_ALL + 1
    assert counted.most == {True: stops._MOST_AT_ONCE, False: 1}
    assert page.client.replies[50]["receipt"]["confirmed"]
    refused = [reply for viewer in viewers for reply in viewer.replies.values() if "still awaited" in reply["reason"]]
    assert refused
    await page.desk.close()


# ---- driving by hand


async def by_hand(there: Lab) -> tuple[Bus, Every[DriveWish]]:
    """A base station that has r1 driven by hand, and the wishes that are sent."""
    base = await there.join(Role.BASESTATION)
    base.publisher(channels.BEHAVIOUR, "r1").put(Behaviour(behaviour="manual", revision=1))
    wishes = there.observer.every(channels.DRIVE, "r1")
    await asyncio.sleep(0.01)
    return base, wishes


@virtual
async def test_a_hand_of_which_nothing_is_heard_any_more_is_off(there: Lab) -> None:
    """The client is still connected, as far as anybody knows."""
    page = Page(there)
    _, wishes = await by_hand(there)
    page.order("drive", 1, name="r1", v=0.2, omega=0.1, t=there.clock.now())
    await asyncio.sleep(0.19)
    assert {received.message.v for received in wishes.drain()} == {0.2}
    await asyncio.sleep(0.02)
    assert [(received.message.v, received.message.omega) for received in wishes.drain()] == [(0.0, 0.0)]
    await asyncio.sleep(5.0)
    assert wishes.drain() == []


@virtual
async def test_a_robot_that_somebody_else_holds_is_not_driven(there: Lab) -> None:
    page = Page(there)
    base, wishes = await by_hand(there)
    leases = base.publisher(channels.LEASE)

    def drive(number: int, v: float = 0.2) -> None:
        page.order("drive", number, name="r1", v=v, omega=0.0, t=there.clock.now())

    def held(operator: str, *names: str) -> None:
        lease = Lease(program="his own", operator=operator, epoch=7, names=names, since=1.7e9, left=3.0)
        leases.put(LeaseState(leases=(lease,)))

    drive(1)
    held("bob@laptop")
    await asyncio.sleep(0.05)
    drive(2)
    assert page.client.replies[2]["outcome"] == "refused"
    assert page.client.replies[2]["reason"].startswith("held by his own of bob@laptop")
    drive(3, v=0.0)
    await asyncio.sleep(0.001)
    assert wishes.drain()[-1].message.v == 0.0
    for number, (operator, names, lasts) in enumerate(
        [(there.operator.operator, (), 0.0), ("bob@laptop", ("r2",), 0.0), ("bob@laptop", (), 3.1)], 10
    ):
        held(operator, *names)
        await asyncio.sleep(0.3 + lasts)
        wishes.drain()
        drive(number)
        await asyncio.sleep(0.05)
        assert {received.message.v for received in wishes.drain()} == {0.2}
        drive(number, v=0.0)
    assert not {10, 11, 12} & page.client.replies.keys()


@virtual
async def test_a_wish_by_what_was_seen_long_ago_drives_nobody(there: Lab) -> None:
    """On a slow connection it has waited behind others; the hand may be off by now. A zero is always taken."""
    page = Page(there)
    _, wishes = await by_hand(there)

    def sent() -> list[float]:
        return [received.message.v for received in wishes.drain()]

    def drive(number: int, age: float, v: float = 0.2) -> None:
        page.order("drive", number, name="r1", v=v, omega=0.0, t=there.clock.now() - age)

    for number, age in enumerate((0.31, 5.0, -0.1, float("nan"))):
        drive(number, age)
        await asyncio.sleep(1.1)  # it is said once a second
        assert sent() == []
        assert page.client.replies[number]["outcome"] == "refused"
    drive(10, 0.25)
    await asyncio.sleep(0.1)
    assert set(sent()) == {0.2}
    drive(11, 0.31)  # the one before goes on until it is over
    drive(12, 9.0, v=0.0)
    await asyncio.sleep(0.001)
    assert sent() == [0.0]
    assert 12 not in page.client.replies


@virtual
async def test_an_order_to_break_something_says_what_is_wrong_with_it(there: Lab) -> None:
    page, run = Page(there), await there.join()
    for role in (Role.SUPERVISOR, Role.SIMULATOR):
        run.announce(role, "muro")
    await asyncio.sleep(0.1)
    reasons = (
        ({"kind": "carry", "target": "r1", "duration": 1.0}, "refused", "no way and no angle"),
        ({"kind": "crash", "target": "router"}, "unanswered", "would have come over the router"),
        ({"kind": "crash", "target": "r1/agent"}, "unanswered", "Is `muro run` running"),
    )
    for number, (order, outcome, reason) in enumerate(reasons):
        page.order("break", number, **order)
        await asyncio.sleep(10.0)
        assert page.client.replies[number]["outcome"] == outcome
        assert reason in page.client.replies[number]["reason"]
