"""The base station's localization on a recording: the same steps, without a bus."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

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


def look_through(source: FrameSource, scenario: Scenario, camera: str) -> Iterator[Looked]:
    """The robots in each picture of a recording.

    Args:
        source: the recording.
        scenario: the settings of robots and cameras.
        camera: the one that the recording is of.

    Raises:
        CameraError: the first picture has another size than the camera's.
        ConfigError: the camera's settings are wrong.
    """
    localizer, fusion = make_localizer(scenario, camera), make_fusion(scenario)
    while True:
        try:
            shot = source.read()
        except CameraError as error:
            yield Looked(None, (), (str(error),))
            continue
        if shot is None:
            return
        try:
            robots = tuple(localizer.locate(shot.image))
        except MessageError as error:
            raise CameraError(f"{source.name}: {error}") from error
        fixes = tuple(fusion.take(Sightings(camera=camera, captured=shot.t, robots=robots), shot.t))
        doubts = tuple(text for text, captured in fusion.doubts.values() if captured == shot.t)
        yield Looked(shot, fixes, (*localizer.complaints, *doubts))
