"""Sightings: the interface between the cameras and the rest of the base station.

A fleet in virtual time has its own source of sightings and needs no pictures.
"""

from __future__ import annotations

from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Literal, Protocol

from muro_zenoh.geometry import Pose2

FrameQuality = Literal["good", "bad", "stale"]
"""``bad``: a frame that cannot be used. ``stale``: a frame that is too old."""


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """A robot in one frame.

    Attributes:
        name: of the robot.
        pose: of the base frame (origin: the middle of the axle) in the world [m, rad].
        covariance: nine floats, row-major, of x [m], y [m], theta [rad].
        inside: how far inside the picture the tag is: from 0 at the edge to 1 anywhere but near it.
    """

    name: str
    pose: Pose2
    covariance: tuple[float, ...]
    inside: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sightings:
    """The result of one frame of a camera.

    Attributes:
        camera: its name.
        captured: when the frame was captured [s, local clock].
        robots: the robots seen, each at most once; empty unless the frame is good.
        frame: whether the frame could be used.
        complaints: problems with the camera or with the tags in its view, for the operator.
        floor_off: how far from its known place each tag on the floor was seen (x, y) [m, world].
    """

    camera: str
    captured: float
    robots: tuple[Sighting, ...] = ()
    frame: FrameQuality = "good"
    complaints: tuple[str, ...] = ()
    floor_off: tuple[tuple[float, float], ...] = ()


class SightingSource(Protocol):
    """One camera, real or simulated: an asynchronous iterable of the results of its frames, in order of capture."""

    def __aiter__(self) -> AsyncIterator[Sightings]:
        """Start the camera; yields the sightings of each frame from now on."""
        ...
