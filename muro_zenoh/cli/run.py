"""``muro run``: all processes of a scenario on this machine, and a score sheet at the end."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import click

from muro_zenoh.cli.options import assignments, example, web_options
from muro_zenoh.errors import ConfigError


@click.command(
    epilog=example(
        "muro run pursuit",
        "muro run pursuit --robots 8 --duration 75 --set circle.radius=1.0 --set checks.settle_time=50",
        "muro run lab.toml --headless --seed 3 --report r.json",
    )
)
@click.argument("scenario")
@click.option("--robots", type=click.IntRange(min=1), metavar="N", help="Number of robots.  [default: the scenario's]")
@click.option(
    "--duration",
    type=click.FloatRange(min=0, min_open=True),
    metavar="S",
    help="Duration of the run once all processes are ready [s].  [default: the scenario's]",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=1,
    show_default=True,
    metavar="N",
    help="Seed of the simulator: starts, drive errors, noise.",
)
@click.option("--headless", is_flag=True, help="Plain lines, no table; the default when the output is not a terminal.")
@click.option(
    "--report",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Also write the score sheet to this file.",
)
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=VALUE",
    help="Override a setting of the scenario, such as circle.clockwise=true; repeatable.",
)
@click.option(
    "--connect",
    metavar="ENDPOINT",
    help="Use the router at ENDPOINT instead of starting one, and the processes of the fleet that are there.",
)
@web_options
def run(
    scenario: str,
    robots: int | None,
    duration: float | None,
    seed: int,
    headless: bool,
    report: Path | None,
    settings: tuple[str, ...],
    connect: str | None,
    web: str | None,
) -> None:
    """Run a fleet on this machine: a built-in SCENARIO such as pursuit, circle or hold, or a TOML file.

    Starts a router, a simulator, a base station and an agent per robot, each as a process; shows their state, and ends
    with a score sheet. With --connect, what is running already is not started. The robots are held: orders of others
    are refused, and so is this run where others hold them. In the table the space bar stops every robot. The folder
    runs/<time>-<scenario>/ has the settings, the score sheet and a log per process.

    The exit code is 0 when the run met the scenario's checks, or the scenario makes none; 1 when it did not, when a
    behaviour failed or ended early, or when a process could not be kept alive; 2 for invalid settings; 130 when it was
    interrupted.
    """
    from basestation.dashboard.offer import Offer, offer
    from muro_zenoh.cli.live import PlainScreen, TableScreen
    from muro_zenoh.cli.options import override_bus
    from muro_zenoh.cli.summary import summary
    from muro_zenoh.config import find_scenario
    from muro_zenoh.runtime.process import run_process
    from muro_zenoh.supervision.fault_targets import check_faults
    from muro_zenoh.supervision.folder import REPORT, TOKENS, make_run_folder, write_report
    from muro_zenoh.supervision.preflight import check_can_run, check_own_packages
    from muro_zenoh.supervision.run import RunSettings, Screen, run_fleet

    overrides = assignments(settings, "--set")
    if duration is not None:
        overrides["duration"] = duration
    resolved = find_scenario(scenario, robots, overrides)
    if connect is not None:
        override_bus(None, {"connect": (connect,)})  # for its check of the endpoint
    check_own_packages()
    file = Path(scenario).name if scenario.endswith(".toml") else f"{scenario}.toml"
    check_can_run(resolved, file)
    check_faults(resolved, file, connect)
    if report is not None and not os.access(report.parent, os.W_OK):
        raise ConfigError(
            "--report", got=f"{report}, whose folder cannot be written to", expected="a file that can be written"
        )
    folder = make_run_folder(resolved.name)
    page: Offer | str = "" if web == "off" else offer(web, folder / TOKENS)
    screen: Screen = PlainScreen() if headless or not sys.stdout.isatty() else TableScreen()

    async def run_and_report() -> int:
        result = await run_fleet(RunSettings(resolved, folder, seed, connect, page), screen)
        if result.sheet is not None:
            if report is not None:
                write_report(result.sheet, report)
            click.echo(summary(result.sheet))
            click.echo(f"score sheet: {report or folder / REPORT}")
        return result.exit_code

    raise SystemExit(run_process(run_and_report, "muro"))
