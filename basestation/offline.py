"""The base station's localization of one camera: the same steps, without a bus."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from basestation.drawing import annotate
from basestation.localization.fusion import Fix
from basestation.localization.of_scenario import make_fusion, make_localizer
from basestation.localization.sightings import Sightings
from basestation.sources.source import FrameSource, Shot
from muro_zenoh.config import Scenario
from muro_zenoh.errors import CameraError, MessageError


class Looked(NamedTuple):
    """One picture of a recording, or why there is none.

    Attributes:
        shot: the picture; None for a damaged one.
        fixes: the robots in it that are believed.
        complaints: what is wrong with it, or is not believed.
    """

    shot: Shot | None
    fixes: tuple[Fix, ...]
    complaints: tuple[str, ...]


class Eye:
    """One camera's localization: picture by picture, what is seen and what is not believed.

    Args:
        scenario: the settings of robots and cameras.
        camera: its name.

    Raises:
        ConfigError: the camera's settings are wrong.
    """

    def __init__(self, scenario: Scenario, camera: str) -> None:
        self._camera = camera
        self._localizer, self._fusion = make_localizer(scenario, camera), make_fusion(scenario)
        self._mounts = {name: robot.mount for name, robot in scenario.robot.items() if robot.tag is not None}

    def look(self, shot: Shot) -> Looked:
        """What is in the next picture.

        Args:
            shot: the picture, later than the one before.

        Raises:
            CameraError: it has another size than the camera's.
        """
        try:
            robots = tuple(self._localizer.locate(shot.image))
        except MessageError as error:
            raise CameraError(f"camera {self._camera}: {error}") from error
        floor_off = self._localizer.floor_off
        seen = Sightings(camera=self._camera, captured=shot.t, robots=robots, floor_off=floor_off)
        fixes = tuple(self._fusion.take(seen, shot.t))
        doubts = tuple(text for text, captured in self._fusion.doubts.values() if captured == shot.t)
        return Looked(shot, fixes, (*self._localizer.complaints, *self._fusion.moved.values(), *doubts))

    def draw(self, shot: Shot, looked: Looked) -> NDArray[np.uint8]:
        """The picture with names, axes and the reasons for what is not believed.

        Args:
            shot: the picture.
            looked: what is in it.

        Returns:
            (height, width, 3) blue, green, red.
        """
        return annotate(shot.image, self._localizer.floor.camera, looked.fixes, self._mounts, looked.complaints)


def look_through(source: FrameSource, eye: Eye) -> Iterator[Looked]:
    """The robots in each picture of a recording.

    Args:
        source: the recording.
        eye: looks at it.

    Raises:
        CameraError: a picture has another size than the camera's.
    """
    while True:
        try:
            shot = source.read()
        except CameraError as error:
            yield Looked(None, (), (str(error),))
            continue
        if shot is None:
            return
        yield eye.look(shot)
