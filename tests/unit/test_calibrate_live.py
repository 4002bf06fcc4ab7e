"""A drive as the running cameras see it, over the in-memory bus in virtual time."""

from __future__ import annotations

import asyncio

import numpy as np
import pytest

from basestation.calibration import tag_tracks
from basestation.calibration.watching import watch_drive
from muro_zenoh import channels
from muro_zenoh.config import parse_scenario
from muro_zenoh.config.cameras import camera_models
from muro_zenoh.messages import Frame
from muro_zenoh.runtime.virtual_time import InlineExecutor, VirtualClock, run_virtually
from muro_zenoh.simulation.camera import OverheadCamera
from muro_zenoh.transport import MemoryNetwork, make_bus

LAB = parse_scenario(
    {"robots": 1, "camera": {name: {"width": 640, "height": 360, "latency": 0.03} for name in ("north", "south")}},
    "lab.toml",
    name="lab",
)


def test_the_drive_is_searched_with_the_cameras_own_detector(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[tuple[str, str]] = []
    monkeypatch.setattr(tag_tracks, "TagDetector", lambda family, library: made.append((family, library)))
    camera = {"north": {"family": "DICT_APRILTAG_36h11", "detector": "apriltag"}}
    lab = parse_scenario({"robots": 1, "camera": camera}, "lab.toml", name="lab")
    tag_tracks.make_search(lab, "north", 0)
    assert made == [("DICT_APRILTAG_36h11", "apriltag")]


def test_both_cameras_tags_come_with_their_capture_times_and_damaged_pictures_do_not() -> None:
    robot = LAB.robot["r1"]
    models = camera_models(LAB.camera, LAB.arena)
    films = {name: OverheadCamera(model) for name, model in models.items()}
    rng = np.random.default_rng(0)
    looked = []

    async def main() -> None:
        network, clock = MemoryNetwork(), VirtualClock()
        async with make_bus(network.link(), clock=clock) as room, make_bus(network.link(), clock=clock) as bus:
            begin = clock.now()
            watch = watch_drive(bus, LAB, robot.mount.id, 2.0, InlineExecutor(), lambda: looked.append(1))
            watching = asyncio.create_task(watch)
            await asyncio.sleep(0.01)
            frames = {name: room.publisher(channels.CAMERA, name) for name in films}
            sent = []
            for k in range(12):
                captured = clock.now()
                await asyncio.sleep(0.03)
                for name, film in films.items():
                    grey = film.render(np.array([(0.03 * k, 0.1, 0.2)]), [robot.mount], [robot.radius], rng).tobytes()
                    data = grey[:-1] if k == 5 else grey
                    frames[name].put(Frame(stamp=captured, width=640, height=360, format="grey", data=data))
                sent.append(captured)
                await asyncio.sleep(0.02)
            rows = await watching
            assert clock.now() - begin == pytest.approx(2.0, abs=0.1)
            for name in models:
                mine = [row for row in rows if row.camera == name]
                assert [row.t for row in mine] == pytest.approx(sent[:5] + sent[6:], abs=1e-3)
                for row, k in zip(mine, (*range(5), *range(6, 12)), strict=True):
                    corners = films[name].tag_corners(np.array((0.03 * k, 0.1, 0.2)), robot.mount)
                    assert row.corners == pytest.approx(corners, abs=0.25)
            assert len(looked) == 22

    run_virtually(main())
