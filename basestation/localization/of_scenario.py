"""Localizers and fusion as a scenario's settings say."""

from __future__ import annotations

from basestation.localization.belief import Reach
from basestation.localization.detector import TagDetector
from basestation.localization.floor_map import FloorMap
from basestation.localization.fusion import Fusion
from basestation.localization.localizer import Localizer
from muro_zenoh.config import Scenario
from muro_zenoh.config.cameras import camera_model
from muro_zenoh.errors import ConfigError


def make_localizer(scenario: Scenario, name: str) -> Localizer:
    """The localizer of a camera.

    Args:
        scenario: the settings.
        name: of the camera.

    Raises:
        ConfigError: the camera's points do not determine a homography, or its family of tags is unknown.
        MissingExtra: the library of its detector is not installed.
    """
    camera = scenario.camera[name]
    tags = {robot.tag: (key, robot.mount) for key, robot in scenario.robot.items() if robot.tag is not None}
    try:
        detector = TagDetector(camera.family, camera.detector)
    except ValueError as error:
        raise ConfigError(f"camera.{name}.family", got=repr(camera.family), expected=f"a family: {error}") from error
    model = camera_model(name, camera, scenario.arena)
    floor_tags = camera.calibration.floor_places if camera.calibration is not None else {}
    return Localizer(name, FloorMap(model), detector, tags, floor_tags=floor_tags, corner_noise=camera.sigma_pixels)


def make_fusion(scenario: Scenario) -> Fusion:
    """The fusion of all cameras.

    Args:
        scenario: the settings.
    """
    reach = {name: Reach(robot.radius, robot.v_max, robot.omega_max) for name, robot in scenario.robot.items()}
    return Fusion(scenario.arena, reach)
