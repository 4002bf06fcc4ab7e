"""What cameras see, as values: the seam between the cameras and the rest of the base station.

A fleet in virtual time gives the base station a source of its own and needs no pictures.
"""

from __future__ import annotations

from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Literal, Protocol

from muro_zenoh.geometry import Pose2

FrameQuality = Literal["good", "bad", "stale"]
"""``bad``: a frame that cannot be used. ``stale``: one that is too old to be used."""


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """A robot as one frame shows it.

    Attributes:
        name: of the robot.
        pose: of the base frame (origin: the middle of the axle) in the world [m, rad].
        covariance: nine floats, row-major, of x [m], y [m], theta [rad].
    """

    name: str
    pose: Pose2
    covariance: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sightings:
    """What one frame of a camera shows.

    Attributes:
        camera: its name.
        captured: when the frame was taken [s, local clock].
        robots: each at most once; none in a frame that is not good.
        frame: whether the frame could be used.
        complaints: what is wrong with the camera or with the tags in its view, for the operator.
    """

    camera: str
    captured: float
    robots: tuple[Sighting, ...] = ()
    frame: FrameQuality = "good"
    complaints: tuple[str, ...] = ()


class SightingSource(Protocol):
    """One camera, real or not: an asynchronous iterable of what its frames show, in the order of their capture."""

    def __aiter__(self) -> AsyncIterator[Sightings]:
        """Begin to watch; the sightings of each frame that comes in from now on."""
        ...
