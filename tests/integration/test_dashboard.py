"""The page of a fleet in memory, spoken to over real WebSockets: what it shows, and what comes of its orders."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator
from typing import Any

import pytest

from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.config import Scenario, parse_scenario
from muro_zenoh.messages import PlannedPath, SetBehaviour
from tests.support.page import TOKENS, PageFleet, page_fleet


def lab(robots: int = 2, behaviour: str = "pursuit", **parameters: Any) -> Scenario:
    table = {
        "robots": robots,
        "camera": {"north": {"width": 640, "height": 480}},
        "behaviour": {"name": behaviour, **parameters},
    }
    return parse_scenario(table, "lab.toml", name="lab")


@pytest.fixture
async def fleet() -> AsyncIterator[PageFleet]:
    async with page_fleet(lab()) as there:
        yield there


class TestWhatItShows:
    async def test_the_greeting_says_what_there_is_and_what_can_be_ordered(self, fleet: PageFleet) -> None:
        async with fleet.client() as client:
            await client.until(lambda: client.hello, 5.0, "a greeting")
            hello = client.hello
            assert (hello["arena"], hello["walls"]) == ([-2.1, -1.5, 2.1, 1.5], [])
            assert hello["robots"]["r1"] == {"radius": 0.177, "v_max": 0.5, "omega_max": 1.5, "margin": 0.046}
            assert hello["may_steer"] is True
            assert (hello["simulated"], hello["faults"]) == (False, {})
            speed = hello["behaviours"]["circle"]["parameters"]["speed"]
            assert (speed["type"], speed["default"], speed["unit"], speed["at_least"]) == ("number", 0.2, "m/s", 0.0)
            assert len(hello["cameras"]["north"]["outline"]) >= 4

    async def test_robots_are_where_they_are(self, fleet: PageFleet) -> None:
        async with fleet.client() as client:
            await client.until(
                lambda: all(client.details(name).get("state") == "driving" for name in ("r1", "r2")), 15.0, "driving"
            )
            await fleet.end("simulator")  # from here on nothing moves
            await asyncio.sleep(0.2)
            robots, truth = client.state["robots"], fleet.room.plant.pose.tolist()
            for name, (x, y, theta) in zip(fleet.scenario.robots, truth, strict=True):
                assert math.hypot(robots[name][0] - x, robots[name][1] - y) < 0.05
                assert abs(math.remainder(robots[name][2] - theta, 2.0 * math.pi)) < 0.2
            assert client.state["circle"]["radius"] == 0.8
            assert sum(client.state["gaps"].values()) == pytest.approx(2.0 * math.pi, abs=0.01)
            assert client.state["stop"]["all"] is False
            assert {"r1", "r2", "basestation", "simulator", "page"} <= client.state["processes"].keys()
            assert client.state["processes"]["router"]["alive"], "something comes"
            await fleet.end("basestation")
            await fleet.end("r1")
            await fleet.end("r2")
            await client.until(lambda: not client.state["processes"]["router"]["alive"], 8.0, "nothing comes")

    async def test_a_state_has_what_is_slow_only_when_it_changed(self, fleet: PageFleet) -> None:
        async with fleet.client() as client:
            await client.until(lambda: client.states > 60, 15.0, "states")
            assert client.size / client.states < 1500.0
            assert client.state["processes"]["r1"]["rates"]["pose"] > 5.0
            assert client.state["processes"]["page"]["drops"] == 0, "what it passes over is not lost"
            assert [number for number, *_ in client.state["events"]] == sorted(
                {number for number, *_ in client.state["events"]}
            )

    async def test_every_robot_of_the_file_is_there_with_the_reason_why_it_does_not_drive(self) -> None:
        async with page_fleet(lab(3), agents=["r1", "r2"]) as fleet:
            fleet.camera.hidden.update({"r2"})
            async with fleet.client() as client:
                await client.until(lambda: client.details("r1").get("state") == "driving", 15.0, "r1 drives")
                assert client.details("r2")["state"] == "unseen"
                assert "no camera has seen it" in client.details("r2")["reason"]
                assert client.state["robots"]["r2"][:6] == [None] * 6
                assert client.details("r3")["state"] == "absent"
                assert "no agent" in client.details("r3")["reason"]
                x, y = client.state["robots"]["r3"][:2]
                assert (x, y) == pytest.approx(fleet.room.plant.pose[2, :2].tolist(), abs=0.02)
                before = client.state["robots"]["r1"][:2]
                fleet.camera.hidden.add("r1")
                await client.until(lambda: client.details("r1").get("state") == "lost", 10.0, "r1 is lost")
                age = client.state["robots"]["r1"][5]
                assert age > 0.5
                assert client.state["robots"]["r1"][:2] == pytest.approx(before, abs=0.5)

    async def test_without_a_base_station_it_says_so(self, fleet: PageFleet) -> None:
        async with fleet.client() as client:
            await client.until(lambda: client.details("r1").get("state") == "driving", 15.0, "r1 drives")
            await fleet.end("basestation")
            reason = "no positions from the base station"
            await client.until(lambda: reason in client.details("r1").get("reason", ""), 10.0, reason)
            assert client.details("r1")["state"] == "stale"
            await client.until(
                lambda: client.state["processes"]["basestation"]["alive"] is False, 10.0, "the base station is gone"
            )
            assert any("basestation is gone" in text for _, _, _, text in client.state["events"])


class TestOrders:
    async def test_stop_and_resume(self, fleet: PageFleet) -> None:
        async with fleet.client() as client:
            await client.until(lambda: client.details("r1").get("state") == "driving", 15.0, "r1 drives")
            reply = await client.order("stop")
            assert (reply["outcome"], reply["reason"]) == ("taken", "")
            robots = reply["receipt"]["robots"]
            assert {name: row["status"] for name, row in robots.items()} == {"r1": "stopped", "r2": "stopped"}
            assert fleet.wheels("r1") == fleet.wheels("r2") == (0.0, 0.0)
            await client.until(lambda: client.details("r2").get("state") == "stopped", 5.0, "shown as stopped")
            assert (await client.resume())["outcome"] == "taken"
            await client.until(lambda: client.details("r1").get("state") == "driving", 10.0, "r1 drives again")

    async def test_every_press_of_stop_is_answered_and_the_last_word_is_stop(self, fleet: PageFleet) -> None:
        async with fleet.client() as client:
            await client.until(lambda: client.details("r1").get("state") == "driving", 15.0, "r1 drives")
            numbers = [await client.send("stop", names=[]) for _ in range(5)]
            await client.until(lambda: set(numbers) <= client.replies.keys(), 10.0, "five receipts")
            assert all(client.replies[number]["receipt"]["confirmed"] for number in numbers)
            resume = await client.send("resume", revision=client.state["stop"]["revision"])
            stop = await client.send("stop", names=[])
            await client.until(lambda: {resume, stop} <= client.replies.keys(), 10.0, "both replies")
            await client.until(lambda: client.details("r1").get("state") == "stopped", 5.0, "r1 is stopped")
            assert fleet.wheels("r1") == (0.0, 0.0)

    async def test_one_client_stops_what_another_sees(self, fleet: PageFleet) -> None:
        async with fleet.client(TOKENS.viewer) as viewer, fleet.client() as other:
            await other.until(lambda: other.details("r2").get("state") == "driving", 15.0, "r2 drives")
            assert (await viewer.order("stop", names=["r2"]))["receipt"]["robots"].keys() == {"r2"}
            await other.until(lambda: other.details("r2").get("state") == "stopped", 5.0, "r2 is shown as stopped")
            assert other.state["stop"]["names"] == ["r2"]

    async def test_a_goal_is_taken_or_refused_with_the_reason(self, fleet: PageFleet) -> None:
        async with fleet.client() as client:
            await client.until(lambda: client.details("r1").get("state") == "driving", 15.0, "r1 drives")
            reply = await client.order("goal", name="r1", x=0.0, y=0.0)
            assert (reply["outcome"], reply["reason"]) == ("refused", "the behaviour pursuit takes no goals")
            assert (await client.order("behaviour", behaviour="dubins", names=["r1"]))["outcome"] == "taken"
            reply = await client.order("goal", name="r1", x=9.0, y=0.0)
            assert reply["outcome"] == "refused"
            assert "arena" in reply["reason"]
            assert (await client.order("goal", name="r1", x=0.5, y=0.25, theta=1.5))["outcome"] == "taken"
            await client.until(lambda: client.details("r1").get("goal") == [0.5, 0.25, 1.5], 5.0, "the goal is shown")
            await client.until(lambda: client.details("r1").get("path"), 5.0, "the path is shown")
            assert len(client.details("r1")["path"]["segments"]) >= 1
            await client.order("behaviour", behaviour="hold", names=["r1"])
            await client.until(lambda: not client.details("r1")["path"], 5.0, "a path ends with its behaviour")

    async def test_the_scenarios_own_behaviour_is_begun_with_its_parameters(self) -> None:
        async with page_fleet(lab(1, "nowhere:own", gain=2.0, far=1.0), agents=[]) as fleet, fleet.client() as client:
            reply = await client.order("behaviour", behaviour="nowhere:own", parameters={"far": 3.0})
            assert reply["outcome"] == "taken"
            await client.until(
                lambda: client.details("r1").get("parameters") == {"gain": 2.0, "far": 3.0}, 5.0, "the parameters"
            )

    async def test_a_goal_for_a_robot_without_an_agent_is_not_answered(self) -> None:
        async with page_fleet(lab(2), agents=["r1"]) as fleet, fleet.client() as client:
            reply = await client.order("behaviour", behaviour="hold")
            assert (reply["outcome"], reply["reason"]) == ("taken", "no agent is running for r2")
            async with fleet.bus(Role.AGENT) as dead:  # what it kept for late joiners, it can no longer end
                path = dead.publisher(channels.PATH, "r2")
                path.put(PlannedPath(x=0.0, y=0.0, theta=0.0, segments=((1.0, 0.0),)))
                reply = await client.order("goal", name="r2", x=0.0, y=0.0)
                before = client.states
                await client.until(lambda: client.states > before + 6, 5.0, "what is slow")
                assert client.details("r2")["path"] is None
            assert reply["outcome"] == "unanswered"
            assert "r2 is not alive" in reply["reason"]
            reply = await client.order("goal", name="r7", x=0.0, y=0.0)
            assert reply["outcome"] == "refused"
            assert "expected one of r1, r2" in reply["reason"]

    async def test_behaviours_and_the_circle_with_their_limits(self, fleet: PageFleet) -> None:
        async with fleet.client() as client:
            reply = await client.order("behaviour", behaviour="circle", parameters={"speed": -1.0})
            assert reply["outcome"] == "refused"
            assert "behaviour.speed: got -1.0" in reply["reason"]
            assert (await client.order("behaviour", behaviour="circle", parameters={"speed": 0.1}))[
                "outcome"
            ] == "taken"
            await client.until(lambda: client.details("r1").get("behaviour") == "circle", 5.0, "the behaviour")
            assert client.details("r1")["parameters"] == {"speed": 0.1}
            reply = await client.order("circle", radius=9.0)
            assert reply["outcome"] == "refused"
            assert "circle.radius" in reply["reason"]
            assert (await client.order("circle", x=0.1, radius=0.6, clockwise=True))["outcome"] == "taken"
            await client.until(lambda: client.state["circle"]["radius"] == 0.6, 5.0, "the circle")
            assert client.state["circle"]["clockwise"] is True

    async def test_the_page_is_an_operator_among_others(self, fleet: PageFleet) -> None:
        from muro_zenoh.orders.lease import holding

        async with fleet.bus(Role.OPERATOR) as other, fleet.client() as client:
            other.operator = "bob@laptop"
            async with holding(other, "his own program", ("r1",), lost=lambda reason: None, patience=5.0):
                reply = await client.order("behaviour", behaviour="hold", names=["r1"])
                assert reply["outcome"] == "refused"
                assert "held by his own program of bob@laptop" in reply["reason"]
                assert (await client.order("behaviour", behaviour="hold", names=["r2"]))["outcome"] == "taken"
                await client.until(lambda: client.state["lease"], 5.0, "the lease is shown")
                assert client.state["lease"][0]["names"] == ["r1"]
                assert (await client.order("stop", names=["r1"]))["outcome"] == "taken"
            await client.until(lambda: client.state["lease"] == [], 8.0, "the lease is over")

    async def test_clear_and_what_is_not_simulated(self, fleet: PageFleet) -> None:
        async with fleet.client() as client:
            await client.until(lambda: client.details("r1").get("state") == "driving", 15.0, "r1 drives")
            fleet.camera.hidden.add("r1")
            assert (await client.order("clear", name="r1"))["outcome"] == "taken"
            await client.until(lambda: client.state["robots"]["r1"][0] is None, 5.0, "r1 is forgotten")
            reply = await client.order("clear", name="r1")
            assert (reply["outcome"], reply["reason"]) == ("refused", "robot r1 was never seen")
            reply = await client.order("break", kind="crash", target="r1/agent")
            assert (reply["outcome"], "muro run" in reply["reason"]) == ("refused", True)

    async def test_without_a_base_station_no_order_is_answered_and_a_stop_stops(self, fleet: PageFleet) -> None:
        async with fleet.client() as client:
            await client.until(lambda: client.details("r1").get("state") == "driving", 15.0, "r1 drives")
            await fleet.end("basestation")
            reply, stop = await asyncio.gather(client.order("circle", radius=0.7), client.order("stop"))
            assert reply["outcome"] == "unanswered"
            assert "nobody answered" in reply["reason"]
            assert stop["receipt"]["basestation"] is None
            assert stop["receipt"]["robots"]["r1"]["status"] == "stopped"


class TestWhoMay:
    async def test_a_viewer_sees_and_stops_and_nothing_else(self, fleet: PageFleet) -> None:
        for token in (TOKENS.viewer, ""):
            async with fleet.client(token) as client:
                await client.until(lambda: client.details("r1").get("state"), 10.0, "a state")
                assert client.hello["may_steer"] is False
                orders: list[tuple[str, dict[str, Any]]] = [
                    ("resume", {"revision": 1}),
                    ("goal", {"name": "r1", "x": 0.0, "y": 0.0}),
                    ("behaviour", {"behaviour": "hold"}),
                    ("circle", {"radius": 0.7}),
                    ("clear", {"name": "r1"}),
                    ("drive", {"name": "r1", "v": 0.1, "omega": 0.0, "t": 0.0}),
                    ("break", {"kind": "crash", "target": "r1/agent"}),
                ]
                for order, values in orders:
                    reply = await client.order(order, **values)
                    assert (reply["outcome"], "only an operator" in reply["reason"]) == ("refused", True), order
                assert (await client.order("stop"))["outcome"] == "taken"
        assert fleet.station.store.behaviour("r1").behaviour == "pursuit"

    async def test_a_wrong_token_is_closed_with_the_reason(self, fleet: PageFleet) -> None:
        async with fleet.client("guessed") as client:
            await client.until(lambda: client.closed, 5.0, "closed")
            assert client.closed is not None
            assert client.closed[0] == 4401
            assert "token" in client.closed[1]
            assert not client.hello

    async def test_a_page_of_a_stranger_may_not_even_connect(self, fleet: PageFleet) -> None:
        from websockets.exceptions import InvalidStatus

        for headers in ({"origin": "http://evil.example"}, {"additional_headers": {"Host": "evil.example"}}):
            with pytest.raises(InvalidStatus):
                async with fleet.client(**headers):
                    pass
        reader, writer = await asyncio.open_connection(*fleet.address)
        writer.write(b"GET / HTTP/1.1\r\nHost: lab-pc\r\nConnection: close\r\n\r\n")
        answer = (await reader.read()).decode()
        writer.close()
        assert " 403 " in answer
        assert f"expected {fleet.address.text}: open {fleet.address.url}" in answer
        async with fleet.client(origin=f"http://{fleet.address.text}") as client:
            await client.until(lambda: client.hello, 5.0, "a greeting")


async def test_behaviours_of_others_are_seen(fleet: PageFleet) -> None:
    async with fleet.client() as client, fleet.bus(Role.OPERATOR) as other:
        await client.until(lambda: client.details("r1").get("behaviour") == "pursuit", 10.0, "the behaviour")
        reply = await other.ask(channels.SET_BEHAVIOUR, SetBehaviour(behaviour="hold"))
        assert reply.accepted
        await client.until(lambda: client.details("r1").get("behaviour") == "hold", 5.0, "the new behaviour")
