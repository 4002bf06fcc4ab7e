"""``muro localize``: the base station's localization on a recording."""

from __future__ import annotations

from collections import Counter
from contextlib import ExitStack
from pathlib import Path

import click

from muro_zenoh.cli.options import example

_SHOWN = 12
"""So many reasons are listed at the end."""


@click.command(
    epilog=example(
        "muro localize monday.mp4 --fleet lab.toml --out poses.csv",
        "muro localize frames/ --fleet lab.toml --camera north --rate 20 --out poses.csv --draw monday-seen.mp4",
    )
)
@click.argument("recording", type=click.Path(path_type=Path))
@click.option("--fleet", metavar="FILE", required=True, help="The fleet file: robots, tags and cameras.")
@click.option("--camera", metavar="NAME", default="", help="The camera that took it, where the fleet has several.")
@click.option("--rate", type=click.FloatRange(0.1, 240.0), default=20.0, show_default=True, help="Of images [Hz].")
@click.option(
    "--out", metavar="FILE", required=True, type=click.Path(dir_okay=False, path_type=Path), help="The poses, as CSV."
)
@click.option(
    "--draw", metavar="FILE", type=click.Path(dir_okay=False, path_type=Path), help="Also an annotated video (.mp4)."
)
def localize(recording: Path, fleet: str, camera: str, rate: float, out: Path, draw: Path | None) -> None:
    """Find the robots in RECORDING, a video or a directory of images, as the base station would."""
    from rich.progress import Progress

    from basestation.offline import Eye, look_through
    from basestation.poses_file import AnnotatedVideo, PosesFile
    from basestation.sources.recordings import open_recording
    from muro_zenoh.config import find_scenario
    from muro_zenoh.errors import ConfigError

    scenario = find_scenario(fleet)
    names = tuple(scenario.camera)
    if camera not in names and (camera or len(names) != 1):
        got = repr(camera) if camera else "nothing"
        raise ConfigError("--camera", got=got, expected=f"one of {', '.join(names) or 'none: the fleet has no camera'}")
    name = camera or names[0]
    settings = scenario.camera[name]
    eye = Eye(scenario, name)
    source = open_recording(recording, rate)
    pictures = fixes = 0
    reasons: Counter[str] = Counter()
    with ExitStack() as stack:
        stack.callback(source.close)
        video = None
        if draw is not None:
            video = AnnotatedVideo(draw, source.rate, settings.width, settings.height)
            stack.callback(video.close)
        poses = stack.enter_context(PosesFile(out))
        progress = stack.enter_context(Progress(transient=True))
        bar = progress.add_task(source.name, total=source.length)
        for looked in look_through(source, eye):
            progress.advance(bar)
            reasons.update(looked.complaints)
            if looked.shot is None:
                continue
            pictures += 1
            fixes += len(looked.fixes)
            poses.write(looked.shot.t, looked.fixes)
            if video is not None:
                video.write(eye.draw(looked.shot, looked))
    for reason, count in reasons.most_common(_SHOWN):
        click.echo(f"{count} x {reason}")
    if len(reasons) > _SHOWN:
        click.echo(f"and {len(reasons) - _SHOWN} more reasons")
    click.echo(f"{pictures} pictures, {fixes} poses: {out}")
