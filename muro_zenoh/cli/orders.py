"""``muro stop``, ``resume``, ``set``, ``goal``, ``clear``: orders to a running fleet."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Coroutine, Iterable
from typing import TYPE_CHECKING, Any

import click

from muro_zenoh.cli.group import MuroGroup
from muro_zenoh.cli.options import BusFlags, assignments, bus_options, example

if TYPE_CHECKING:
    from muro_zenoh.config import BusSettings
    from muro_zenoh.messages import Reply
    from muro_zenoh.transport import Bus


def on_bus(main: Callable[[Bus], Coroutine[Any, Any, int]], settings: BusSettings) -> None:
    """Open a bus, run a command on it, and exit with the code that it returns.

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


@click.command(epilog=example("muro stop", "muro stop r2 r3", "muro stop --json"))
@click.argument("names", nargs=-1)
@click.option("--json", "as_json", is_flag=True, help="Print the receipt as JSON.")
@bus_options
def stop(names: tuple[str, ...], as_json: bool, bus: BusFlags) -> None:
    """Stop NAMES, or every robot.

    The order goes straight to the robots, base station or not, and to the base station, which keeps it. For each robot
    the receipt has the time until its agent latched the stop and until its wheels were at rest, and how far it went
    meanwhile, by its wheels. The exit code is 0 when every named robot, or without NAMES every robot that is alive or
    on the floor, has latched it and stands still. A robot that was switched off is on the floor until it is carried
    away and cleared.
    """
    from muro_zenoh.orders.stop import stop_robots
    from muro_zenoh.orders.wording import receipt_json, receipt_lines

    settings = bus()

    async def order(b: Bus) -> int:
        result = await stop_robots(b, names)
        lines = receipt_lines(result, settings.connect or settings.listen)
        click.echo(json.dumps({**receipt_json(result), "routers": settings.connect}) if as_json else "\n".join(lines))
        return 0 if result.confirmed else 1

    _check_names(names)
    on_bus(order, settings)


@click.command(epilog=example("muro resume", "muro resume r2"))
@click.argument("names", nargs=-1)
@bus_options
def resume(names: tuple[str, ...], bus: BusFlags) -> None:
    """Lift the stop of NAMES, or of all robots.

    Only the base station can. It refuses when the stop state has changed in the meantime.
    """
    from muro_zenoh.orders.stop import resume_robots

    async def order(b: Bus) -> int:
        result = await resume_robots(b, names)
        _print_reply(result.reply)
        for name in result.still_stopped:
            click.echo(f"{name}: still reports that it is stopped")
        return 0 if result.reply.accepted and not result.still_stopped else 1

    _check_names(names)
    on_bus(order, bus())


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

    A robot that is stopped accepts, says so, and drives when it is resumed. The exit code is 0 when the robot accepts,
    1 when it refuses, with its reason (not every behaviour takes goals), or does not answer.
    """
    from muro_zenoh.messages import Goal
    from muro_zenoh.orders.goal import send_goal

    async def order(b: Bus) -> int:
        answer = await send_goal(b, name, Goal(x=x, y=y, theta=theta))
        still = f"; it does not drive yet: {answer.reason}" if answer.reason else ""
        click.echo(f"{name}: " + (f"accepted{still}" if answer.accepted else f"refused: {answer.reason}"))
        return 0 if answer.accepted else 1

    _check_names((name,))
    for what, value in (("X", x), ("Y", y), ("THETA", theta)):
        if value is not None and not math.isfinite(value):
            raise click.BadParameter(f"got {value}, expected a finite number", param_hint=what)
    on_bus(order, bus())


@click.command(epilog=example("muro clear r3"))
@click.argument("name")
@bus_options
def clear(name: str, bus: BusFlags) -> None:
    """Forget where the robot NAME was last seen.

    A robot that no camera sees any more stays an obstacle where it was. Once it has been carried away, clear it. It is
    back as soon as a camera sees it again. The exit code is 1 when it was never seen.
    """
    from muro_zenoh import channels
    from muro_zenoh.messages import Clear

    async def order(b: Bus) -> int:
        reply = await b.ask(channels.CLEAR, Clear(name=name))
        click.echo(f"{name}: forgotten, until a camera sees it again" if reply.accepted else f"refused: {reply.reason}")
        return 0 if reply.accepted else 1

    _check_names((name,))
    on_bus(order, bus())


@click.group("set", cls=MuroGroup, epilog=example("muro set circle --radius 0.9", "muro set behaviour circle"))
def set_group() -> None:
    """Change what a running fleet does."""


@set_group.command(
    "circle", epilog=example("muro set circle --radius 0.9 --clockwise", "muro set circle --x 0.2 --y 0")
)
@click.option("--x", type=float, metavar="M", help="x of its centre [m, world].")
@click.option("--y", type=float, metavar="M", help="y of its centre [m, world].")
@click.option("--radius", type=click.FloatRange(min=0, min_open=True), metavar="M", help="Its radius [m].")
@click.option("--clockwise/--counter-clockwise", default=None, help="The direction of travel.")
@bus_options
def set_circle(x: float | None, y: float | None, radius: float | None, clockwise: bool | None, bus: BusFlags) -> None:
    """Change the circle. What is not given stays as it is."""
    from muro_zenoh import channels
    from muro_zenoh.messages import SetCircle

    if x is None and y is None and radius is None and clockwise is None:
        raise click.UsageError("nothing to change: give --x, --y, --radius, --clockwise or --counter-clockwise")

    async def order(b: Bus) -> int:
        reply = await b.ask(channels.SET_CIRCLE, SetCircle(x=x, y=y, radius=radius, clockwise=clockwise))
        _print_reply(reply)
        return 0 if reply.accepted else 1

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
@click.option("--robot", "robots", multiple=True, metavar="NAME", help="Only this robot; repeatable.  [default: all]")
@bus_options
def set_behaviour(name: str, parameters: tuple[str, ...], robots: tuple[str, ...], bus: BusFlags) -> None:
    """Change the behaviour to NAME, a built-in one or MODULE:FUNCTION, with its parameters."""
    import msgspec

    from muro_zenoh.errors import ConfigError
    from muro_zenoh.messages import SetBehaviour, Value
    from muro_zenoh.orders.behaviour import set_behaviour as change_behaviour

    _check_names(robots)
    try:
        values = msgspec.convert(assignments(parameters, "parameter"), dict[str, Value])
    except msgspec.ValidationError as error:
        raise ConfigError(
            "parameter", got=str(error), expected="numbers, text, true or false, or an array of them"
        ) from None

    async def order(b: Bus) -> int:
        result = await change_behaviour(b, SetBehaviour(behaviour=name, parameters=values, names=robots))
        _print_reply(result.reply)
        for robot, reason in result.refusals.items():
            click.echo(f"{robot}: cannot run it: {reason}")
        return 0 if result.reply.accepted and not result.refusals else 1

    on_bus(order, bus())


def _print_reply(reply: Reply) -> None:
    from muro_zenoh.orders.wording import reply_line

    click.echo(reply_line(reply))


def _check_names(names: Iterable[str]) -> None:
    from muro_zenoh.channels import check_name

    for name in names:
        check_name(name, "robot")
