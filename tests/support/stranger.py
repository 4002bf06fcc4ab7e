"""A stranger on the bus: real messages, mutated. The same ones from the same seed."""

from __future__ import annotations

import math
import random
from collections import Counter
from typing import Any, NamedTuple

import msgpack
import msgspec

from muro_zenoh import channels
from muro_zenoh.messages import Clear, Goal, Message, Resume, SetBehaviour, SetCircle, Stop, encode, encoding_of

_ABSURD = (1e300, -1e300, 1e154, -1.8e19, 1e100, -1e30, 1e12, -1e12, 1e-320, -5e-324, 1e6, -1e6, 0.0, -1.0)
_ODD: tuple[Any, ...] = (None, True, "", "north", b"\xff", [], [1.0], {}, {"x": 1.0}, math.nan, math.inf, -math.inf)
_HUGE = (2**31, 2**52, 2**53 - 1, 2**53, 2**63, 2**64 - 1)
_STAMPS = (1e300, 1e18, 1e12, 9.9e11, 1e10, 5e-324, 1e-9, 0.0, -1.0, -1.7e9, -1e300)
_LEAPS = (0.01, 0.03, 0.1, 0.2, 0.3, 0.45, 0.6, 1.0, 2.0, 40.0, 3600.0, 1e6)
_LARGE = 65536
_ENCODINGS = ("application/msgpack;Goal.1", "application/msgpack;PoseFix.2", "text/plain", "zenoh/bytes")

_ORDERS: tuple[tuple[channels.Verb[Any], str, Message], ...] = (
    (channels.GOAL_ORDER, "r1", Goal(stamp=1.7e9, x=1.0, y=1.0, theta=0.5)),
    (channels.SET_CIRCLE, "", SetCircle(stamp=1.7e9, x=0.0, y=0.0, radius=0.6)),
    (channels.SET_BEHAVIOUR, "", SetBehaviour(stamp=1.7e9, behaviour="pursuit", names=("r1",))),
    (channels.STOP_ORDER, "", Stop(stamp=1.7e9, names=("r2",))),
    (channels.RESUME, "", Resume(stamp=1.7e9, revision=1)),
    (channels.CLEAR, "", Clear(stamp=1.7e9, name="r3")),
)


_NAMES = {"robot": "r1", "camera": "north", "process": "basestation", "": ""}
"""Whose messages are made of nothing, when none of the kind has been heard."""


class Sent(NamedTuple):
    """Bytes to be put on a key, or to be asked there."""

    key: str
    payload: bytes
    encoding: str | None
    is_order: bool


class Stranger:
    """Makes messages of nobody's from those that it has heard.

    Args:
        seed: of its choices.
        realm: of the fleet.

    Attributes:
        made: how many messages of each mutation.
        sent: how many messages to each channel and order, by ``camera``, ``order goal`` and so on.
    """

    def __init__(self, seed: int, realm: str = "muro") -> None:
        self.made: Counter[str] = Counter()
        self.sent: Counter[str] = Counter()
        self._random = random.Random(seed)
        self._heard: dict[str, tuple[bytes, str | None]] = {
            channels.key_of(realm, channel, _NAMES[channel.named]): (example(channel.kind), encoding_of(channel.kind))
            for channel in channels.CHANNELS
        }
        self._realm = realm
        good = {verb: (name, encode(order)) for verb, name, order in _ORDERS}
        self._orders = [
            (f"order {verb.word}", channels.verb_key(realm, verb, name), payload, encoding_of(verb.kind))
            for verb in channels.VERBS
            for name, payload in [good.get(verb, (_NAMES[verb.named], example(verb.kind)))]
        ]
        self._mutations = (
            self._flip,
            self._cut,
            self._odd,
            self._absurd,
            self._stamp,
            self._leap,
            self._writer,
            self._encoding,
            self._noise,
            self._replay,
        )

    def hear(self, key: str, payload: bytes, encoding: str | None) -> None:
        """Take a message of the fleet, to be mutated from now on."""
        self._heard[key] = payload, encoding

    @property
    def keys(self) -> list[str]:
        """The keys heard so far."""
        return sorted(self._heard.copy())  # a copy at once: another thread may be adding to it

    def next(self) -> Sent:
        """The next message."""
        choose = self._random
        is_order = choose.random() < 0.05
        if is_order:
            to, key, payload, encoding = choose.choice(self._orders)
        else:
            key = choose.choice(self.keys)
            to = key[len(self._realm) + 1 :].partition("/")[0]
            payload, encoding = self._heard[key]
            if len(payload) > _LARGE and choose.random() > 0.05:
                return self.next()  # pictures would fill the link, and little else would be tried
        mutation = choose.choice(self._mutations)
        self.made[mutation.__name__.strip("_")] += 1
        self.sent[to] += 1
        payload, encoding = mutation(payload, encoding)
        return Sent(key, payload, encoding, is_order)

    # ---- mutations: each gets payload and encoding and returns them changed

    def _flip(self, payload: bytes, encoding: str | None) -> tuple[bytes, str | None]:
        changed = bytearray(payload)
        for _ in range(self._random.randint(1, 8)):
            changed[self._random.randrange(len(changed))] ^= 1 << self._random.randrange(8)
        return bytes(changed), encoding

    def _cut(self, payload: bytes, encoding: str | None) -> tuple[bytes, str | None]:
        return payload[: self._random.randrange(len(payload))], encoding

    def _odd(self, payload: bytes, encoding: str | None) -> tuple[bytes, str | None]:
        return self._with_field(payload, lambda value: self._random.choice(_ODD)), encoding

    def _absurd(self, payload: bytes, encoding: str | None) -> tuple[bytes, str | None]:
        return self._with_number(payload), encoding

    def _stamp(self, payload: bytes, encoding: str | None) -> tuple[bytes, str | None]:
        return _with(payload, stamp=self._random.choice(_STAMPS)), encoding

    def _leap(self, payload: bytes, encoding: str | None) -> tuple[bytes, str | None]:
        by = self._random.choice(_LEAPS) * self._random.choice((1.0, -1.0))
        fields = msgpack.unpackb(payload, strict_map_key=False)
        changed = {"stamp": fields["stamp"] + by}
        if self._random.random() < 0.5:  # a forger counts on, a replayer does not
            changed["seq"] = fields["seq"] + self._random.choice((1, 100, 2**40))
        return _with(payload, **changed), encoding

    def _writer(self, payload: bytes, encoding: str | None) -> tuple[bytes, str | None]:
        return _with(payload, epoch=self._random.choice((0, 1, *_HUGE))), encoding

    def _encoding(self, payload: bytes, encoding: str | None) -> tuple[bytes, str | None]:
        return payload, self._random.choice(_ENCODINGS)

    def _noise(self, payload: bytes, encoding: str | None) -> tuple[bytes, str | None]:
        return self._random.randbytes(self._random.choice((0, 1, 20, 200, 2000))), encoding

    def _replay(self, payload: bytes, encoding: str | None) -> tuple[bytes, str | None]:
        return payload, encoding

    # ---- within a message

    def _with_field(self, payload: bytes, change: Any) -> bytes:
        fields = msgpack.unpackb(payload, strict_map_key=False)
        name = self._random.choice(sorted(fields))
        return _with(payload, **{name: change(fields[name])})

    def _with_number(self, payload: bytes) -> bytes:
        """With another number in place of one, however deep it is."""
        fields = msgpack.unpackb(payload, strict_map_key=False)
        places: list[tuple[Any, Any]] = []
        _numbers(fields, places)
        holder, key = self._random.choice(places)
        is_whole = isinstance(holder[key], int)
        holder[key] = self._random.choice(_HUGE if is_whole and self._random.random() < 0.8 else _ABSURD)
        packed: bytes = msgpack.packb(fields)
        return packed


def example(kind: type[Message]) -> bytes:
    """Some message of a kind, made of its declaration.

    Args:
        kind: which.
    """
    info: Any = msgspec.inspect.type_info(kind)
    fields = {field.name: _value(field.type) for field in info.fields}
    packed: bytes = msgpack.packb({**fields, "stamp": 1.7e9, "seq": 1, "epoch": 1})
    return packed


def _value(kind: Any) -> Any:
    match kind:
        case msgspec.inspect.LiteralType():
            return kind.values[0]
        case msgspec.inspect.UnionType():
            return _value(kind.types[0])
        case msgspec.inspect.StructType():
            return {field.name: _value(field.type) for field in kind.fields}
        case msgspec.inspect.TupleType():
            return [_value(item) for item in kind.item_types]
        case msgspec.inspect.VarTupleType() | msgspec.inspect.ListType():
            return [_value(kind.item_type)] * (kind.min_length or 1)
        case msgspec.inspect.DictType():
            return {}
    plain = {"FloatType": 1.0, "IntType": 1, "StrType": "r1", "BoolType": False, "BytesType": b"1", "NoneType": None}
    return plain.get(type(kind).__name__)


def _with(payload: bytes, **changed: Any) -> bytes:
    packed: bytes = msgpack.packb({**msgpack.unpackb(payload, strict_map_key=False), **changed})
    return packed


def _numbers(value: Any, places: list[tuple[Any, Any]]) -> None:
    for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
        if isinstance(inner, dict | list):
            _numbers(inner, places)
        elif isinstance(inner, int | float) and not isinstance(inner, bool):
            places.append((value, key))
