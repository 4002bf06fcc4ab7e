"""``muro stop``, ``resume``, ``set``, ``goal``: orders to a running fleet."""

from __future__ import annotations

import math
from collections.abc import Callable, Coroutine, Iterable
from typing import TYPE_CHECKING, Any

import click

from muro_zenoh.cli.options import MuroGroup, assignments, bus_options, example

if TYPE_CHECKING:
    from muro_zenoh.config import BusSettings
    from muro_zenoh.messages import Health, Reply
    from muro_zenoh.transport import Bus, Every

_MOMENT = 1.5
"""A robot that cannot run a behaviour has said so by then [s]."""

BusFlags = Callable[..., "BusSettings"]


def on_bus(main: Callable[[Bus], Coroutine[Any, Any, int]], settings: BusSettings) -> None:
    """Open a bus, run a command on it, and leave with the exit code that it returns.

    Args:
        main: the command.
        settings: of the bus.
    """
    from muro_zenoh.channels import Role
    from muro_zenoh.runtime.process import run_process
    from muro_zenoh.transport import open_bus

    async def run() -> int:
        async with open_bus(settings, Role.OPERATOR) as bus:
            return await main(bus)

    raise SystemExit(run_process(run, "muro"))


@click.command(epilog=example("muro stop", "muro stop r2 r3"))
@click.argument("names", nargs=-1)
@bus_options
def stop(names: tuple[str, ...], bus: BusFlags) -> None:
    """Stop NAMES, or every robot.

    The order goes straight to the robots, base station or not, and to the base station, which keeps it. The exit code
    is 0 when every robot that is alive, and meant, has confirmed.
    """
    from muro_zenoh.cli.stopping import send_stop

    _check_names(names)
    on_bus(lambda b: send_stop(b, names), bus())


@click.command(epilog=example("muro resume", "muro resume r2"))
@click.argument("names", nargs=-1)
@bus_options
def resume(names: tuple[str, ...], bus: BusFlags) -> None:
    """Lift the stop of NAMES, or everybody's. Only the base station can; it refuses when it has changed meanwhile."""
    from muro_zenoh.cli.stopping import send_resume

    _check_names(names)
    on_bus(lambda b: send_resume(b, names), bus())


@click.command(
    epilog=example("muro goal r1 0.5 -0.4", "muro goal r1 0.5 -0.4 1.57"),
    context_settings={"ignore_unknown_options": True},  # coordinates may be negative
)
@click.argument("name")
@click.argument("x", type=float)
@click.argument("y", type=float)
@click.argument("theta", type=float, required=False)
@bus_options
def goal(name: str, x: float, y: float, theta: float | None, bus: BusFlags) -> None:
    """Send the robot NAME to X, Y [m, world], to arrive with the heading THETA [rad] if it is given.

    The exit code is 0 when the robot accepts, 1 when it refuses, with its reason (not every behaviour takes goals), or
    does not answer.
    """
    from muro_zenoh.cli.goal_order import send_goal

    _check_names((name,))
    for what, value in (("X", x), ("Y", y), ("THETA", theta)):
        if value is not None and not math.isfinite(value):
            raise click.BadParameter(f"got {value}, expected a finite number", param_hint=what)
    on_bus(lambda b: send_goal(b, name, x, y, theta), bus())


@click.group("set", cls=MuroGroup, epilog=example("muro set circle --radius 0.9", "muro set behaviour circle"))
def set_group() -> None:
    """Change what a running fleet does."""


@set_group.command(
    "circle", epilog=example("muro set circle --radius 0.9 --clockwise", "muro set circle --x 0.2 --y 0")
)
@click.option("--x", type=float, metavar="M", help="Of its centre [m, world].")
@click.option("--y", type=float, metavar="M", help="Of its centre [m, world].")
@click.option("--radius", type=click.FloatRange(min=0, min_open=True), metavar="M", help="Of it [m].")
@click.option("--clockwise/--counter-clockwise", default=None, help="The direction of travel.")
@bus_options
def set_circle(x: float | None, y: float | None, radius: float | None, clockwise: bool | None, bus: BusFlags) -> None:
    """Change the circle. What is not said stays as it is."""
    from muro_zenoh import channels
    from muro_zenoh.messages import SetCircle

    if x is None and y is None and radius is None and clockwise is None:
        raise click.UsageError("say what to change: --x, --y, --radius, --clockwise or --counter-clockwise")

    async def order(b: Bus) -> int:
        reply = await b.ask(channels.SET_CIRCLE, SetCircle(x=x, y=y, radius=radius, clockwise=clockwise))
        return _said(reply)

    on_bus(order, bus())


@set_group.command(
    "behaviour",
    epilog=example(
        "muro set behaviour pursuit cruise=0.15",
        "muro set behaviour circle --robot r1 --robot r2",
        "muro set behaviour mylab.swarm:flock",
    ),
)
@click.argument("name")
@click.argument("parameters", nargs=-1, metavar="[KEY=VALUE]...")
@click.option("--robot", "robots", multiple=True, metavar="NAME", help="Only this one; repeatable.  [default: all]")
@bus_options
def set_behaviour(name: str, parameters: tuple[str, ...], robots: tuple[str, ...], bus: BusFlags) -> None:
    """Change the behaviour to NAME, a built-in one or MODULE:FUNCTION, with its parameters."""
    import msgspec

    from muro_zenoh import channels
    from muro_zenoh.errors import ConfigError
    from muro_zenoh.messages import SetBehaviour, Value

    _check_names(robots)
    try:
        values = msgspec.convert(assignments(parameters, "parameter"), dict[str, Value])
    except msgspec.ValidationError as error:
        raise ConfigError(
            "parameter", got=str(error), expected="numbers, text, true or false, or an array of them"
        ) from None

    if ":" not in name:  # one's own behaviour may be on the robots only
        from agents.behaviours import check_behaviour

        check_behaviour(name, values, "muro set behaviour")

    async def order(b: Bus) -> int:
        healths = b.every(channels.HEALTH, "*", depth=256)
        said = _said(await b.ask(channels.SET_BEHAVIOUR, SetBehaviour(behaviour=name, parameters=values, names=robots)))
        return said or (await _refusals(healths, name) if ":" in name else 0)

    on_bus(order, bus())


async def _refusals(healths: Every[Health], behaviour: str) -> int:
    """Print which robots cannot run a behaviour, as they say within a moment; 1 when there are any."""
    import asyncio
    import contextlib

    refused: dict[str, str] = {}
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(_MOMENT):
            async for said in healths:
                reason = next((r for r in said.message.reasons if r.startswith(f"behaviour {behaviour}:")), "")
                if reason and refused.setdefault(said.name, reason) is reason:
                    click.echo(f"{said.name}: cannot run it: {reason}")
    return 1 if refused else 0


def _said(reply: Reply) -> int:
    from muro_zenoh.cli.stopping import answer_of

    click.echo(f"base station: {answer_of(reply)}")
    return 0 if reply.accepted else 1


def _check_names(names: Iterable[str]) -> None:
    from muro_zenoh.channels import check_name

    for name in names:
        check_name(name, "robot")
