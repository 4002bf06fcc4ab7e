"""The tables of ``docs/channels.md``, generated from the code."""

from __future__ import annotations

import math
from typing import Any

import msgspec

from muro_zenoh import messages as m
from muro_zenoh.channels.keys import key_of
from muro_zenoh.channels.kinds import Channel, Party, Verb
from muro_zenoh.channels.table import CHANNELS, VERBS
from muro_zenoh.pages import markdown_table, with_generated


def page(text: str) -> str:
    """The page of channels with its tables generated again.

    Args:
        text: the page as it is; what is outside the marks stays.

    Raises:
        ConfigError: the marks are missing.
    """
    tables = {"Channels": _channel_table(), "Orders": _order_table(), "Messages": _message_table()}
    generated = "\n".join(f"## {title}\n\n{table}" for title, table in tables.items())
    return with_generated(text, "muro_zenoh.channels", "docs/channels.md", generated)


def _channel_table() -> str:
    rows = [_channel_row(channel) for channel in CHANNELS]
    head = ("key", "message", "writers", "readers", "rate", "delivery", "priority", "stale after", "seed's ROS topic")
    return markdown_table((*head, ""), rows)


def _channel_row(c: Channel[Any]) -> tuple[str, ...]:
    key = f"`muro/{c.word}/<{c.named}>`" if c.named else f"`{key_of('muro', c)}`"
    rate = f"{c.rate:g} Hz" if c.rate is not None else ""
    stale = f"{c.stale_after:g} s" if c.stale_after < math.inf else "-"
    priority = c.priority.name.lower().replace("_", "-")
    pacing = ", ".join(part for part in (rate, c.pacing) if part)
    ends = _parties(c.writers), _parties(c.readers)
    return key, c.kind.__name__, *ends, pacing or "event", c.delivery, priority, stale, _ros(c.ros), c.note


def _ros(topic: str) -> str:
    return f"`{topic}`" if topic and not topic.startswith("(") else topic or "-"


def _parties(parties: tuple[Party, ...]) -> str:
    return ", ".join(map(str, parties))


def _order_table() -> str:
    rows = [
        (f"`{_verb_pattern(v)}`", v.kind.__name__, ", ".join(v.asked_by), str(v.answered_by), _ros(v.ros))
        for v in VERBS
    ]
    return markdown_table(("key of the query", "message", "asked by", "answered by", "seed's ROS topic"), rows)


def _verb_pattern(verb: Verb[Any]) -> str:
    return f"muro/{verb.word}/<{verb.named}>" if verb.named else f"muro/{verb.answered_by}/{verb.word}"


def _message_table() -> str:
    kinds: dict[Any, None] = dict.fromkeys(
        [*(c.kind for c in CHANNELS), m.RobotState, m.Lease, *(v.kind for v in VERBS), m.Reply]
    )
    common = {f.name for f in msgspec.structs.fields(m.Message)}
    rows = []
    for kind in kinds:
        fields = [f for f in msgspec.structs.fields(kind) if f.name not in common]
        rows.append((kind.__name__, " ".join(f"`{f.name}`" + ("" if f.required else "?") for f in fields)))
    return markdown_table(("message", "fields (besides `stamp`, `seq`, `epoch`)"), rows)
