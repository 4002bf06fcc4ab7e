"""``muro calibrate``: lenses and places of the cameras."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from muro_zenoh.cli.calibrate_options import (
    board_options,
    distance_of,
    floor_of,
    make_board,
    number,
    pairs,
    place,
    start_of,
)
from muro_zenoh.cli.options import BusFlags, bus_options, example
from muro_zenoh.errors import ConfigError

if TYPE_CHECKING:
    from basestation.calibration.drive_session import DriveSession
    from basestation.calibration.floor_error import FloorError
    from basestation.calibration.tag_tracks import Seen
    from muro_zenoh.config import BusSettings

_PATH = click.Path(path_type=Path)
_FILE = click.Path(dir_okay=False, path_type=Path)
_SHOWN = 8


@click.group(epilog=example("muro calibrate board --pdf board.pdf", "muro calibrate intrinsics views/ --out lens.toml"))
def calibrate() -> None:
    """Calibrate the cameras: first the lens, then where they hang. docs/calibration.md has it step by step."""


@calibrate.command(epilog=example("muro calibrate board --pdf board.pdf --fleet lab.toml --floor-tag 40"))
@click.option("--pdf", metavar="FILE", required=True, type=_FILE, help="The PDF.")
@click.option("--fleet", metavar="FILE", help="Also the tags of the robots of this fleet.")
@click.option("--floor-tag", "floor_tags", type=int, multiple=True, help="Also this tag, for the floor; repeatable.")
@click.option("--floor-size", default=160.0, show_default=True, help="Side of the floor tags' black square [mm].")
@click.option("--paper", type=click.Choice(["a4", "a3", "letter"]), default="a4", show_default=True)
@board_options
def board(
    pdf: Path, fleet: str | None, floor_tags: tuple[int, ...], floor_size: float, paper: str, **sizes: Any
) -> None:
    """Write the board and the tags to a PDF, to print at 100 %."""
    from muro_zenoh.config import find_scenario
    from muro_zenoh.figures.calibration import Tag, print_sheets

    tags = []
    family = "DICT_4X4_50"
    if fleet is not None:
        scenario = find_scenario(fleet)
        family = next((camera.family for camera in scenario.camera.values()), family)
        tags = [Tag(name, family, r.tag, r.tag_size) for name, r in scenario.robot.items() if r.tag is not None]
    tags += [Tag(f"floor {tag}", family, tag, 1e-3 * floor_size) for tag in floor_tags]
    try:
        count = print_sheets(pdf, make_board(**sizes), tags, paper)
    except ValueError as error:
        raise ConfigError("tags", got=str(error), expected=f"tags of {family}") from None
    click.echo(f"{pdf}: {count} sheets. Print at 100 %, and measure the line of 100 mm on each")


@calibrate.command(
    epilog=example(
        "muro calibrate intrinsics views/ --out north-lens.toml --height 3.0 --map lens.png",
        "muro calibrate intrinsics board.mp4 --out north-lens.toml",
    )
)
@click.argument("source", type=_PATH)
@click.option("--out", metavar="FILE", required=True, type=_FILE, help="The lens, as TOML.")
@click.option("--height", default=3.0, show_default=True, help="Of the camera over the floor, for the map [m].")
@click.option("--map", "picture", metavar="FILE", type=_FILE, help="Also the map of the error as PNG.")
@click.option("--drop", is_flag=True, help="Leave out bad views instead of refusing all; always so with a video.")
@click.option("--most", default=40, show_default=True, help="Views to use at most: those that differ most.")
@board_options
def intrinsics(
    source: Path, out: Path, height: float, picture: Path | None, drop: bool, most: int, **sizes: Any
) -> None:
    """Find a camera's lens from SOURCE, a directory of pictures of the board or a video of it."""
    from basestation.calibration.board_views import BoardFinder
    from basestation.calibration.files import write_lens
    from basestation.calibration.lens import fit_lens
    from basestation.calibration.sources import board_views
    from basestation.calibration.views_choice import choose_views, sharp_views

    video = not source.is_dir()
    found = _with_bar(source, lambda advance: board_views(source, BoardFinder(make_board(**sizes)), advance))
    for reason in found.reasons[:_SHOWN]:
        click.echo(f"left out: {reason}")
    if len(found.reasons) > _SHOWN:
        click.echo(f"and {len(found.reasons) - _SHOWN} more")
    views = sharp_views(found.views)[0] if video else list(found.views)
    result = fit_lens(choose_views(views, found.size, most), found.size, height=height, drop=drop or video)
    for reason in result.dropped:
        click.echo(f"left out: {reason}")
    error = result.floor_error(height)
    fx, fy = result.camera.lens[:2].tolist()
    facts = (
        f"focal length {fx:.1f}, {fy:.1f} px; {len(result.used)} views; corners {result.pixels:.3f} px off",
        f"on the floor {height:g} m below, the lens is wrong by less than {1e3 * error.worst:.1f} mm (95 %)",
    )
    _show(error, facts, result.inflation)
    write_lens(out, result.camera, result.covariance, ("muro calibrate intrinsics", *facts))
    _finish(out, picture, error, "the lens, 95 % bound")


@calibrate.command(
    epilog=example(
        "muro calibrate arena floor.png --lens north-lens.toml --out north.toml \\\n"
        "    --tag 40=-1.5,-1 --tag 41=1.5,-1 --tag 42=1.5,1 --tag 43=-1.5,1 --tag 44=0,0",
        "muro calibrate arena floor/ --lens north-lens.toml --out north.toml --fleet lab.toml \\\n"
        "    --point 103.5,88=-1.5,1 --point 1180,90=1.5,1 --point 1175,640=1.5,-1 --point 99,633=-1.5,-1",
    )
)
@click.argument("source", type=_PATH)
@click.option("--lens", metavar="FILE", required=True, type=_FILE, help="The camera's lens.")
@click.option("--out", metavar="FILE", required=True, type=_FILE, help="The camera's calibration, as TOML.")
@click.option("--tag", "tags", metavar="ID=X,Y[,Z]", multiple=True, help="Middle of a floor tag [m]; repeatable.")
@click.option("--point", "points", metavar="U,V=X,Y[,Z]", multiple=True, help="A pixel and its place; repeatable.")
@click.option("--tag-size", default=160.0, show_default=True, help="Side of the floor tags' black square [mm].")
@click.option("--family", default="DICT_4X4_50", show_default=True, help="Of the floor tags, as OpenCV names it.")
@click.option("--measured", default=1.0, show_default=True, help="Standard deviation of the measured places [mm].")
@click.option("--fleet", metavar="FILE", help="Its arena and tags' height are judged; by default what the points span.")
@click.option("--map", "picture", metavar="FILE", type=_FILE, help="Also the map of the error as PNG.")
def arena(
    source: Path,
    lens: Path,
    out: Path,
    tags: tuple[str, ...],
    points: tuple[str, ...],
    tag_size: float,
    family: str,
    measured: float,
    fleet: str | None,
    picture: Path | None,
) -> None:
    """Find where a camera hangs from SOURCE, pictures of floor tags or points with known places."""
    import numpy as np

    from basestation.calibration.arena import Landmark, check_sides, fit_arena
    from basestation.calibration.files import read_lens, write_camera
    from basestation.calibration.floor_error import floor_error
    from basestation.calibration.sources import floor_tags
    from muro_zenoh.geometry import Bounds

    prior = read_lens(lens)
    wanted = {int(name): where for name, where in (place(text, "--tag", 1) for text in tags)}
    size = (prior.camera.width, prior.camera.height)
    quads = _with_bar(source, lambda advance: floor_tags(source, family, set(wanted), size, advance))
    landmarks = [Landmark(f"tag {k}", quad.middle, wanted[k]) for k, quad in quads.items()]
    for text in points:
        pixel, where = place(text, "--point", 2)
        landmarks.append(Landmark(f"point {pixel}", np.array([float(p) for p in pixel.split(",")]), where))
    for missing in sorted(wanted.keys() - quads.keys()):
        click.echo(f"tag {missing} is not in the pictures")
    spread = max((quad.sigma for quad in quads.values()), default=0.0)
    result = fit_arena(prior, landmarks, sigma_pixels=max(0.1, spread), sigma_metres=1e-3 * measured)
    names = {f"tag {k}": k for k in quads}
    check_sides(
        result.camera,
        {name: quads[k].corners for name, k in names.items()},
        dict.fromkeys(names, 1e-3 * tag_size),
        {name: float(wanted[k][2]) for name, k in names.items()},
    )
    places = np.array([landmark.place for landmark in landmarks])
    (x0, y0, _), (x1, y1, _) = places.min(axis=0).tolist(), places.max(axis=0).tolist()
    floor, height = Bounds(x0, x1, y0, y1), 0.0
    if fleet is not None:
        floor, height = floor_of(fleet)
    error = floor_error(result.camera, result.covariance, floor, height)
    x, y, z = result.camera.model.position.tolist()
    facts = (
        f"the camera is at {x:.3f}, {y:.3f}, {z:.3f} m; {len(landmarks)} points, "
        f"{1e3 * float(np.sqrt((result.off**2).mean())):.1f} mm off",
        f"on the plane {height:g} m above the floor it is wrong by less than {1e3 * error.worst:.1f} mm (95 %)",
    )
    _show(error, facts, result.inflation)
    seen_tags = {k: wanted[k] for k in quads}
    write_camera(out, result.camera, result.covariance, ("muro calibrate arena", *facts), seen_tags)
    _finish(out, picture, error, "camera, 95 % bound")
    if quads:
        click.echo("floor tags that stay where they are show the base station whether the camera was moved")


@calibrate.command(
    epilog=example(
        "muro calibrate drive r1 --fleet lab.toml --recording north=north.mp4 --recording south=south.mp4 \\\n"
        "    --lens north=north-lens.toml --lens south=south-lens.toml --height north=2.95 --out .",
        "muro calibrate drive r1 --fleet lab.toml --from seen.csv --lens north=n.toml --lens south=s.toml \\\n"
        "    --distance 40,41=2.000 --out .",
    )
)
@click.argument("robot")
@click.option("--fleet", metavar="FILE", required=True, help="The fleet file: the robot, its tag, the cameras.")
@click.option("--recording", "recordings", metavar="NAME=PATH", multiple=True, help="Of a camera; all begin together.")
@click.option("--from", "seen", metavar="FILE", type=_FILE, help="Detections that --save wrote, instead.")
@click.option("--save", metavar="FILE", type=_FILE, help="Write the detections as CSV.")
@click.option("--lens", "lenses", metavar="NAME=FILE", multiple=True, help="Of a camera; else its calibration's.")
@click.option("--height", "heights", metavar="NAME=M", multiple=True, help="Of a camera above the floor, measured [m].")
@click.option("--distance", metavar="ID,ID=M", help="Between the middles of two floor tags, measured [m].")
@click.option("--start", default="0,0,0", show_default=True, help="Where the robot starts: x,y,theta [m, rad].")
@click.option("--frame", metavar="NAME", help="The camera that was not moved: its calibration says how the map lies.")
@click.option("--seconds", default=90.0, show_default=True, help="Of the recordings to use [s].")
@click.option("--rate", default=20.0, show_default=True, help="Of directories of images [Hz].")
@click.option("--out", metavar="DIR", required=True, type=click.Path(file_okay=False, path_type=Path), help="Folder.")
@click.option("--map", "picture", metavar="FILE", type=_FILE, help="Also the map of the error as PNG.")
@bus_options
def drive(robot: str, fleet: str, out: Path, picture: Path | None, bus: BusFlags, **given: Any) -> None:
    """Place all cameras in one frame from a drive of ROBOT under them, of at most 90 s.

    Without --recording and --from, the running cameras (muro camera, muro sim) are watched while the robot drives.
    """
    from basestation.calibration.drive_session import DriveSession
    from basestation.calibration.files import write_camera
    from muro_zenoh.config import find_scenario

    session = DriveSession(
        find_scenario(fleet),
        robot,
        lenses={name: Path(path) for name, path in pairs(given["lenses"], "--lens").items()},
        heights={name: number(text, "--height") for name, text in pairs(given["heights"], "--height").items()},
        distance=distance_of(given["distance"]),
        start=start_of(given["start"]),
        frame=given["frame"],
    )
    recordings = {name: Path(path) for name, path in pairs(given["recordings"], "--recording").items()}
    if given["seen"] is not None:
        rows = session.load(given["seen"])
    elif recordings:
        rows = []
        for name, path in recordings.items():
            rows += _with_bar(path, partial(session.look, name, path, given["rate"], given["seconds"]))
    else:
        rows = _watch(session, bus(session.scenario.bus), given["seconds"])
    if given["save"] is not None:
        session.save(given["save"], rows)
    result, error = session.fit(rows)
    places = ", ".join(
        f"{name} at {camera.model.position[0]:.3f}, {camera.model.position[1]:.3f}, {camera.model.position[2]:.3f} m"
        for name, camera in result.cameras.items()
    )
    facts = (
        f"{places}; the tag's corners {result.pixels:.3f} px off; {result.left_out} places left out",
        f"at the tags' height the map is wrong by less than {1e3 * error.worst:.1f} mm (95 %)",
    )
    _show(error, facts, result.inflation)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise ConfigError("--out", got=f"{out} ({problem.strerror})", expected="a folder that can be written") from None
    for k, (name, camera) in enumerate(result.cameras.items()):
        block = slice(15 * k, 15 * k + 15)
        before = session.scenario.camera[name].calibration
        stay = before.floor_places if before is not None else {}
        notes = ("muro calibrate drive", *facts)
        write_camera(out / f"{name}.toml", camera, result.covariance[block, block], notes, stay)
        click.echo(f'{out / f"{name}.toml"}: in the fleet file, [camera.{name}] calibration = "{name}.toml"')
    _draw(picture, error, "all cameras, 95 % bound")


def _watch(session: DriveSession, settings: BusSettings, seconds: float) -> list[Seen]:
    """What the running cameras see of the drive."""
    import asyncio

    from basestation.calibration.watching import watch_drive
    from muro_zenoh.channels import Role
    from muro_zenoh.runtime.process import worker_threads
    from muro_zenoh.transport import open_bus

    cameras = session.scenario.camera
    if not cameras:
        raise ConfigError("--fleet", got="a fleet without cameras", expected="[camera.NAME], to watch the drive")
    click.echo(f"watching {', '.join(cameras)} for {seconds:g} s: drive {session.robot} all over the floor")

    async def watch(advance: Callable[[], None]) -> list[Seen]:
        with worker_threads(len(cameras), "watch") as threads:
            async with open_bus(settings, Role.OPERATOR) as bus:
                return await watch_drive(bus, session.scenario, session.mount.id, seconds, threads, advance)

    found: list[Seen] = _with_bar(Path("pictures"), lambda advance: asyncio.run(watch(advance)))
    return found


def _with_bar(source: Path, work: Callable[[Callable[[], None]], Any]) -> Any:
    from rich.progress import Progress

    with Progress(transient=True) as progress:
        bar = progress.add_task(str(source), total=None)
        return work(lambda: progress.advance(bar))


def _show(error: FloorError, facts: tuple[str, ...], inflation: float) -> None:
    import math

    for fact in facts:
        click.echo(fact)
    click.echo("error below, in 95 % of all calibrations [mm]:")
    for k in reversed(range(len(error.y))):
        cells = ("    ." if math.isnan(bound) else f"{1e3 * bound:5.1f}" for bound in error.bound[k].tolist())
        click.echo(f"  y {error.y[k]:5.2f} |{' '.join(cells)}")
    click.echo(f"        x {' '.join(f'{x:5.2f}' for x in error.x.tolist())}  [m]")
    if inflation > 1.5:
        click.echo(
            f"parts of the data differ {math.sqrt(inflation):.1f} times more than their noise explains: the bound "
            "was raised for it. Is something bent, loose or measured badly?"
        )


def _finish(out: Path, picture: Path | None, error: FloorError, title: str) -> None:
    click.echo(f"written: {out}")
    _draw(picture, error, title)


def _draw(picture: Path | None, error: FloorError, title: str) -> None:
    if picture is not None:
        from muro_zenoh.figures.calibration import heat_map

        heat_map(error, title, picture)
        click.echo(f"written: {picture}")
