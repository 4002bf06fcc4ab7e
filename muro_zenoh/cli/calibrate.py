"""``muro calibrate``: where the cameras are."""

from __future__ import annotations

from pathlib import Path

import click

from muro_zenoh.cli.group import MuroGroup
from muro_zenoh.cli.options import example


@click.group(
    cls=MuroGroup,
    lazy={"arena": "muro_zenoh.cli.calibrate:arena"},
    epilog=example("muro calibrate arena lab.toml north --marks marks.csv --out north.toml"),
)
def calibrate() -> None:
    """Find out where the cameras are, with the error in millimetres on the floor."""


@click.command(epilog=example("muro calibrate arena lab.toml north --marks marks.csv --out north.toml"))
@click.argument("file")
@click.argument("name")
@click.option(
    "--marks",
    metavar="FILE",
    required=True,
    type=click.Path(dir_okay=False, path_type=Path),
    help="CSV with the columns name, u, v [px], x, y and, if not 0, z [m] of marks on the floor.",
)
@click.option(
    "--out", metavar="FILE", required=True, type=click.Path(dir_okay=False, path_type=Path), help="The calibration."
)
def arena(file: str, name: str, marks: Path, out: Path) -> None:
    """Place camera NAME of the fleet FILE over the arena, from four or more marks with known places.

    Its lens is that of the fleet file: of the camera's calibration, or its fov and distortion.
    """
    from basestation.calibration.arena import bounds_on_floor, place_camera
    from basestation.calibration.files import calibration_text, heat_map, read_marks
    from muro_zenoh.config import find_scenario
    from muro_zenoh.config.cameras import camera_model
    from muro_zenoh.errors import ConfigError

    scenario = find_scenario(file)
    if name not in scenario.camera:
        raise ConfigError("NAME", got=repr(name), expected=f"one of {', '.join(scenario.camera) or 'none'}")
    settings = scenario.camera[name]
    if settings.calibration is None and settings.fov is None:
        raise ConfigError(
            f"camera.{name}", got="no lens", expected="a calibration with the lens, or its fov and distortion"
        )
    points = read_marks(marks)
    placed = place_camera(camera_model(name, settings, scenario.arena), points, camera=name)
    for mark, error in zip(points, placed.errors, strict=True):
        click.echo(f"{mark.name:>12}  {1e3 * error:6.1f} mm")
    click.echo("95 % bound of places on the floor [mm], from the arena's upper left corner, cells of 0.5 m:")
    click.echo(heat_map(bounds_on_floor(placed, scenario.arena)))
    worst = f"marks within {1e3 * max(placed.errors):.1f} mm, pixels within {placed.sigma:.2f} px"
    out.write_text(calibration_text(placed.camera, (f"camera {name}, placed by {len(points)} marks", worst)))
    click.echo(f"{out}: {worst}. Name it in the fleet file: [camera.{name}] calibration = {str(out.name)!r}")
