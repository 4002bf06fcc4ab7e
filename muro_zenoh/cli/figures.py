"""``muro figures``: the reports' figures, drawn with our own laws."""

from __future__ import annotations

from pathlib import Path

import click

from muro_zenoh.cli.options import example


def _list(context: click.Context, _: click.Parameter, value: bool) -> None:
    if not value:
        return
    from muro_zenoh.figures.catalogue import FIGURES

    width = max(map(len, FIGURES))
    for name, entry in FIGURES.items():
        click.echo(f"{name:<{width}}  {entry.shows}")
    context.exit()


@click.command(epilog=example("muro figures --out figures", "muro figures --out . --only seed000_fig2 --format png"))
@click.option(
    "--out",
    metavar="DIR",
    required=True,
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for the files; created if missing.",
)
@click.option("--only", metavar="NAME", multiple=True, help="Draw this figure only; repeatable.")
@click.option(
    "--format",
    "file_format",
    type=click.Choice(["svg", "png"]),
    default="svg",
    show_default=True,
    help="File format.",
)
@click.option(
    "--list", is_flag=True, is_eager=True, expose_value=False, callback=_list, help="List the figures and exit."
)
def figures(out: Path, only: tuple[str, ...], file_format: str) -> None:
    """Draw the figures of docs/laws.md with the laws themselves.

    The result is the same each time. Needs an extra: pip install 'muro-zenoh[figures]'
    """
    import time

    from muro_zenoh.figures.catalogue import FIGURES, draw

    count = len(only or FIGURES)
    began = time.monotonic()
    for k, (name, path) in enumerate(draw(out, only, file_format), start=1):
        now = time.monotonic()
        click.echo(f"[{k:>{len(str(count))}}/{count}] {path}  {now - began:.1f} s  {FIGURES[name].shows}")
        began = now
