"""Refuses impossible scenarios before anything starts."""

from __future__ import annotations

import math
from itertools import combinations
from typing import Final

from muro_zenoh.config.behaviour import check_settings
from muro_zenoh.config.origin import Origin
from muro_zenoh.config.reading import config_error
from muro_zenoh.config.sections import HUNG, CameraSettings, Scenario
from muro_zenoh.errors import ConfigError, ParameterError
from muro_zenoh.planning.destination import require_inside
from muro_zenoh.walls import require_clear

POSE_PERIOD: Final = 0.05
"""Time between two poses of a robot [s]."""


def check_feasible(s: Scenario, origin: Origin) -> None:
    """Refuse an impossible scenario.

    Args:
        s: the scenario.
        origin: the origin of its keys, for errors.

    Raises:
        ConfigError: an empty arena, a wall outside it, two robots with one tag, a circle outside the arena, too many
            robots for it ...
    """
    a = s.arena
    if not (a.x_min < a.x_max and a.y_min < a.y_max):
        raise ConfigError(origin.at("arena"), got=str(a), expected="x_min < x_max and y_min < y_max")
    _check_walls(s, origin)
    _check_tags(s, origin)
    _check_timeouts(s, origin)
    for name, camera in s.camera.items():
        _check_camera(f"camera.{name}", camera, origin)
    _check_separation(s, origin)
    fleet = [s.vehicle(name) for name in s.robot]
    check_settings(s.behaviour.name, s.behaviour.parameters, origin, fleet, s.circle)
    _check_goals(s, origin)
    _check_starts(s, origin)
    _check_orders(s, origin)


def _check_walls(s: Scenario, origin: Origin) -> None:
    for index, row in enumerate(s.wall):
        for key, (x, y) in (("start", row.start), ("end", row.end)):
            if not s.arena.holds(x, y):
                raise ConfigError(
                    origin.at(f"wall[{index}].{key}"),
                    got=f"({x:g}, {y:g}), outside the arena",
                    expected=str(s.arena),
                    hint="Let the wall end at the arena's edge.",
                )


def _check_timeouts(s: Scenario, origin: Origin) -> None:
    for name, camera in s.camera.items():
        # A pose must last until the next frame, and until the one after it when that is lost.
        least = camera.latency + 2.0 / camera.rate
        if s.timeouts.pose < least:
            raise ConfigError(
                origin.at("timeouts.pose"),
                got=f"{s.timeouts.pose:g} [s]",
                expected=f"at least {least:.3g}: the frames of camera {name} are {camera.latency:g} s old, "
                f"{1.0 / camera.rate:.3g} s apart, and one may be lost",
            )


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
    sizes = [(name, _numbers(camera.family)) for name, camera in s.camera.items()]
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
        for camera, count in sizes:
            if count is not None and robot.tag >= count:
                raise ConfigError(
                    origin.at(f"robot.{name}.tag"),
                    got=str(robot.tag),
                    expected=f"one of 0 to {count - 1}, which family {s.camera[camera].family} of camera {camera} has",
                )


def _numbers(family: str) -> int | None:
    """How many tags a family of OpenCV's has, by its name; None for one that does not say it."""
    count = family.rpartition("_")[2] if family.startswith("DICT_") and "APRILTAG" not in family else ""
    return int(count) if count.isdigit() else None


def _check_goals(s: Scenario, origin: Origin) -> None:
    for name, goals in s.goals.items():
        if name not in s.robot:
            continue  # a run may have fewer robots than the file has goals for
        for index, (x, y, *_) in enumerate(goals):
            try:
                require_inside(f"goals.{name}[{index}]", x, y, s.arena, s.vehicle(name).wall_distance, s.walls)
            except ParameterError as error:
                raise config_error(error, origin, "") from None
    _check_last_goals(s, origin)


def _check_last_goals(s: Scenario, origin: Origin) -> None:
    """Each robot stays at its last goal: two of them must have room there."""
    last = [(name, goals[-1]) for name, goals in s.goals.items() if goals and name in s.robot]
    for (a, (ax, ay, *_)), (b, (bx, by, *_)) in combinations(last, 2):
        one, other = s.vehicle(a), s.vehicle(b)
        apart, least = math.hypot(ax - bx, ay - by), one.radius + other.radius + one.margin
        if apart < least:
            raise ConfigError(
                origin.at(f"goals.{b}"),
                got=f"a last goal {apart:.3f} m from that of {a}",
                expected=f"at least {least:g} m between the centres of two robots",
            )


def _check_starts(s: Scenario, origin: Origin) -> None:
    if not s.starts:
        return
    for name in s.robot:
        if name not in s.starts:
            raise ConfigError(origin.at("starts"), got=f"none of {name}", expected="those of all robots, or of none")
        x, y, _ = s.starts[name]
        try:
            require_inside(f"starts.{name}", x, y, s.arena, s.robot[name].radius)
            require_clear(f"starts.{name}", x, y, s.walls, s.vehicle(name).wall_distance)
        except ParameterError as error:
            raise config_error(error, origin, "") from None
    for one, other in combinations(s.robot, 2):
        least = s.robot[one].radius + s.robot[other].radius
        if (apart := math.dist(s.starts[one][:2], s.starts[other][:2])) < least:
            raise ConfigError(
                origin.at(f"starts.{other}"), got=f"{apart:.3f} m from {one}", expected=f"at least {least:g} m"
            )


def _check_orders(s: Scenario, origin: Origin) -> None:
    for index, order in enumerate(s.orders):
        where = f"order[{index}]"
        for name in order.robots:
            if name not in s.robot:
                raise ConfigError(
                    origin.at(f"{where}.robots"), got=repr(name), expected=f"some of {', '.join(s.robot)}"
                )
        if (order.kind == "behaviour") != bool(order.behaviour):
            raise ConfigError(
                origin.at(f"{where}.behaviour"),
                got=repr(order.behaviour),
                expected="the name of one" if order.kind == "behaviour" else f"none for a {order.kind}",
            )
        if order.behaviour:
            fleet = [s.vehicle(name) for name in order.robots or s.robot]
            check_settings(order.behaviour, order.parameters, origin, fleet, s.circle)


def _check_separation(s: Scenario, origin: Origin) -> None:
    """A command is certified for the time for which the wheels may follow it."""
    least = s.timeouts.command + POSE_PERIOD
    if s.separation.enabled and s.separation.hold < least - 1e-9:
        raise ConfigError(
            origin.at("separation.hold"),
            got=f"{s.separation.hold:g} [s]",
            expected=f"at least {least:g}: timeouts.command, and one period of {POSE_PERIOD:g} s",
        )
    if s.separation.enabled and s.separation.snapshot_limit != s.timeouts.snapshot:
        raise ConfigError(
            origin.at("separation.snapshot_limit"),
            got=f"{s.separation.snapshot_limit:g} [s]",
            expected=f"timeouts.snapshot, {s.timeouts.snapshot:g}: how old the positions may be is one limit",
        )
