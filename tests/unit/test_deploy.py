"""The files in deploy/ and examples/ are usable as they are."""

from pathlib import Path

import numpy as np

from basestation.localization.floor_map import FloorMap
from muro_zenoh.config import BusSettings, load_scenario
from muro_zenoh.config.cameras import camera_model
from muro_zenoh.transport.zenoh_link import zenoh_config

HERE = Path(__file__).parents[2]


def test_the_fleet_file_names_ten_robots_and_two_cameras_that_see_all_the_floor() -> None:
    fleet = load_scenario(HERE / "deploy" / "turtlebots.toml")
    assert len(fleet.robot) == 10
    assert sorted(fleet.camera) == ["north", "south"]
    xs, ys = np.meshgrid(np.linspace(-2.8, 2.8, 15), np.linspace(-2.8, 2.8, 15))
    floor = np.stack((xs.ravel(), ys.ravel()), axis=1)
    seen = np.zeros(len(floor), dtype=int)
    for name, camera in fleet.camera.items():
        pixels = FloorMap(camera_model(name, camera, fleet.arena)).to_pixels(floor)
        inside = (pixels > 10.0) & (pixels < np.array([camera.width, camera.height]) - 10.0)
        seen += inside.all(axis=1)
    assert seen.min() >= 1
    assert seen.max() == 2  # they overlap


def test_zenoh_accepts_the_router_configuration() -> None:
    config = zenoh_config(BusSettings(mode="router", connect=(), config=str(HERE / "deploy" / "router.json5")))
    assert config.get_json("mode") == '"router"'
    assert "tcp/0.0.0.0:7447" in config.get_json("listen/endpoints")


def test_the_example_is_short_and_its_scenario_reads() -> None:
    assert len((HERE / "examples" / "flock.py").read_text().splitlines()) < 25
    assert load_scenario(HERE / "examples" / "flock.toml").behaviour.name == "flock:flock"
