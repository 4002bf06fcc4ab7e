"""The command ``muro``."""

from __future__ import annotations

import click

from muro_zenoh import __version__, is_compiled
from muro_zenoh.cli.group import MuroGroup
from muro_zenoh.cli.options import example

PROCESSES = ("agent", "base", "basestation", "page", "camera", "sim", "router")
COMMANDS = {
    "run": "muro_zenoh.cli.run:run",
    **{name: f"muro_zenoh.cli.processes:{name}" for name in PROCESSES},
    **{name: f"muro_zenoh.cli.orders:{name}" for name in ("stop", "resume", "goal", "clear")},
    "set": "muro_zenoh.cli.orders:set_group",
    "topic": "muro_zenoh.cli.topic:topic",
    "calibrate": "muro_zenoh.cli.calibrate:calibrate",
    "localize": "muro_zenoh.cli.localize:localize",
    "check": "muro_zenoh.cli.check:check",
    "figures": "muro_zenoh.cli.figures:figures",
}


@click.group(
    cls=MuroGroup,
    lazy=COMMANDS,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120},
    epilog=example("muro run pursuit", "muro stop", "muro topic list"),
)
@click.version_option(f"{__version__} (compiled)" if is_compiled() else __version__, prog_name="muro")
def main() -> None:
    """A lab of ground robots, run from Python over Zenoh."""
