"""Opens the source that an operator has named."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from basestation.sources.device import Device
from basestation.sources.recordings import open_recording
from basestation.sources.source import FrameSource
from muro_zenoh.config import Scenario
from muro_zenoh.errors import ConfigError


def opener(
    scenario: Scenario, name: str, device: str | None, recording: Path | None, rate: float | None = None
) -> Callable[[], FrameSource]:
    """What opens a camera's source.

    Args:
        scenario: the settings.
        name: of the camera.
        device: number or path of a device; None for the first one.
        recording: a video or a directory of images, instead of a device.
        rate: pictures per second to ask a device for, or of a directory of images; None for the settings' [Hz].

    Returns:
        A function that opens it; it raises a CameraError when that is not possible.

    Raises:
        ConfigError: the settings have no such camera, or there is no such recording.
    """
    if name not in scenario.camera:
        known = ", ".join(scenario.camera) or "none: the fleet has no camera"
        raise ConfigError("NAME", got=repr(name), expected=f"one of {known}")
    settings = scenario.camera[name]
    rate = rate or settings.rate
    if recording is not None:
        if not recording.exists():
            raise ConfigError(
                "--recording", got=str(recording), expected="a video or a directory of images: no such file"
            )
        return partial(open_recording, recording, rate)
    given = device or "0"
    which = int(given) if given.isdigit() else given
    return partial(Device, which, settings.width, settings.height, rate)
