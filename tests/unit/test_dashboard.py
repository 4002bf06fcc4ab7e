"""The parts of the page: who may, what it says first, states as bytes, a robot's state in a word."""

from __future__ import annotations

import math
import socket
import stat
from pathlib import Path

import msgpack
import numpy as np
import pytest

from basestation.dashboard import access
from basestation.dashboard import offer as offering
from basestation.dashboard.access import Access, Address, Right, Tokens, address_of, tokens_in
from basestation.dashboard.describing import describe, describe_faults
from basestation.dashboard.events import Events
from basestation.dashboard.frames import Frames
from basestation.dashboard.offer import Offer, listen, offer, tokens_beside
from basestation.dashboard.pictures import Rectifier
from basestation.dashboard.processes import Processes
from basestation.dashboard.requests import BadMessage, read_order
from basestation.dashboard.ring import RingOf
from basestation.dashboard.watching import state_of
from basestation.localization.floor_map import FloorMap
from muro_zenoh.behaviours import table
from muro_zenoh.config import Scenario, parse_scenario, read_parameters
from muro_zenoh.config.cameras import camera_model
from muro_zenoh.errors import ConfigError, MissingExtra
from muro_zenoh.geometry import Circle
from muro_zenoh.messages import Behaviour, Frame, Goal, Health, RobotState, StopOrder
from muro_zenoh.optics.jpeg import encode_jpeg
from muro_zenoh.transport import Received

TOKENS = Tokens("look", "steer")
LOCAL = Access(Address("127.0.0.1", 8010), TOKENS)
OPEN = Access(Address("0.0.0.0", 8010), TOKENS)


def lab(**more: object) -> Scenario:
    return parse_scenario(
        {"robots": 2, "camera": {"north": {}, "south": {"tilt": 0.3}}, **more}, "lab.toml", name="lab"
    )


class TestAccess:
    @pytest.mark.parametrize(
        ("protocols", "local", "elsewhere"),
        [
            (["muro"], Right.VIEW, Right.NONE),
            (["muro", "token.look"], Right.VIEW, Right.VIEW),
            (["muro", "token.steer"], Right.STEER, Right.STEER),
            (["muro", "token."], Right.NONE, Right.NONE),
            (["muro", "token.steer "], Right.NONE, Right.NONE),
            (["muro", "token.é"], Right.NONE, Right.NONE),
        ],
    )
    def test_rights(self, protocols: list[str], local: Right, elsewhere: Right) -> None:
        assert LOCAL.right(protocols) is local
        assert OPEN.right(protocols) is elsewhere

    def test_hosts(self) -> None:
        for host in ("127.0.0.1:8010", "localhost:8010", "[::1]:8010", "LOCALHOST:8010"):
            assert LOCAL.admits_host(host), host
        for host in (
            "",
            "127.0.0.1",
            "127.0.0.1:80",
            "evil.example:8010",
            "127.0.0.1:8010.evil.example",
            "10.0.0.1:8010",
        ):
            assert not LOCAL.admits_host(host), host
        for host in ("127.0.0.1", "localhost", "[::1]", "127.0.0.1:80"):  # browsers leave out the port 80
            assert Access(Address("127.0.0.1", 80), TOKENS).admits_host(host), host
        assert not Access(Address("127.0.0.1", 80), TOKENS).admits_host("evil.example")
        assert OPEN.admits_host("10.0.0.1:8010")
        assert not OPEN.admits_host("evil.example:8010")

    def test_origins(self) -> None:
        assert LOCAL.admits_origin(None, "localhost:8010")
        assert LOCAL.admits_origin("http://localhost:8010", "localhost:8010")
        for origin in ("http://localhost:8011", "http://127.0.0.1:8010", "http://evil.example", "null", ""):
            assert not LOCAL.admits_origin(origin, "localhost:8010"), origin

    def test_tokens_are_made_once_and_are_the_owners(self, tmp_path: Path) -> None:
        file = tokens_beside(tmp_path / "state.json")
        tokens = tokens_in(file)
        assert len({*tokens}) == 2
        assert all(len(token) >= 20 for token in tokens)
        assert tokens_in(file) == tokens
        assert stat.S_IMODE(file.stat().st_mode) == 0o600
        file.write_text('{"viewer": "x"}')
        with pytest.raises(ConfigError, match="Remove the file"):
            tokens_in(file)


class TestOffer:
    @pytest.mark.parametrize(
        "text", ["", "8010", "localhost", ":8010", "127.0.0.1:99999", "127.0.0.1:x", "127.0.0.1:²"]
    )
    def test_what_is_no_address(self, text: str) -> None:
        with pytest.raises(ConfigError, match="expected HOST:PORT"):
            address_of(text)

    def test_addresses(self, monkeypatch: pytest.MonkeyPatch) -> None:
        assert address_of("[::1]:80") == Address("::1", 80)
        assert address_of("[::1]:80").url == "http://[::1]:80"
        monkeypatch.setattr(access, "_ELSEWHERE", {"0.0.0.0": (socket.AF_INET, "127.0.0.1")})
        assert address_of("0.0.0.0:80").url == "http://127.0.0.1:80", "a phone may not know the name of this machine"
        assert [Address(host, 1).is_local for host in ("::1", "127.0.0.2", "localhost", "0.0.0.0", "lab")] == [
            *(True, True, True, False, False)
        ]

    def test_a_default_port_that_is_taken(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        taken = listen("127.0.0.1", 0)
        try:
            port = taken.getsockname()[1]
            monkeypatch.setattr(offering, "DEFAULT", Address("127.0.0.1", port))
            offered = offer(None, tmp_path / "tokens.json")
            assert isinstance(offered, Offer)
            assert offered.address.port not in (port, 0)
            assert (
                offered.lines[0]
                == f"port {port} is in use, so the page of this fleet is on port {offered.address.port}"
            )
            assert offered.lines[1] == f"page: {offered.address.url}/#token={offered.tokens.operator}"
            asked = offer(f"127.0.0.1:{port}", tmp_path / "tokens.json")
            assert isinstance(asked, Offer)
            assert asked.address.port == port, "the page of the base station before may leave it in a moment"
        finally:
            taken.close()

    def test_a_link_to_look_elsewhere_has_a_token(self, tmp_path: Path) -> None:
        offered = offer("0.0.0.0:0", tmp_path / "tokens.json")
        assert isinstance(offered, Offer)
        assert offered.lines[-1].endswith(f"/#token={offered.tokens.viewer}")

    def test_an_address_of_another_machine(self, tmp_path: Path) -> None:
        with pytest.raises(ConfigError, match="expected an address of this machine"):
            offer("203.0.113.1:8010", tmp_path / "tokens.json")

    def test_a_base_station_starts_without_a_page_rather_than_not_at_all(self, tmp_path: Path) -> None:
        said = offer(None, tmp_path / "nowhere" / "tokens.json")
        assert isinstance(said, str)
        assert said.startswith("no page: ")
        with pytest.raises(ConfigError):
            offer("127.0.0.1:0", tmp_path / "nowhere" / "tokens.json")

    def test_without_the_extra(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(offering, "_PACKAGES", ("no_such_web_server",))
        said = offer(None, tmp_path / "tokens.json")
        assert isinstance(said, str)
        assert said.startswith("no page: ")
        assert "muro-zenoh[web]" in said
        with pytest.raises(MissingExtra):
            offer("127.0.0.1:0", tmp_path / "tokens.json")


class TestDescribing:
    @pytest.mark.parametrize("name", table.names())
    def test_every_parameter_is_described_as_it_is_read(self, name: str) -> None:
        """With its defaults, choices and limits, as the command line would take it."""
        kind = table.built_in(name)
        described = describe(lab())["behaviours"][name]
        assert described["summary"] == kind.summary
        given = {
            key: parameter["default"]
            for key, parameter in described["parameters"].items()
            if parameter["default"] is not None
            and (
                parameter["when"] is None
                or described["parameters"][parameter["when"][0]]["default"] in parameter["when"][1]
            )
        }
        assert read_parameters(kind, given, "page") == kind.parameters()
        for key, parameter in described["parameters"].items():
            assert parameter["doc"], key
            limits = [(end, parameter[end]) for end in ("at_least", "above") if parameter[end] is not None]
            for end, limit in limits:
                wrong = {key: limit - (1.0 if end == "at_least" else 0.0)}
                if parameter["when"] is None:
                    with pytest.raises(ConfigError, match=key):
                        read_parameters(kind, wrong, "page")

    def test_the_scenarios_own_behaviour_is_offered_with_the_parameters_of_its_table(self) -> None:
        own = {"name": "flock:flock", "gain": 2, "near": True, "rows": [1.0, 2.0], "colour": "red"}
        described = describe(parse_scenario({"robots": 1, "behaviour": own}, "lab.toml", name="lab"))["behaviours"]
        assert {*table.names(), "flock:flock"} == described.keys()
        flock = described["flock:flock"]
        assert {key: (one["type"], one["default"]) for key, one in flock["parameters"].items()} == {
            "gain": ("number", 2),
            "near": ("boolean", True),
            "rows": ("array", [1.0, 2.0]),
            "colour": ("text", "red"),
        }
        assert flock["parameters"]["gain"].keys() == described["circle"]["parameters"]["speed"].keys()
        assert {"circle"} < {*flock["needs"]}
        assert "goal" not in flock["needs"]

    def test_cameras_see_the_floor(self) -> None:
        described = describe(lab())["cameras"]
        corners = np.array(described["north"]["outline"])
        assert corners[:, 0].min() < -2.1
        assert corners[:, 0].max() > 2.1

    def test_walls_are_described_as_they_are_drawn(self) -> None:
        wall = {"start": [0.0, -1.5], "end": [0.0, -0.4]}
        assert describe(lab())["walls"] == []
        assert describe(lab(wall=[wall]))["walls"] == [[0.0, -1.5, 0.0, -0.4]]

    def test_faults_have_targets_that_a_run_has(self) -> None:
        faults = describe_faults(lab())
        assert faults["crash"]["targets"] == ["r1/agent", "r2/agent", "basestation", "router"]
        assert faults["delay"]["targets"] == ["r1/agent", "r2/agent"]
        assert faults["carry"]["targets"] == ["r1", "r2"]
        assert faults["camera_dropout"]["targets"] == ["camera", "camera/north", "camera/south"]
        assert faults["delay"]["parameters"].keys() == {"delay", "direction"}
        assert faults["delay"]["parameters"]["delay"]["at_most"] == 10.0
        assert faults["delay"]["parameters"]["delay"]["required"]
        assert not faults["carry"]["parameters"]["x"]["required"]


class TestFrames:
    def test_what_is_slow_comes_once(self) -> None:
        frames = Frames()
        frames.set_part("stop", {"all": False})
        frames.set_detail("r1", {"state": "driving"})
        frames.add_event([1, 0.0, "r1", "driving"], 2)
        frames.set_state(1.5, {"r1": (0.5, None)})
        whole = msgpack.unpackb(frames.since(-1))
        assert whole == {
            "kind": "state",
            "t": 1.5,
            "seq": 1,
            "robots": {"r1": [0.5, None]},
            "stop": {"all": False},
            "details": {"r1": {"state": "driving"}},
            "events": [[1, 0.0, "r1", "driving"]],
        }
        known = frames.revision
        frames.set_part("stop", {"all": False})
        frames.set_state(1.55, {"r1": (0.5, None)})
        assert msgpack.unpackb(frames.since(known)).keys() == {"kind", "t", "seq", "robots"}
        frames.set_part("stop", {"all": True})
        assert msgpack.unpackb(frames.since(known))["stop"] == {"all": True}
        assert "details" not in msgpack.unpackb(frames.since(known))

    def test_only_the_last_events_are_kept(self) -> None:
        frames = Frames()
        events = Events(frames)
        for number in range(150):
            events.add(float(number), "r1", "x")
        frames.set_state(0.0, {})
        kept = msgpack.unpackb(frames.since(-1))["events"]
        assert [number for number, *_ in kept] == list(range(51, 151))

    def test_clients_with_the_same_parts_share_the_bytes(self) -> None:
        frames = Frames()
        frames.set_state(0.0, {"r1": (1.0,)})
        assert frames.since(0) is frames.since(0)


def heard(health: Health | None, at: float = 100.0) -> Received[Health] | None:
    return None if health is None else Received("r1", health, at, 0.0, 0.0)


def robot(state: str, age: float = 0.05) -> RobotState:
    return RobotState("r1", 0.0, 0.0, 0.0, 0.0, 0.0, age, state)  # type: ignore[arg-type]


DRIVES = Health(role="agent", state="pursuit")
HOLDS = Health(role="agent", state="holding", reasons=("no goal",))
STOPPED = Health(role="agent", state="stopped", reasons=("stopped by order",), stop_latched=True)
FAILED = Health(role="agent", state="failed", failure="out of water")
LOST = "no camera has seen it for 7 s; it stays an obstacle where it was"


@pytest.mark.parametrize(
    ("seen", "silent", "health", "alive", "expected"),
    [
        (robot("tracking"), 0.05, heard(DRIVES), True, ("driving", "")),
        (robot("disagrees"), 0.05, heard(DRIVES), True, ("driving", "")),
        (robot("tracking"), 0.05, heard(HOLDS), True, ("holding", "no goal")),
        (robot("tracking"), 0.05, heard(STOPPED), True, ("stopped", "stopped by order")),
        (robot("tracking"), 0.05, heard(FAILED), True, ("failed", "out of water")),
        (robot("tracking"), 0.05, heard(DRIVES, 90.0), True, ("stale", "no report from its agent for 10 s")),
        (robot("tracking"), 0.05, None, True, ("holding", "no report from its agent yet")),
        (robot("tracking"), 9.0, heard(DRIVES), True, ("stale", "no positions from the base station for 9 s")),
        (robot("tracking"), math.nan, heard(DRIVES), True, ("stale", "no positions from the base station for nan s")),
        (robot("stale", 0.7), 0.05, heard(DRIVES), True, ("stale", "no camera has seen it for 0.7 s")),
        (robot("lost", 7.0), 0.05, heard(DRIVES), True, ("lost", LOST)),
        (None, 0.05, heard(DRIVES), True, ("unseen", "no camera has seen it yet")),
        (robot("tracking"), 0.05, heard(DRIVES), False, ("absent", "no agent is running for it")),
        (None, math.inf, None, False, ("absent", "no agent is running for it; no camera has seen it yet")),
    ],
)  # fmt: skip
def test_a_robots_state_and_its_reason(
    seen: RobotState | None, silent: float, health: Received[Health] | None, alive: bool, expected: tuple[str, str]
) -> None:
    assert state_of(seen, silent, health, 100.05, alive) == expected


def test_events_are_changes_and_not_ages() -> None:
    frames = Frames()
    events = Events(frames)
    events.robot(1.0, "r1", "holding", "no pose for 0.3 s")
    events.robot(2.0, "r1", "holding", "no pose for 1.3 s")
    events.robot(3.0, "r1", "driving", "")
    events.processes(1.0, {("agent", "r1")})
    events.processes(2.0, set())
    events.stop(2.0, StopOrder(all=False))
    events.stop(3.0, StopOrder(all=True))
    events.stop(4.0, StopOrder(all=False))
    for _ in range(2):
        events.behaviour(5.0, "r1", Behaviour(behaviour="circle", parameters={"speed": 0.1}))
        events.circle(5.0, Circle(0.0, 0.0, 0.8))
    events.behaviour(6.0, "r1", None)
    events.behaviour(6.0, "r1", Behaviour(behaviour="dubins", parameters={"turning_radius": 0.3}))
    events.circle(6.0, Circle(0.5, 0.0, 0.6, clockwise=True))
    events.goal(7.0, "r1", Goal(x=1.0, y=-0.5, theta=math.pi / 2))
    events.goal(7.0, "r1", Goal(x=1.0, y=-0.5))
    frames.set_state(0.0, {})
    assert [text for *_, text in msgpack.unpackb(frames.since(-1))["events"]] == [
        "holding: no pose for 0.3 s",
        "driving",
        "agent is gone",
        "stop: every robot",
        "no robot is stopped any longer",
        "behaviour dubins with turning_radius = 0.3",
        "circle round (0.50, 0.00) m, radius 0.60 m, clockwise",
        "goal (1.00, -0.50) m, heading 90°",
        "goal (1.00, -0.50) m",
    ]


def test_robots_spread_evenly_or_by_the_importance() -> None:
    ring = RingOf(lab())
    evenly = Behaviour(behaviour="pursuit")
    table = {"pursuit": "importance", "angles": [0.0, 3.0], "weights": [1.0, 2.0]}
    weighted = Behaviour(behaviour="pursuit", parameters=table)
    assert ring.spreading({"r1": evenly, "r2": Behaviour(behaviour="hold")}) == ["r1"]
    assert ring.spreading({"r1": weighted, "r2": weighted}) == ["r1", "r2"]


def test_processes_with_what_they_use() -> None:
    rows = Processes()
    first = Health(stamp=100.0, role="agent", state="x", numbers={"cpu_s": 1.0, "pose_received": 10, "memory_mb": 40.0})
    numbers = {"cpu_s": 1.1, "pose_received": 30, "pose_age_s": 0.044, "pose_dropped": 2, "camera_rejected": 1}
    then = Health(stamp=102.0, role="agent", state="x", numbers=numbers)
    alive = {("agent", "r1"), ("basestation", "basestation")}
    assert rows.rows(100.0, {"r1": Received("r1", first, 100.0, 0.0, 0.0)}, alive)["r1"]["cpu"] is None
    for _ in range(2):
        found = rows.rows(102.5, {"r1": Received("r1", then, 102.0, 0.0, 0.0)}, alive)
    assert found["r1"] == {
        "role": "agent",
        "alive": True,
        "state": "x",
        "age": 0.5,
        "reasons": [],
        "complaints": [],
        "cpu": 5.0,
        "memory": None,
        "rates": {"pose": 10.0},
        "ages": {"pose": 0.04},
        "drops": 2,
        "rejects": 1,
    }
    assert found["basestation"]["age"] is None
    assert rows.rows(103.0, {"r1": Received("r1", then, 102.0, 0.0, 0.0)}, set())["r1"]["alive"] is False


def test_processes_that_were_never_started_are_missing() -> None:
    rows = Processes(["r1", "r2"], ["north"])
    health = Health(stamp=100.0, role="agent", state="x")
    found = rows.rows(100.0, {"r1": Received("r1", health, 100.0, 0.0, 0.0)}, {("agent", "r1"), ("base", "r2")})
    assert {name: (row["role"], row["state"], row["alive"]) for name, row in found.items()} == {
        "north": ("camera", "missing", False),
        "r1": ("agent", "x", True),
        "r2": ("agent", "missing", False),
        "r2/base": ("base", "", True),
    }
    assert found["r2"].keys() == found["r1"].keys()
    assert "north" not in rows.rows(101.0, {}, {("simulator", "simulator")}), "the simulator films"


@pytest.mark.parametrize("camera", ["north", "south"])
def test_a_picture_shows_each_place_of_the_floor_where_it_is(camera: str) -> None:
    """At most 3 px off: a dot that a camera sees at a place is in the rectified picture at that place."""
    scenario = lab()
    view = FloorMap(camera_model(camera, scenario.camera[camera], scenario.arena))
    rectifier = Rectifier(view, 0.15, scenario.arena)
    area = rectifier.area
    for x, y in ((0.0, 0.0), (0.7, 0.4), (-0.9, -0.3), (1.2, 0.2)):
        picture = np.zeros((view.camera.height, view.camera.width), dtype=np.uint8)
        u, v = view.to_pixels(np.array([x, y]), 0.15).tolist()
        picture[round(v) - 2 : round(v) + 3, round(u) - 2 : round(u) + 3] = 255
        jpeg = encode_jpeg(picture, 95)
        frame = Frame(stamp=1.0, width=view.camera.width, height=view.camera.height, format="jpeg", data=jpeg)
        flat = decoded(rectifier.picture(frame))
        rows, columns = np.nonzero(flat > 100)
        tall, wide = flat.shape
        found_x = area.x_min + (columns.mean() + 0.5) * (area.x_max - area.x_min) / wide
        found_y = area.y_max - (rows.mean() + 0.5) * (area.y_max - area.y_min) / tall
        pixel = (area.x_max - area.x_min) / wide
        assert math.hypot(found_x - x, found_y - y) < 1.5 * pixel


def decoded(jpeg: bytes) -> np.ndarray:
    import cv2

    return np.asarray(cv2.imdecode(np.frombuffer(jpeg, dtype=np.uint8), cv2.IMREAD_GRAYSCALE))


@pytest.mark.parametrize(
    "order",
    [
        {},
        {"order": "stop"},
        {"order": "stop", "id": -1},
        {"order": "stop", "id": 1, "names": ["R1"]},
        {"order": "stop", "id": 1, "extra": 1},
        {"order": "fly", "id": 1},
        {"order": "goal", "id": 1, "name": "r1", "x": "0", "y": 0.0},
        {"order": "picture", "id": 1, "camera": "north", "on": 1},
        {"order": "behaviour", "id": 1, "behaviour": "x" * 200},
    ],
)
def test_what_is_no_order(order: dict[str, object]) -> None:
    with pytest.raises(BadMessage, match="not an order"):
        read_order(msgpack.packb(order))
