"""`muro camera` on the bus: a recording is played, the base station makes poses of it, and the process ends."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from muro_zenoh import channels
from muro_zenoh.channels import Role
from muro_zenoh.config import load_scenario
from muro_zenoh.config.cameras import camera_model
from muro_zenoh.runtime.process import OK
from muro_zenoh.simulation.camera import OverheadCamera
from muro_zenoh.transport import open_bus
from tests.support.process import Process
from tests.support.router import router
from tests.support.waiting import within

MURO = ("-m", "muro_zenoh")
POSE = (0.3, -0.2, 0.5)


async def test_a_recording_becomes_poses(tmp_path: Path) -> None:
    lab = tmp_path / "lab.toml"
    lab.write_text("robots = 1\n[camera.north]\nwidth = 640\nheight = 480\nrate = 10\n")
    scenario = load_scenario(lab)
    robot = scenario.robot["r1"]
    lens = OverheadCamera(camera_model("north", scenario.camera["north"], scenario.arena))
    rng = np.random.default_rng(0)
    frames = tmp_path / "frames"
    frames.mkdir()
    for k in range(40):
        picture = lens.render(np.array([POSE]), [robot.mount], [robot.radius], rng)
        cv2.imwrite(str(frames / f"{k:03d}.png"), picture)
    with router() as there:
        connect = ("--connect", there.endpoint)
        async with open_bus(there.settings(), Role.OPERATOR) as bus:
            poses = bus.every(channels.POSE, "r1")
            station = (*MURO, "basestation", str(lab), "--state", str(tmp_path / "state.json"), *connect)
            filming = (*MURO, "camera", str(lab), "north", "--recording", str(frames), *connect)
            with Process(station, name="basestation") as base:
                base.ready()
                with Process(filming, name="camera") as camera:
                    camera.ready()
                    fix = (await within(20, poses.next(), "a pose")).message
                    assert abs(fix.x - POSE[0]) < 0.003
                    assert abs(fix.y - POSE[1]) < 0.003
                    assert fix.camera == "north"
                    assert camera.wait() == OK, camera.last_lines()
