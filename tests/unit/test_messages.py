"""The codec: messages are the same after a round trip, from any writer; anything else raises MessageError."""

from __future__ import annotations

import contextlib
import math
from typing import Any

import msgpack
import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from muro_zenoh import messages
from muro_zenoh.channels import CHANNELS, VERBS
from muro_zenoh.errors import MessageError
from muro_zenoh.messages import (
    MOST_NAMES,
    Behaviour,
    Circle,
    FleetSnapshot,
    Goal,
    Health,
    LeaseState,
    Message,
    PoseFix,
    Reply,
    Resume,
    RobotState,
    SetBehaviour,
    SetCircle,
    SpeedReference,
    Stop,
    StopOrder,
    TakeLease,
    VelocityCommand,
    check_encoding,
    decode,
    encode,
    encoding_of,
)

KINDS = sorted({*(c.kind for c in CHANNELS), *(v.kind for v in VERBS), Reply}, key=lambda kind: kind.__name__)

finite = st.floats(-1e9, 1e9)
names = st.from_regex(r"[a-z][a-z0-9_]{0,31}", fullmatch=True)
covariances = st.tuples(*[finite] * 9)
values = st.one_of(
    st.booleans(), st.integers(-(2**40), 2**40), finite, st.text(max_size=8), st.lists(finite, max_size=3).map(tuple)
)
robots = st.builds(
    RobotState,
    name=names,
    x=finite,
    y=finite,
    theta=finite,
    v=finite,
    omega=finite,
    age=finite,
    state=st.sampled_from(["tracking", "silent", "disagrees", "stale", "lost"]),
)
SPECIAL: dict[str, st.SearchStrategy[Any]] = {
    "name": names,
    "names": st.lists(names, max_size=3).map(tuple),
    "stop_names": st.lists(names, max_size=3).map(tuple),
    "covariance": covariances,
    "robots": st.lists(robots, max_size=3).map(tuple),
    "parameters": st.dictionaries(st.text(max_size=8), values, max_size=3),
    "numbers": st.dictionaries(st.text(max_size=8), finite, max_size=3),
    "samples": st.dictionaries(st.text(max_size=8), st.lists(finite, max_size=3).map(tuple), max_size=3),
}


def messages_of(kind: type[Message]) -> st.SearchStrategy[Message]:
    """Any message of a kind, from the types of its fields."""
    fields: dict[str, st.SearchStrategy[Any]] = {}
    for field in msgspec.structs.fields(kind):
        fields[field.name] = strategy_of(field)
    fields["stamp"] = st.floats(1.0, 1e10)
    return st.builds(kind, **fields)


def strategy_of(field: msgspec.structs.FieldInfo) -> st.SearchStrategy[Any]:
    special = SPECIAL.get(field.name)
    return special if special is not None else _from_info(msgspec.inspect.type_info(field.type))


def _from_info(info: msgspec.inspect.Type) -> st.SearchStrategy[Any]:
    match info:
        case msgspec.inspect.FloatType(ge=ge, gt=gt):
            return st.floats(ge if ge is not None else 1e-3 if gt is not None else -1e9, 1e9)
        case msgspec.inspect.IntType(ge=ge, gt=gt, le=le):
            low = ge if ge is not None else gt + 1 if gt is not None else -(2**40)
            return st.integers(low, le if le is not None else 2**48)
        case msgspec.inspect.BoolType():
            return st.booleans()
        case msgspec.inspect.StrType():
            return st.text(max_size=16)
        case msgspec.inspect.BytesType():
            return st.binary(max_size=64)
        case msgspec.inspect.NoneType():
            return st.none()
        case msgspec.inspect.LiteralType(values=literals):
            return st.sampled_from(literals)
        case msgspec.inspect.UnionType(types=types):
            return st.one_of(*map(_from_info, types))
        case msgspec.inspect.VarTupleType(item_type=item, min_length=least, max_length=most):
            return st.lists(_from_info(item), min_size=least or 0, max_size=most or max(4, least or 0)).map(tuple)
        case msgspec.inspect.TupleType(item_types=items):
            return st.tuples(*map(_from_info, items))
        case msgspec.inspect.DictType(value_type=value):
            return st.dictionaries(st.text(max_size=8), _from_info(value), max_size=3)
        case msgspec.inspect.StructType(cls=cls):
            return st.builds(cls, **{field.name: strategy_of(field) for field in msgspec.structs.fields(cls)})
    raise NotImplementedError(f"no strategy for {info}: teach this test the new type")


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
@settings(max_examples=20)
@given(data=st.data())
def test_a_message_comes_back_as_it_was(kind: type[Message], data: st.DataObject) -> None:
    message = data.draw(messages_of(kind))
    assert decode(encode(message), kind) == message


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
@settings(max_examples=20)
@given(data=st.data())
def test_any_messagepack_library_can_join_in(kind: type[Message], data: st.DataObject) -> None:
    message = data.draw(messages_of(kind))
    plain = msgpack.unpackb(encode(message))
    assert set(plain) == set(kind.__struct_fields__)
    assert decode(msgpack.packb(plain), kind) == message


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
@settings(max_examples=20)
@given(data=st.data())
def test_a_number_that_is_not_finite_is_refused_wherever_it_is(kind: type[Message], data: st.DataObject) -> None:
    plain = msgpack.unpackb(encode(data.draw(messages_of(kind))))
    places = list(_floats(plain))
    path = data.draw(st.sampled_from(places))
    _put(plain, path, data.draw(st.sampled_from([math.nan, math.inf, -math.inf])))
    with pytest.raises(MessageError, match=kind.__name__):
        decode(msgpack.packb(plain), kind)


def _floats(value: Any, path: tuple[Any, ...] = ()) -> Any:
    if isinstance(value, float):
        yield path
    elif isinstance(value, dict | list):
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _floats(item, (*path, key))


def _put(value: Any, path: tuple[Any, ...], new: float) -> None:
    for step in path[:-1]:
        value = value[step]
    value[path[-1]] = new


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
@settings(max_examples=20)
@given(noise=st.binary(max_size=256))
def test_noise_is_a_message_error_or_a_message(kind: type[Message], noise: bytes) -> None:
    with contextlib.suppress(MessageError):
        assert isinstance(decode(noise, kind), kind)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
@settings(max_examples=20)
@given(data=st.data())
def test_a_damaged_message_is_a_message_error_or_a_message(kind: type[Message], data: st.DataObject) -> None:
    good = bytearray(encode(data.draw(messages_of(kind))))
    for _ in range(data.draw(st.integers(1, 4))):
        good[data.draw(st.integers(0, len(good) - 1))] = data.draw(st.integers(0, 255))
    try:
        message = decode(bytes(good), kind)
    except MessageError:
        return
    assert decode(encode(message), kind) == message


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"colour": 1}, "unknown field `colour`"),
        ({"v": "fast"}, r"Expected `float`, got `str` - at `\$.v`"),
        ({"v": True}, r"Expected `float`, got `bool`"),
        ({"v": None}, r"Expected `float`, got `None`"),
        ({"v": math.nan}, "v: got nan, expected a finite number"),
        ({"omega": math.inf}, "omega: got inf"),
        ({"stamp": 0.0}, "got stamp 0.0, expected seconds since 1970"),
        ({"stamp": -5.0}, "got stamp -5.0"),
        ({"seq": -1}, "Expected `int` >= 0"),
        ({"seq": 1.5}, "Expected `int`"),
        ({"epoch": "me"}, "Expected `int`"),
    ],
)
def test_the_error_says_what_is_wrong(change: dict[str, Any], said: str) -> None:
    plain = {"stamp": 1.7e9, "seq": 1, "epoch": 2, "v": 0.1, "omega": 0.0, **change}
    with pytest.raises(MessageError, match=f"VelocityCommand: .*{said}"):
        decode(msgpack.packb(plain), VelocityCommand)


@pytest.mark.parametrize("field", ["v", "omega"])
def test_a_missing_field_is_named(field: str) -> None:
    plain = {"stamp": 1.7e9, "v": 0.1, "omega": 0.0}
    del plain[field]
    with pytest.raises(MessageError, match=f"missing required field `{field}`"):
        decode(msgpack.packb(plain), VelocityCommand)


def test_whole_numbers_are_numbers() -> None:
    message = decode(msgpack.packb({"stamp": 1_700_000_000, "v": 1, "omega": 0}), VelocityCommand)
    assert (message.v, type(message.v)) == (1.0, float)


def test_a_goal_may_have_no_heading() -> None:
    assert decode(msgpack.packb({"stamp": 1.7e9, "x": 0.0, "y": 0.0, "theta": None}), Goal).theta is None
    assert decode(msgpack.packb({"stamp": 1.7e9, "x": 0.0, "y": 0.0}), Goal).theta is None


@pytest.mark.parametrize("length", [0, 8, 10])
def test_a_covariance_has_nine_numbers(length: int) -> None:
    plain = {"stamp": 1.7e9, "x": 0.0, "y": 0.0, "theta": 0.0, "camera": "north", "covariance": [0.0] * length}
    with pytest.raises(MessageError, match="covariance"):
        decode(msgpack.packb(plain), PoseFix)


def test_numbers_are_taken_up_to_what_can_be_calculated_with() -> None:
    message = VelocityCommand(stamp=1.7e9, v=0.7e12, omega=-0.7e12)
    assert decode(encode(message), VelocityCommand) == message


@pytest.mark.parametrize("absurd", [1.1e12, -1.1e12, 1e154, -1.7e308])
def test_absurd_numbers_are_refused_wherever_they_are(absurd: float) -> None:
    # The square of 1e154 overflows, and an OverflowError in a law ends the agent.
    def refused(kind: type[Message], match: str, **fields: object) -> None:
        with pytest.raises(MessageError, match=match):
            decode(msgspec.msgpack.encode({"stamp": 1.7e9, **fields}), kind)

    fix = {"age": 0.1, "x": 1.0, "y": 1.0, "theta": 0.0, "camera": "north"}
    refused(VelocityCommand, "omega: got", v=0.1, omega=absurd)
    refused(PoseFix, "covariance: got", covariance=[absurd] * 9, **fix)
    refused(Goal, "theta: got", x=0.0, y=0.0, theta=absurd)
    refused(Health, r"numbers\.fixes: got", role="agent", state="driving", numbers={"fixes": absurd})
    robot = {"name": "r1", "x": 0.0, "y": absurd, "theta": 0.0, "v": 0.0, "omega": 0.0, "age": 0.0, "state": "lost"}
    refused(FleetSnapshot, r"robots\.r1\.y: got", robots=[robot])


@pytest.mark.parametrize("stamp", [1.1e11, 1e12, 1e300, 0.0, -1.7e9])
def test_a_stamp_that_is_no_time_is_refused(stamp: float) -> None:
    with pytest.raises(MessageError, match="stamp"):
        decode(msgspec.msgpack.encode({"stamp": stamp, "speed": 0.1}), SpeedReference)


def test_a_law_that_makes_nan_is_found_where_it_does() -> None:
    with pytest.raises(ValueError, match="v: got nan"):
        VelocityCommand(v=math.nan, omega=0.0)
    with pytest.raises(ValueError, match=r"samples\.pose_age_s: got inf"):
        Health(role="agent", state="driving", samples={"pose_age_s": (0.1, math.inf)})
    with pytest.raises(ValueError, match=r"parameters\.weights: got nan"):
        Behaviour(behaviour="pursuit", parameters={"weights": ((1.0, math.nan),)})
    with pytest.raises(ValueError, match=r"robots\.r1\.theta: got nan"):
        FleetSnapshot(robots=(RobotState("r1", 0.0, 0.0, math.nan, 0.0, 0.0, 0.0, "tracking"),))
    with pytest.raises(ValueError, match="name: got 'R 1'"):
        FleetSnapshot(robots=(RobotState("R 1", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, "tracking"),))


def test_a_snapshot_names_the_state_that_it_does_not_know() -> None:
    robot = {"name": "r1", "x": 0.0, "y": 0.0, "theta": 0.0, "v": 0.0, "omega": 0.0, "age": 0.0, "state": "asleep"}
    with pytest.raises(MessageError, match=r"asleep.*robots\[0\]|robots\[...\].state"):
        decode(msgpack.packb({"stamp": 1.7e9, "robots": [robot]}), FleetSnapshot)


@pytest.mark.parametrize("said", [None, "", "zenoh/bytes", "application/octet-stream", "application/msgpack"])
def test_without_an_encoding_the_first_version_is_assumed(said: str | None) -> None:
    check_encoding(said, SpeedReference)


def test_the_encoding_has_name_and_version() -> None:
    assert encoding_of(SpeedReference) == "application/msgpack;SpeedReference.1"
    check_encoding("application/msgpack;SpeedReference.1", SpeedReference)


@pytest.mark.parametrize(
    "said", ["application/msgpack;SpeedReference.2", "application/msgpack;Goal.1", "application/json", "nonsense"]
)
def test_another_encoding_is_refused_with_what_was_expected(said: str) -> None:
    with pytest.raises(MessageError, match=f"got encoding '{said}', expected 'application/msgpack;SpeedReference.1'"):
        check_encoding(said, SpeedReference)


def test_the_version_is_the_first() -> None:
    assert messages.VERSION == 1


@pytest.mark.parametrize("kind", [Circle, SetCircle])
def test_a_circle_of_which_no_law_can_follow_the_arc_is_refused(kind: type[Circle | SetCircle]) -> None:
    # What passes here must pass as a circle too: an agent makes one of each message that arrives.
    assert decode(encode(kind(stamp=1.0, x=0.0, y=0.0, radius=0.001)), kind).radius == 0.001
    for radius in (0.000999, 5e-324, 0.0, -1.0):
        with pytest.raises(MessageError, match=r"0\.001"):
            decode(encode(kind(stamp=1.0, x=0.0, y=0.0, radius=radius)), kind)
    assert Circle(x=0.0, y=0.0, radius=0.001).circle.radius == 0.001


@pytest.mark.parametrize("kind", [StopOrder, Health, Stop, Resume, SetBehaviour, TakeLease, LeaseState])
def test_lists_of_names_and_of_leases_are_bounded(kind: type[Message]) -> None:
    """A stranger must not fill the memory with them."""
    rest: dict[type[Message], dict[str, Any]] = {
        StopOrder: {"all": False},
        Health: {"role": "agent", "state": "x"},
        Resume: {"revision": 1},
        SetBehaviour: {"behaviour": "hold"},
        TakeLease: {"program": "x", "operator": "y"},
    }
    lease = {"program": "x", "operator": "y", "epoch": 1, "since": 0.0}
    field, item = {Health: ("stop_names", "r1"), LeaseState: ("leases", lease)}.get(kind, ("names", "r1"))
    for count, good in ((MOST_NAMES, True), (MOST_NAMES + 1, False)):
        payload = msgspec.msgpack.encode({"stamp": 1.0, **rest.get(kind, {}), field: [item] * count})
        if good:
            assert len(getattr(decode(payload, kind), field)) == count
        else:
            with pytest.raises(MessageError):
                decode(payload, kind)
