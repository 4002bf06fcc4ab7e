"""``muro agent``, ``base``, ``basestation``, ``camera``, ``sim``, ``router``: one process each."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from muro_zenoh.cli.options import BusFlags, bus_options, example, web_options

if TYPE_CHECKING:
    from basestation.dashboard.offer import Offer
    from basestation.sources.source import FrameSource
    from muro_zenoh.config import BusSettings, Scenario


def _scenario(file: str, bus: BusFlags) -> Scenario:
    """The scenario or fleet of a name or file, with its bus settings overridden by Zenoh's flags."""
    import msgspec

    from muro_zenoh.config import find_scenario
    from muro_zenoh.supervision.preflight import check_own_packages

    check_own_packages()
    scenario = find_scenario(file)
    return msgspec.structs.replace(scenario, bus=bus(scenario.bus))


def _run(main: Callable[[], Coroutine[Any, Any, int | None]], name: str) -> None:
    from muro_zenoh.runtime.process import run_process

    raise SystemExit(run_process(main, name))


@click.command(epilog=example("muro agent lab.toml r1 --connect tcp/192.168.1.10:7447"))
@click.argument("file")
@click.argument("name")
@bus_options
def agent(file: str, name: str, bus: BusFlags) -> None:
    """Run the agent of robot NAME of a fleet or scenario FILE."""
    scenario = _scenario(file, bus)
    from agents.agent import run_agent

    _run(lambda: run_agent(scenario, name), name)


@click.command(epilog=example("muro base lab.toml r1"))
@click.argument("file")
@click.argument("name")
@bus_options
def base(file: str, name: str, bus: BusFlags) -> None:
    """Run the base of robot NAME: its wheels and their dead-man."""
    scenario = _scenario(file, bus)
    from agents.base.run import run_base_process

    _run(lambda: run_base_process(scenario, name), f"{name}_base")


@click.command(epilog=example("muro basestation lab.toml --state lab-state.json"))
@click.argument("file")
@click.option(
    "--state",
    type=click.Path(dir_okay=False, path_type=Path),
    default=Path("basestation.json"),
    show_default=True,
    metavar="FILE",
    help="File for the kept state: circle, behaviours and stop.",
)
@click.option(
    "--tokens",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="File with the tokens of the page.  [default: beside the kept state]",
)
@web_options
@bus_options
def basestation(file: str, state: Path, tokens: Path | None, web: str | None, bus: BusFlags) -> None:
    """Run the base station of a fleet or scenario FILE: cameras to poses, the kept state, and the page."""
    scenario = _scenario(file, bus)
    from basestation.dashboard.offer import offer, tokens_beside
    from basestation.station import run_basestation

    page: tuple[str, ...] = ()
    if web != "off":
        offered = offer(web, tokens or tokens_beside(state))
        if isinstance(offered, str):
            click.echo(offered)
        else:
            if tokens is None:  # otherwise the one who chose the file has said where the page is
                click.echo("\n".join(offered.lines))
            page = page_command(file, offered, scenario.bus)
    _run(lambda: run_basestation(scenario, state, page), "basestation")


def page_command(file: str, offered: Offer, bus: BusSettings) -> tuple[str, ...]:
    """The command line of the page's process.

    Args:
        file: of the scenario.
        offered: where it is served.
        bus: of the base station; the page's process is a client where that one is.
    """
    from muro_zenoh.supervision.launch import muro_command

    listens = tuple(re.sub(r"(?<=/)(0\.0\.0\.0|\[::\])(?=:)", "127.0.0.1", endpoint) for endpoint in bus.listen)
    connect = bus.connect if bus.mode == "client" or not listens else listens
    flags = ["--mode", "client", *(part for endpoint in connect for part in ("--connect", endpoint))]
    return muro_command("page", file, *offered.options, "--realm", bus.realm, *flags)


@click.command(hidden=True, epilog=example("muro page lab.toml --web 127.0.0.1:8010 --tokens page-tokens.json"))
@click.argument("file")
@click.option("--web", metavar="HOST:PORT", required=True, help="Where to serve it.")
@click.option("--tokens", type=click.Path(dir_okay=False, path_type=Path), required=True, metavar="FILE")
@bus_options
def page(file: str, web: str, tokens: Path, bus: BusFlags) -> None:
    """Serve the page of a fleet or scenario FILE, as the base station has it done."""
    scenario = _scenario(file, bus)
    from basestation.dashboard.access import address_of, tokens_in
    from basestation.dashboard.process import run_dashboard

    address, keys = address_of(web), tokens_in(tokens)
    _run(lambda: run_dashboard(scenario, address, keys), "page")


@click.command(
    epilog=example(
        "muro camera lab.toml north --device 0",
        "muro camera lab.toml north --device /dev/video2 --quality 70 --connect tcp/192.168.1.10:7447",
        "muro camera lab.toml north --recording monday.mp4 --show",
    )
)
@click.argument("file")
@click.argument("name")
@click.option("--device", metavar="NUMBER|PATH", help="A camera of this machine; 0 by default.")
@click.option(
    "--recording", metavar="PATH", type=click.Path(path_type=Path), help="A video or a directory of images instead."
)
@click.option(
    "--quality",
    type=click.IntRange(0, 100),
    default=85,
    show_default=True,
    help="Of the JPEG: 85 costs no accuracy, less costs less network; 0 for raw frames.",
)
@click.option(
    "--rate", type=click.FloatRange(0.5, 240.0), metavar="HZ", help="Pictures per second.  [default: the settings']"
)
@click.option(
    "--bandwidth",
    type=click.FloatRange(min=10.0),
    metavar="KB_S",
    help="Send at most so many kB/s: above it pictures become worse, and then fewer.",
)
@click.option("--show", is_flag=True, help="Show what is seen: in a window, or without a display as NAME.png.")
@bus_options
def camera(
    file: str,
    name: str,
    device: str | None,
    recording: Path | None,
    quality: int,
    rate: float | None,
    bandwidth: float | None,
    show: bool,
    bus: BusFlags,
) -> None:
    """Publish the pictures of camera NAME of a fleet or scenario FILE."""
    if device is not None and recording is not None:
        raise click.UsageError("got --device and --recording, expected one of them")
    scenario = _scenario(file, bus)
    from basestation.filming import run_camera
    from basestation.sources.opening import opener

    source = opener(scenario, name, device, recording, rate)
    if show:
        source = _shown(source, scenario, name)
    _run(lambda: run_camera(scenario, name, source, quality, bandwidth or math.inf), f"camera_{name}")


def _shown(source: Callable[[], FrameSource], scenario: Scenario, name: str) -> Callable[[], FrameSource]:
    from basestation.offline import Eye
    from basestation.showing import Screen, Shown

    screen = Screen(f"camera {name}", Path(f"{name}.png"))

    def opened() -> FrameSource:
        eye = Eye(scenario, name)  # takes a moment; the source's time begins when it is open
        return Shown(source(), eye, screen)

    return opened


@click.command(epilog=example("muro sim pursuit --seed 3"))
@click.argument("file")
@click.option(
    "--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Seed of starts, drive errors and noise."
)
@click.option("--bases", is_flag=True, help="Only the wheels: each camera is then a process of its own, --camera.")
@click.option("--camera", metavar="NAME", help="Only this camera, beside a simulator with --bases.")
@bus_options
def sim(file: str, seed: int, bases: bool, camera: str | None, bus: BusFlags) -> None:
    """Run the simulator of a fleet or scenario FILE: the wheels of all robots, and the cameras."""
    if bases and camera is not None:
        raise click.UsageError("--bases and --camera: got both, expected one of them: two processes, one for each")
    scenario = _scenario(file, bus)
    from agents.simulator import run_camera, run_simulator

    if camera is not None:
        _run(lambda: run_camera(scenario, camera, seed), f"camera-{camera}")
    _run(lambda: run_simulator(scenario, seed, cameras=not bases), "simulator")


@click.command(
    epilog=example(
        "muro router",
        "muro router --listen tcp/0.0.0.0:7447",
        "muro router --config deploy/router.json5",
    )
)
@click.argument("file", required=False)
@bus_options
def router(file: str | None, bus: BusFlags) -> None:
    """Run a Zenoh router, to which all other processes connect.

    It listens on the endpoints of --listen, or else those of the --config file, or else those that the processes of
    the fleet or scenario FILE connect to, or else tcp/127.0.0.1:7447.
    """
    from muro_zenoh.config import find_scenario
    from muro_zenoh.transport.router import router_settings, run_router

    settings = router_settings(find_scenario(file).bus if file is not None else None, bus)
    _run(lambda: run_router(settings), "router")
