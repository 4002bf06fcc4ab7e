"""``muro stop``, ``resume``, ``set``: orders to a running fleet."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Iterable
from typing import TYPE_CHECKING, Any

import click

from muro_zenoh.cli.options import MuroGroup, assignments, bus_options, example

if TYPE_CHECKING:
    from muro_zenoh.config import BusSettings
    from muro_zenoh.messages import Reply
    from muro_zenoh.transport import Bus

BusFlags = Callable[..., "BusSettings"]

_REPEATS = 6
_REPEAT_PERIOD = 0.1
"""A stop is sent at once, and again for half a second: a robot may be connecting just now [s]."""

_CONFIRMED_WITHIN = 2.5
"""Agents report at once when they latch a stop, and once a second besides [s]."""

_STOP_HEARD_WITHIN = 1.5
"""The base station repeats the stop state twice a second [s]."""


def on_bus(main: Callable[[Bus], Coroutine[Any, Any, int]], settings: BusSettings) -> None:
    """Open a bus, run a command on it, and leave with the exit code that it returns.

    Args:
        main: the command.
        settings: of the bus.
    """
    from muro_zenoh.runtime.process import run_process
    from muro_zenoh.transport import open_bus

    async def run() -> int:
        async with open_bus(settings) as bus:
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
    _check_names(names)
    on_bus(lambda b: send_stop(b, names), bus())


async def send_stop(bus: Bus, names: tuple[str, ...]) -> int:
    """Stop robots.

    Args:
        bus: the bus.
        names: which; none for everybody.

    Returns:
        The exit code.
    """
    from muro_zenoh import channels
    from muro_zenoh.errors import MuroError
    from muro_zenoh.messages import Stop, StopOrder

    heard = bus.latest(channels.STOP)
    health = bus.latest(channels.HEALTH, "*")
    roster = bus.roster()
    orders = bus.publisher(channels.STOP)
    asking = asyncio.create_task(bus.ask(channels.STOP_ORDER, Stop(names=names)))
    try:
        for _ in range(_REPEATS):
            # It is the whole state: whoever was stopped before stays so. A stop is obeyed at any revision.
            known = heard.get()
            before = known.message if known is not None else StopOrder(all=False)
            orders.put(
                StopOrder(
                    all=before.all or not names, names=tuple(sorted({*before.names, *names})), revision=before.revision
                )
            )
            await asyncio.sleep(_REPEAT_PERIOD)

        def missing() -> list[str]:
            alive = roster.of("agent")
            meant = sorted(set(names) if names else alive)
            return [n for n in meant if n not in alive or not (h := health.get(n)) or not h.message.stop_latched]

        await _until(lambda: not missing(), _CONFIRMED_WITHIN)
        try:
            reply: Reply | None = await asking
        except MuroError:
            reply = None
    finally:
        asking.cancel()
    alive = roster.of("agent")
    unconfirmed = missing()
    click.echo(
        "base station: " + _answer(reply, "did not answer, so nobody keeps this order but the robots themselves")
    )
    for name in sorted(set(names) or alive):
        if name not in alive:
            click.echo(f"{name}: is not alive")
        else:
            click.echo(f"{name}: " + ("DOES NOT CONFIRM" if name in unconfirmed else "has stopped"))
    if not alive:
        click.echo("no robot is alive")
        return 0 if reply is not None and reply.accepted and not names else 1
    return 1 if unconfirmed else 0


@click.command(epilog=example("muro resume", "muro resume r2"))
@click.argument("names", nargs=-1)
@bus_options
def resume(names: tuple[str, ...], bus: BusFlags) -> None:
    """Lift the stop of NAMES, or everybody's. Only the base station can; it refuses when it has changed meanwhile."""
    _check_names(names)
    on_bus(lambda b: send_resume(b, names), bus())


async def send_resume(bus: Bus, names: tuple[str, ...]) -> int:
    """Lift a stop.

    Args:
        bus: the bus.
        names: whose; none for everybody's.

    Returns:
        The exit code.
    """
    from muro_zenoh import channels
    from muro_zenoh.errors import NoReply
    from muro_zenoh.messages import Resume

    heard = bus.latest(channels.STOP)
    health = bus.latest(channels.HEALTH, "*")
    roster = bus.roster()
    await _until(lambda: heard.get() is not None and bool(roster.of("basestation")), _STOP_HEARD_WITHIN)
    known = heard.get()
    if known is None or not roster.of("basestation"):
        raise NoReply(
            f"the base station is silent (waited {_STOP_HEARD_WITHIN:g} s for its stop state), and only it can lift a "
            "stop. Is `muro basestation` running, and on this router?"
        )
    reply = await bus.ask(channels.RESUME, Resume(revision=known.message.revision, names=names))
    click.echo(f"base station: {_answer(reply)}")
    if not reply.accepted:
        return 1

    def still() -> list[str]:
        alive = roster.of("agent")
        meant = sorted(set(names) & alive if names else alive)
        return [n for n in meant if not (h := health.get(n)) or h.message.stop_latched]

    await _until(lambda: not still(), _CONFIRMED_WITHIN)
    for name in still():
        click.echo(f"{name}: still says that it is stopped")
    return 1 if still() else 0


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

    async def order(b: Bus) -> int:
        return _said(await b.ask(channels.SET_BEHAVIOUR, SetBehaviour(behaviour=name, parameters=values, names=robots)))

    on_bus(order, bus())


def _said(reply: Reply) -> int:
    click.echo(f"base station: {_answer(reply)}")
    return 0 if reply.accepted else 1


def _answer(reply: Reply | None, silent: str = "") -> str:
    if reply is None:
        return silent
    return f"accepted, revision {reply.revision}" if reply.accepted else f"refused: {reply.reason}"


def _check_names(names: Iterable[str]) -> None:
    from muro_zenoh.channels import check_name

    for name in names:
        check_name(name, "robot")


async def _until(condition: Callable[[], bool], timeout: float) -> None:
    """Wait until a condition holds, or for ``timeout`` [s] at most."""
    loop = asyncio.get_running_loop()
    end = loop.time() + timeout
    while not condition() and loop.time() < end:  # noqa: ASYNC110 - several mailboxes at once
        await asyncio.sleep(0.02)
