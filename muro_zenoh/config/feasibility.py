"""What is impossible in a lab, refused before anything starts."""

from __future__ import annotations

import math

from muro_zenoh.config.origin import Origin
from muro_zenoh.config.sections import Scenario
from muro_zenoh.errors import ConfigError


def check_feasible(s: Scenario, origin: Origin) -> None:
    """Refuse an impossible scenario.

    Args:
        s: the scenario.
        origin: where its keys came from, for errors.

    Raises:
        ConfigError: an empty arena, two robots with one tag, a circle outside the arena, too many robots for it ...
    """
    a = s.arena
    if not (a.x_min < a.x_max and a.y_min < a.y_max):
        raise ConfigError(origin.at("arena"), got=str(a), expected="x_min < x_max and y_min < y_max")
    _check_tags(s, origin)
    for name, camera in s.camera.items():
        if (camera.pixels is None) != (camera.metres is None):
            raise ConfigError(origin.at(f"camera.{name}"), got="pixels or metres alone", expected="both, or neither")
        if camera.pixels is not None and camera.metres is not None and len(camera.pixels) != len(camera.metres):
            raise ConfigError(
                origin.at(f"camera.{name}.metres"),
                got=f"{len(camera.metres)} points",
                expected=f"as many as pixels has: {len(camera.pixels)}",
            )
    _check_circle(s, origin)
    _check_goals(s, origin)


def _check_tags(s: Scenario, origin: Origin) -> None:
    owner: dict[int, str] = {}
    for name, robot in s.robot.items():
        if robot.tag is None:
            if s.camera:
                raise ConfigError(origin.at(f"robot.{name}.tag"), got="no tag", expected="the id of the tag it carries")
            continue
        if robot.tag in owner:
            raise ConfigError(
                origin.at(f"robot.{name}.tag"),
                got=f"{robot.tag}, which robot {owner[robot.tag]} carries too",
                expected="a tag of its own",
            )
        owner[robot.tag] = name


def _check_circle(s: Scenario, origin: Origin) -> None:
    if s.behaviour.name not in ("circle", "pursuit"):
        return
    c, a = s.circle, s.arena
    body = max(robot.radius for robot in s.robot.values())
    room = a.clearance(c.x, c.y) - body
    if c.radius > room:
        raise ConfigError(
            origin.at("circle.radius"),
            got=f"{c.radius:g} m round ({c.x:g}, {c.y:g})",
            expected=f"at most {max(room, 0.0):g} m, so that robots of {body:g} m radius stay inside the arena",
        )
    count = len(s.robot)
    chord = 2.0 * c.radius * math.sin(math.pi / count) if count > 1 else math.inf
    if s.behaviour.name == "pursuit" and chord < 2.0 * body:
        most = int(math.pi / math.asin(min(1.0, body / c.radius)))
        raise ConfigError(
            origin.at("circle.radius"),
            got=f"{count} robots on a circle of {c.radius:g} m, {chord:.3f} m apart",
            expected=f"at least {2 * body:g} m between their centres",
            hint=f"At most {most} robots fit, or a circle of {body / math.sin(math.pi / count):.2f} m.",
        )


def _check_goals(s: Scenario, origin: Origin) -> None:
    a = s.arena
    for name, goals in s.goals.items():
        if name not in s.robot:
            continue  # a run with fewer robots than the file has goals for
        body = s.robot[name].radius
        for index, (x, y, *_) in enumerate(goals):
            if not a.shrunk(body).holds(x, y):
                raise ConfigError(
                    origin.at(f"goals.{name}[{index}]"),
                    got=f"({x:g}, {y:g})",
                    expected=f"a place at least the robot's radius, {body:g} m, inside the arena",
                )
