"""The topology: one table, one row per channel; key builders and parsers. ``docs/channels.md`` is made from it.

A key is ``<realm>/<channel>`` or ``<realm>/<channel>/<name>``. The realm is ``muro`` unless the settings say otherwise,
so that labs can share a network.
"""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any, Final, Generic, Literal, TypeVar

import msgspec

from muro_zenoh import messages as m
from muro_zenoh.errors import ConfigError
from muro_zenoh.messages import Message

M_co = TypeVar("M_co", bound=Message, covariant=True)

Delivery = Literal["newest", "every", "kept"]
"""``newest``: a reader wants the last value. ``every``: each one, from a bounded queue that drops the oldest.
``kept``: the last value, also for those who come late."""


class Priority(IntEnum):
    """How urgent a message is; the numbers are Zenoh's."""

    REAL_TIME = 1
    HIGH = 2
    DATA = 5
    BACKGROUND = 7


@dataclass(frozen=True, slots=True)
class Channel(Generic[M_co]):
    """One row of the table.

    Attributes:
        word: the second word of its keys.
        kind: the message on it.
        writer: who publishes it, with commas between; nobody else may.
        readers: who takes it in, with commas between; programs of a laboratory's own may besides.
        rate: how often, in words.
        delivery: what a reader gets.
        stale_after: age at which its value no longer counts [s]; None where age does not matter.
        named: what the third word of the key names; empty when the channel has one key only.
        ros: the topic it replaces.
        note: what else to know.
    """

    word: str
    kind: type[M_co]
    writer: str
    readers: str
    rate: str
    delivery: Delivery
    stale_after: float | None = None
    priority: Priority = Priority.DATA
    named: str = "robot"
    ros: str = ""
    note: str = ""


CAMERA = Channel(
    "camera",
    m.Frame,
    "camera, simulator",
    "basestation",
    "15-30 Hz",
    "newest",
    0.5,
    Priority.BACKGROUND,
    "camera",
    "(camera video)",
)
POSE = Channel(
    "pose", m.PoseFix, "basestation", "agent/localize", "camera rate", "every", 0.4, Priority.HIGH, ros="amcl_pose"
)
ESTIMATE = Channel(
    "estimate",
    m.Estimate,
    "agent/localize",
    "agent/path_following, agent/pursuit, agent/dubins, agent/coverage, agent/steer, basestation",
    "each fix, 30 Hz",
    "newest",
    0.4,
    ros="afterKalman",
    note="handed over in the process within its own agent",
)
CAL_OMEGA = Channel(
    "cal0",
    m.Calibration,
    "agent/localize",
    "agent/drive, operator",
    "1 Hz",
    "kept",
    ros="cal0",
    note="multiplies omega",
)
CAL_V = Channel(
    "calD", m.Calibration, "agent/localize", "agent/drive, operator", "1 Hz", "kept", ros="calD", note="multiplies v"
)
ALL_POSITIONS = Channel(
    "all_positions",
    m.FleetSnapshot,
    "basestation",
    "agent/pursuit, agent/coverage",
    "each fused frame, 5 Hz at least",
    "newest",
    0.5,
    Priority.HIGH,
    named="",
    ros="/all_positions",
)
VELOCITY = Channel(
    "velocity",
    m.SpeedReference,
    "agent/pursuit",
    "agent/path_following",
    "10 Hz or faster",
    "newest",
    0.5,
    ros="velocity",
    note="or from anyone's replacement for pursuit",
)
CMD_VEL = Channel(
    "cmd_vel",
    m.VelocityCommand,
    "agent/drive",
    "base, agent/localize",
    "each estimate",
    "newest",
    0.3,
    Priority.REAL_TIME,
    ros="mobile_base/commands/velocity",
    note="older than 300 ms, the base's dead-man zeroes the wheels",
)
GOAL = Channel(
    "goal",
    m.Goal,
    "operator, agent/coverage",
    "agent/dubins, agent/steer",
    "event",
    "every",
    ros="move_base_simple/goal",
    note="acknowledged",
)
PATH = Channel("path", m.PlannedPath, "agent/dubins", "operator", "event", "kept", note="the planned Dubins path")
CELL = Channel("cell", m.Cell, "agent/coverage", "operator", "1 Hz and on change", "newest", note="for drawing")
CIRCLE = Channel(
    "circle",
    m.Circle,
    "basestation",
    "agent/path_following, agent/pursuit, operator",
    "2 Hz and on an order",
    "kept",
    named="",
    ros="/centroidPos",
)
BEHAVIOUR = Channel(
    "behaviour", m.Behaviour, "basestation", "agent/behave", "2 Hz and on an order", "kept", ros="(launch file)"
)
ODOMETRY = Channel("odometry", m.Odometry, "base", "agent/localize", "50 Hz", "every", 0.15, ros="odom")
BASE = Channel("base", m.BaseState, "base", "operator", "2 Hz and on change", "newest")
HEALTH = Channel(
    "health", m.Health, "every process", "basestation, operator", "1 Hz and on change", "kept", 3.0, named="process"
)
ACK = Channel(
    "ack",
    m.Ack,
    "agent/dubins, agent/steer",
    "operator",
    "repeated until superseded",
    "kept",
    note="from who took an order",
)
STOP = Channel(
    "stop",
    m.StopOrder,
    "basestation, operator",
    "agent/drive",
    "2 Hz and on an order",
    "kept",
    priority=Priority.REAL_TIME,
    named="",
    note="the whole state, never a difference; a stop comes from the operator directly too",
)
TRUTH = Channel(
    "truth",
    m.Truth,
    "simulator",
    "operator",
    "50 Hz",
    "newest",
    note="for score sheets only; no task may read it",
)

CHANNELS: Final[tuple[Channel[Any], ...]] = (
    CAMERA,
    POSE,
    ESTIMATE,
    CAL_OMEGA,
    CAL_V,
    ALL_POSITIONS,
    VELOCITY,
    CMD_VEL,
    GOAL,
    PATH,
    CELL,
    CIRCLE,
    BEHAVIOUR,
    ODOMETRY,
    BASE,
    HEALTH,
    ACK,
    STOP,
    TRUTH,
)


@dataclass(frozen=True, slots=True)
class Verb(Generic[M_co]):
    """An order to the base station: a Zenoh query on ``<realm>/basestation/<word>`` with one reply."""

    word: str
    kind: type[M_co]


SET_CIRCLE = Verb("set_circle", m.SetCircle)
SET_BEHAVIOUR = Verb("set_behaviour", m.SetBehaviour)
STOP_ORDER = Verb("stop", m.Stop)
RESUME = Verb("resume", m.Resume)
CLEAR = Verb("clear", m.Clear)

VERBS: Final[tuple[Verb[Any], ...]] = (SET_CIRCLE, SET_BEHAVIOUR, STOP_ORDER, RESUME, CLEAR)

NAME_PATTERN: Final = re.compile(r"[a-z][a-z0-9_]{0,31}")
_REALM_PATTERN: Final = re.compile(r"[a-z][a-z0-9_]{0,31}(/[a-z][a-z0-9_]{0,31})*")


def check_name(name: str, where: str = "name") -> str:
    """The name, if it is one. Zenoh would take spaces and wildcards; we do not.

    Raises:
        ConfigError: it does not match ``[a-z][a-z0-9_]{0,31}``.
    """
    if not NAME_PATTERN.fullmatch(name):
        raise ConfigError(
            where, got=repr(name), expected="lower-case letters, digits and _, at most 32, a letter first"
        )
    return name


def check_realm(realm: str, where: str = "bus.realm") -> str:
    """The realm, if it is one: names joined by ``/``.

    Raises:
        ConfigError: it is not.
    """
    if not _REALM_PATTERN.fullmatch(realm):
        raise ConfigError(where, got=repr(realm), expected="a name such as 'muro', or names joined by '/'")
    return realm


def key_of(realm: str, channel: Channel[Any], name: str = "") -> str:
    """The key of a channel, or its key expression when ``name`` is ``*``.

    Raises:
        ConfigError: a name where the channel has none, or none where it needs one, or not a name.
    """
    if not channel.named:
        if name:
            raise ConfigError(
                f"channel {channel.word}", got=f"the name {name!r}", expected="no name: it has one key only"
            )
        return f"{realm}/{channel.word}"
    if name != "*":
        check_name(name, f"channel {channel.word}")
    return f"{realm}/{channel.word}/{name}"


def name_in(realm: str, channel: Channel[Any], key: str) -> str:
    """The name in a channel's key; empty for a channel without names."""
    return key[len(realm) + len(channel.word) + 2 :]


def alive_key(realm: str, role: str, name: str) -> str:
    """The key of a liveliness token."""
    return f"{realm}/alive/{role}/{name}"


def alive_in(realm: str, key: str) -> tuple[str, str]:
    """Role and name in the key of a liveliness token."""
    role, _, name = key[len(realm) + len("/alive/") :].partition("/")
    return role, name


def verb_key(realm: str, verb: Verb[Any]) -> str:
    """The key that an order is asked on."""
    return f"{realm}/basestation/{verb.word}"


def channel_table() -> str:
    """The table as Markdown, for ``docs/channels.md``."""
    head = "| key | message | writer | readers | rate | delivery | priority | stale after | seed's ROS topic | |\n"
    rows = [head, "|---|---|---|---|---|---|---|---|---|---|\n"]
    for c in CHANNELS:
        key = f"`muro/{c.word}/<{c.named}>`" if c.named else f"`muro/{c.word}`"
        stale = f"{c.stale_after:g} s" if c.stale_after is not None else "-"
        ros = f"`{c.ros}`" if c.ros and not c.ros.startswith("(") else c.ros or "-"
        priority = c.priority.name.lower().replace("_", "-")
        cells = (key, c.kind.__name__, c.writer, c.readers, c.rate, c.delivery, priority, stale, ros, c.note)
        rows.append("| " + " | ".join(cells) + " |\n")
    for v in VERBS:
        key = f"`muro/basestation/{v.word}`"
        rows.append(f"| {key} | {v.kind.__name__} | operator | basestation | event | query | - | - | - | one reply |\n")
    return "".join(rows)


def message_table() -> str:
    """The fields of every message as Markdown, for ``docs/channels.md``."""
    kinds: dict[Any, None] = dict.fromkeys(
        [*(c.kind for c in CHANNELS), m.RobotState, *(v.kind for v in VERBS), m.Reply]
    )
    rows = ["| message | fields (besides `stamp`, `seq`, `epoch`) |\n", "|---|---|\n"]
    common = {f.name for f in msgspec.structs.fields(m.Message)}
    for kind in kinds:
        fields = [f for f in msgspec.structs.fields(kind) if f.name not in common]
        text = " ".join(f"`{f.name}`" + ("" if f.required else "?") for f in fields)
        rows.append(f"| {kind.__name__} | {text} |\n")
    return "".join(rows)


_BEGIN: Final = "<!-- generated by `python -m muro_zenoh.channels docs/channels.md`: change the code instead -->\n"
_END: Final = "<!-- end of the generated part -->\n"


def page(text: str) -> str:
    """The page of channels with its generated part made anew.

    Args:
        text: the page as it is; what stands outside its marks stays.

    Raises:
        ConfigError: the marks are missing.
    """
    before, begin, rest = text.partition(_BEGIN)
    _, end, after = rest.partition(_END)
    if not (begin and end):
        raise ConfigError("page of channels", got="no marks", expected=f"{_BEGIN.strip()} and {_END.strip()} in it")
    generated = f"\n## Channels\n\n{channel_table()}\n## Messages\n\n{message_table()}\n"
    return f"{before}{begin}{generated}{end}{after}"


if __name__ == "__main__":
    for name in sys.argv[1:]:
        path = Path(name)
        path.write_text(page(path.read_text(encoding="utf-8")), encoding="utf-8")
