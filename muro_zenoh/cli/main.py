"""The command ``muro``."""

from __future__ import annotations

import click

from muro_zenoh import __version__
from muro_zenoh.cli.figures import figures
from muro_zenoh.cli.options import MuroGroup, example
from muro_zenoh.cli.orders import goal, resume, set_group, stop
from muro_zenoh.cli.processes import agent, base, basestation, router, sim
from muro_zenoh.cli.run import run
from muro_zenoh.cli.topic import topic


@click.group(
    cls=MuroGroup,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120},
    epilog=example("muro run pursuit", "muro stop", "muro topic list"),
)
@click.version_option(__version__, prog_name="muro")
def main() -> None:
    """A lab of ground robots, run from Python over Zenoh."""


for command in (run, agent, base, basestation, sim, router, stop, resume, goal, set_group, topic, figures):
    main.add_command(command)


if __name__ == "__main__":
    main(prog_name="muro")
