"""Refuses impossible scenarios before anything starts."""

from __future__ import annotations

from muro_zenoh.config.behaviour import check_settings
from muro_zenoh.config.origin import Origin
from muro_zenoh.config.reading import config_error
from muro_zenoh.config.sections import HUNG, CameraSettings, Scenario
from muro_zenoh.errors import ConfigError, ParameterError
from muro_zenoh.planning.destination import require_inside


def check_feasible(s: Scenario, origin: Origin) -> None:
    """Refuse an impossible scenario.

    Args:
        s: the scenario.
        origin: the origin of its keys, for errors.

    Raises:
        ConfigError: an empty arena, two robots with one tag, a circle outside the arena, too many robots for it ...
    """
    a = s.arena
    if not (a.x_min < a.x_max and a.y_min < a.y_max):
        raise ConfigError(origin.at("arena"), got=str(a), expected="x_min < x_max and y_min < y_max")
    _check_tags(s, origin)
    for name, camera in s.camera.items():
        _check_camera(f"camera.{name}", camera, origin)
    fleet = [s.vehicle(name) for name in s.robot]
    check_settings(s.behaviour.name, s.behaviour.parameters, origin, fleet, s.circle)
    _check_goals(s, origin)


def _check_camera(key: str, camera: CameraSettings, origin: Origin) -> None:
    if (camera.pixels is None) != (camera.metres is None):
        raise ConfigError(origin.at(key), got="pixels or metres alone", expected="both, or neither")
    if camera.pixels is not None and camera.metres is not None and len(camera.pixels) != len(camera.metres):
        raise ConfigError(
            origin.at(f"{key}.metres"),
            got=f"{len(camera.metres)} points",
            expected=f"as many as pixels has: {len(camera.pixels)}",
        )
    hung = [name for name in HUNG if getattr(camera, name) is not None]
    given = [name for name in ("pixels", "calibration") if getattr(camera, name) is not None] + hung
    if len(given) > max(len(hung), 1):
        raise ConfigError(
            origin.at(key),
            got=" and ".join(given),
            expected=f"where the camera is in one way: pixels and metres, calibration, or {', '.join(HUNG)}",
        )
    size = (camera.width, camera.height)
    c = camera.calibration
    if c is not None and (c.width, c.height) != size:
        raise ConfigError(
            origin.at(f"{key}.calibration"),
            got=f"a calibration for {c.width} x {c.height} pixels",
            expected=f"one for the camera's frames of {size[0]} x {size[1]}",
            hint="Calibrate with the resolution that the camera runs with",
        )


def _check_tags(s: Scenario, origin: Origin) -> None:
    owner: dict[int, str] = {}
    for name, robot in s.robot.items():
        if robot.tag is None:
            if s.camera:
                raise ConfigError(origin.at(f"robot.{name}.tag"), got="no tag", expected="the id of its tag")
            continue
        if robot.tag in owner:
            raise ConfigError(
                origin.at(f"robot.{name}.tag"),
                got=f"{robot.tag}, which robot {owner[robot.tag]} has too",
                expected="a unique tag",
            )
        owner[robot.tag] = name


def _check_goals(s: Scenario, origin: Origin) -> None:
    for name, goals in s.goals.items():
        if name not in s.robot:
            continue  # a run may have fewer robots than the file has goals for
        for index, (x, y, *_) in enumerate(goals):
            try:
                require_inside(f"goals.{name}[{index}]", x, y, s.arena, s.robot[name].radius)
            except ParameterError as error:
                raise config_error(error, origin, "") from None
