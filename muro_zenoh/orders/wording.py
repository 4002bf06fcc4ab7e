"""The receipt of a stop, as text and as JSON."""

from __future__ import annotations

import time
from collections.abc import Iterable
from typing import Any

from muro_zenoh.messages import Reply
from muro_zenoh.orders.receipt import StopReceipt, StopStatus
from muro_zenoh.orders.stop import StopResult
from muro_zenoh.wording import counted

_WORDS = {
    StopStatus.STOPPED: "has stopped",
    StopStatus.MOVING: "DOES NOT STAND: its wheels still turn",
    StopStatus.NO_ODOMETRY: "has latched the stop; whether its wheels turn is unknown",
    StopStatus.UNCONFIRMED: "DOES NOT CONFIRM",
    StopStatus.NOT_ALIVE: "is not alive, so it does not confirm",
    StopStatus.UNKNOWN: "no robot of this name is known",
}

_HEAD = ("robot", "latched after", "at rest after", "travelled", "")


def receipt_lines(result: StopResult, routers: tuple[str, ...] = ()) -> list[str]:
    """A stop's result as lines of text: a row per robot, then who is missing.

    Args:
        result: what came of the stop.
        routers: where it was sent; none for the fleet that everybody looks at.
    """
    sent = time.strftime("%H:%M:%S", time.localtime(result.sent)) + f".{int(result.sent % 1.0 * 1e3):03d}"
    lines = [f"stop sent {sent}" + (f" to the router {', '.join(routers)}" if routers else "")]
    lines.append(reply_line(result.reply))
    if routers and result.reply is None and not result.known:
        lines.append(
            "Is the fleet on another router? `muro run` says which when it has one of its own: name it with --connect"
        )
    if not result.robots:
        return [*lines, "no robot is alive"]
    rows = [_HEAD, *(_row(name, receipt) for name, receipt in result.robots.items())]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)][:-1]
    lines += ["  ".join([*map(str.ljust, row[:-1], widths), row[-1]]).rstrip() for row in rows]
    if any(receipt.status is StopStatus.UNKNOWN for receipt in result.robots.values()):
        lines.append(
            f"known robots: {' '.join(result.known) or 'none'}; the stop holds for the others, should they come"
        )
    return [*lines, _total(result)]


def reply_line(reply: Reply | None) -> str:
    """The base station's answer as a line of text.

    Args:
        reply: the answer; None for none.
    """
    if reply is None:
        text = "did not answer: only the agents that are running now remember this stop, until it is back"
    elif reply.accepted:
        text = f"accepted, revision {reply.revision}"
    else:
        text = f"refused: {reply.reason}"
    return f"base station: {text}"


def receipt_json(result: StopResult) -> dict[str, Any]:
    """A stop's result as a table for JSON.

    Args:
        result: what came of the stop.
    """
    reply = result.reply
    return {
        "sent": result.sent,
        "confirmed": result.confirmed,
        "basestation": None
        if reply is None
        else {"accepted": reply.accepted, "reason": reply.reason, "revision": reply.revision},
        "robots": {
            name: {
                "status": receipt.status.value,
                "latched_after_s": receipt.latched,
                "at_rest_after_s": receipt.at_rest,
                "travelled_m": receipt.travelled,
                "silent_s": receipt.silent,
            }
            for name, receipt in result.robots.items()
        },
    }


def _row(name: str, receipt: StopReceipt) -> tuple[str, ...]:
    return (
        name,
        _number(receipt.latched, ".3f", "s"),
        _number(receipt.at_rest, ".2f", "s"),
        _number(receipt.travelled, ".3f", "m"),
        _WORDS[receipt.status],
    )


def _total(result: StopResult) -> str:
    stopped = [r for r in result.robots.values() if r.status is StopStatus.STOPPED]
    missing = {name: r for name, r in result.robots.items() if r.status is not StopStatus.STOPPED}
    total = f"{len(stopped)} of {counted(len(result.robots), 'robot')} stopped"
    return "; ".join([total, *_missing(missing.items())])


def _missing(robots: Iterable[tuple[str, StopReceipt]]) -> Iterable[str]:
    for name, receipt in robots:
        if receipt.status is StopStatus.MOVING:
            yield f"{name} still moves"
            continue
        if receipt.status is StopStatus.UNKNOWN:
            yield f"{name} unknown"
            continue
        who = f"the wheels of {name}" if receipt.status is StopStatus.NO_ODOMETRY else name
        yield f"{who} silent for {receipt.silent:.1f} s"


def _number(value: float | None, form: str, unit: str) -> str:
    return "-" if value is None else f"{value:{form}} {unit}"
