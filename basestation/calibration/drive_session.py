"""Calibration by a drive, as a fleet's settings say."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Final

import numpy as np

from basestation.calibration.bundle import Distance
from basestation.calibration.camera import Camera
from basestation.calibration.drive import DriveFit, fit_drive
from basestation.calibration.files import lens_of, placed_camera, read_lens
from basestation.calibration.floor_error import FloorError
from basestation.calibration.lens_prior import LensPrior
from basestation.calibration.shared_map import shared_error
from basestation.calibration.sources import floor_tag
from basestation.calibration.tag_tracks import Seen, knots_of, load_tags, look_for_tags, make_search, save_tags
from basestation.sources.recordings import open_recording
from muro_zenoh.config import Scenario
from muro_zenoh.errors import CalibrationError, ConfigError
from muro_zenoh.geometry import Pose2

_PLACES: Final = 100
"""Of the robot that are used."""
_MEASURED: Final = 0.001
"""Standard deviation of a distance that was measured with a tape [m]."""


class DriveSession:
    """A drive under the cameras of a fleet.

    Args:
        scenario: the fleet's settings.
        robot: its name.
        lenses: files of the cameras' lenses; a camera that is not there has its calibration's.
        heights: of cameras above the floor, measured [m].
        distance: numbers of two floor tags, and the distance of their middles, measured [m].
        start: where the robot's base is when it is seen first [world].
        frame: the camera whose calibration says how the map lies; by default all that have one do, and must agree.

    Raises:
        ConfigError: an unknown robot or camera, a robot without a tag, a camera without a lens, or one for the frame
            without a calibration.
    """

    def __init__(
        self,
        scenario: Scenario,
        robot: str,
        *,
        lenses: Mapping[str, Path],
        heights: Mapping[str, float],
        distance: tuple[int, int, float] | None,
        start: Pose2,
        frame: str | None = None,
    ) -> None:
        if robot not in scenario.robot:
            raise ConfigError("robot", got=repr(robot), expected=f"one of {', '.join(scenario.robot)}")
        for name in (*lenses, *heights, *(() if frame is None else (frame,))):
            if name not in scenario.camera:
                raise ConfigError("camera", got=repr(name), expected=f"one of {', '.join(scenario.camera)}")
        if frame is not None and scenario.camera[frame].calibration is None:
            raise ConfigError("--frame", got=f"{frame!r}, which has no calibration", expected="a camera that has one")
        if scenario.robot[robot].tag is None:
            raise ConfigError(f"robot.{robot}.tag", got="no tag", expected="the id of its tag")
        self.scenario = scenario
        self.robot = robot
        self.mount = scenario.robot[robot].mount
        self._lenses = lenses
        self._heights = heights
        self._distance = distance
        self._frame = frame
        self._start = start.compose(self.mount.pose)

    def look(self, camera: str, path: Path, rate: float, seconds: float, on_picture: Callable[[], None]) -> list[Seen]:
        """The tags in a camera's recording.

        Args:
            camera: its name.
            path: a video or a directory of images.
            rate: images per second of a directory [Hz].
            seconds: of the recording to look at [s].
            on_picture: called after each picture.

        Raises:
            ConfigError: no such camera.
            CameraError: no recording.
        """
        if camera not in self.scenario.camera:
            raise ConfigError("--recording", got=repr(camera), expected=f"one of {', '.join(self.scenario.camera)}")
        source = open_recording(path, rate)
        try:
            search = make_search(self.scenario, camera, self.mount.id)
            return look_for_tags(camera, source, search, seconds, on_picture)
        finally:
            source.close()

    def load(self, path: Path) -> list[Seen]:
        """Detections that were saved.

        Args:
            path: the file.
        """
        return load_tags(path)

    def save(self, path: Path, rows: Iterable[Seen]) -> None:
        """Save detections.

        Args:
            path: the file.
            rows: what was seen.
        """
        save_tags(path, rows)

    def fit(self, rows: list[Seen]) -> tuple[DriveFit, FloorError]:
        """Place the cameras.

        Args:
            rows: what they saw.

        Raises:
            CalibrationError: a bad drive, with what is wrong and what to do.
            ConfigError: a camera without a lens.
        """
        names = [name for name in self.scenario.camera if any(row.camera == name for row in rows)]
        if not names:
            raise CalibrationError("no camera of the fleet file saw any tag. Are the recordings of its cameras?")
        priors = {name: self._prior(name) for name in names}
        knots = knots_of(rows, names, self.mount.id, _PLACES)
        # Interpolated between two pictures, a corner is as good as in one of them.
        sigma = max(self.scenario.camera[name].sigma_pixels for name in names)
        result = fit_drive(
            priors,
            knots,
            size=self.mount.size,
            height=self.mount.z,
            sigma_pixels=sigma,
            robot=self.robot,
            distance=self._measured(rows, names),
            heights={name: metres for name, metres in self._heights.items() if name in names},
            known=self._known(names),
            start=self._start,
            floor=self.scenario.arena,
        )
        error = shared_error(result.cameras, result.covariance, self.scenario.arena, self.mount.z)
        return result, error

    def _prior(self, name: str) -> LensPrior:
        settings = self.scenario.camera[name]
        if name in self._lenses:
            prior = read_lens(self._lenses[name])
        elif settings.calibration is not None:
            prior = lens_of(settings.calibration)
        else:
            raise ConfigError(
                f"camera.{name}", got="no lens", expected=f"--lens {name}=FILE, from muro calibrate intrinsics"
            )
        got, size = (prior.camera.width, prior.camera.height), (settings.width, settings.height)
        if got != size:
            raise ConfigError(
                f"camera.{name}",
                got=f"a lens for {got[0]} x {got[1]} pixels",
                expected=f"one for {size[0]} x {size[1]}",
            )
        return prior

    def _known(self, names: list[str]) -> dict[str, Camera]:
        if self._frame is not None and self._frame not in names:
            raise CalibrationError(f"camera {self._frame} of --frame saw no tag, expected it to see {self.robot}")
        given = {name: self.scenario.camera[name].calibration for name in names if self._frame in (None, name)}
        return {name: placed_camera(settings) for name, settings in given.items() if settings is not None}

    def _measured(self, rows: list[Seen], names: list[str]) -> Distance | None:
        if self._distance is None:
            return None
        first, second, metres = self._distance
        pixels = {}
        for name in names:
            ends = [
                np.stack([row.corners for row in rows if row.camera == name and row.tag == tag])
                for tag in (first, second)
                if any(row.camera == name and row.tag == tag for row in rows)
            ]
            if len(ends) == 2:
                tags = (floor_tag(first, ends[0]), floor_tag(second, ends[1]))
                pixels[name] = np.stack([tag.middle for tag in tags])
        if not pixels:
            raise CalibrationError(
                f"no camera saw both floor tags {first} and {second}, expected them in the picture of one camera"
            )
        return Distance(metres, _MEASURED, pixels)
