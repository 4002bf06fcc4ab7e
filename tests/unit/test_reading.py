"""Tables become dataclasses: nested ones lifted, one of several chosen by name, and errors that name the key."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import pytest

from muro_zenoh.config.origin import Origin
from muro_zenoh.config.reading import read_section
from muro_zenoh.config.schema import all_keys, check_schema, fields_of
from muro_zenoh.errors import ConfigError, ParameterError
from muro_zenoh.quantities import Count, Length, Number, Quantity, Speed, check_quantities


@dataclass(frozen=True, slots=True)
class Profile:
    v_min: Speed = 0.1
    v_max: Speed = 0.3

    def __post_init__(self) -> None:
        check_quantities(self)
        if self.v_min > self.v_max:
            raise ParameterError("v_min", got=f"{self.v_min:g}", expected=f"at most v_max, {self.v_max:g}")


@dataclass(frozen=True, slots=True)
class Field:
    NAME: ClassVar[str] = "vector_field"

    k_o: Annotated[float, Quantity("1/m", above=0.0)] = 15.0
    gain: Annotated[float, Quantity(above=0.0)] = 1.0


@dataclass(frozen=True, slots=True)
class Lqr:
    NAME: ClassVar[str] = "lqr"

    radial_size: Length = 0.03
    gain: Annotated[float, Quantity(above=0.0)] = 2.0


@dataclass(frozen=True, slots=True)
class Peaks:
    peaks: tuple[tuple[Number, ...], ...]
    floor: Annotated[float, Quantity(above=0.0)] = 0.05


@dataclass(frozen=True, slots=True)
class Parameters:
    profile: Profile = Profile(v_max=0.4)
    law: Field | Lqr = Lqr(radial_size=0.02)
    density: Peaks | None = None
    turning_radius: Length = 0.3
    fixes: Count = 3


@dataclass(frozen=True, slots=True)
class Outer:
    inner: Parameters
    name: str = "outer"


def read(kind: type[Any], **table: object) -> Any:
    return read_section(kind, table, Origin("lab.toml"), "behaviour")


def test_an_empty_table_is_the_default() -> None:
    assert read(Parameters) == Parameters()
    assert read(Outer) == Outer(Parameters())


def test_the_keys_of_nested_dataclasses_are_lifted() -> None:
    assert read(Parameters, v_min=0.2, turning_radius=1) == Parameters(Profile(0.2, 0.4), turning_radius=1.0)
    assert read(Outer, v_min=0.2, name="deep") == Outer(Parameters(Profile(0.2, 0.4)), "deep")


def test_missing_keys_have_the_outer_default() -> None:
    assert read(Parameters, gain=5.0).law == Lqr(0.02, 5.0)
    assert read(Parameters, law="lqr").law == Lqr(0.02)


def test_a_name_selects_a_choice() -> None:
    assert read(Parameters, law="vector_field", k_o=3).law == Field(3.0)
    assert read(Parameters, law="vector_field", gain=3.0).law == Field(gain=3.0)
    assert read(Outer, law="vector_field").inner.law == Field()


def test_an_optional_part_is_there_when_one_of_its_keys_is() -> None:
    assert read(Parameters).density is None
    assert read(Parameters, peaks=[[0, 1.5]]).density == Peaks(((0.0, 1.5),))


WRONG: list[tuple[type, dict[str, object], str]] = [
    (Parameters, {"v_min": -1}, "lab.toml: behaviour.v_min: got -1 (integer), expected a number above 0 [m/s]"),
    (
        Parameters,
        {"v_min": float("nan")},
        "lab.toml: behaviour.v_min: got nan (number), expected a number above 0 [m/s]",
    ),
    (Parameters, {"v_min": "slow"}, "lab.toml: behaviour.v_min: got 'slow' (text), expected a number above 0 [m/s]"),
    (Parameters, {"v_min": 0.5}, "lab.toml: behaviour.v_min: got 0.5, expected at most v_max, 0.4"),
    (Outer, {"v_min": 0.5}, "lab.toml: behaviour.v_min: got 0.5, expected at most v_max, 0.4"),
    (Parameters, {"fixes": 2.5}, "lab.toml: behaviour.fixes: got 2.5 (number), expected a whole number at least 0"),
    (Parameters, {"fixes": -1}, "lab.toml: behaviour.fixes: got -1 (integer), expected a whole number at least 0"),
    (
        Parameters,
        {"v_mim": 0.1},
        "lab.toml: behaviour.v_mim: got an unknown key, expected one of v_min, v_max, law, ",
    ),
    (Parameters, {"v_mim": 0.1}, "Did you mean v_min?"),
    (Parameters, {"profile": {}}, "lab.toml: behaviour.profile: got an unknown key"),
    (Parameters, {"law": "lqg"}, "lab.toml: behaviour.law: got 'lqg' (text), expected one of 'vector_field', 'lqr'"),
    (Parameters, {"law": "lqg"}, "Did you mean 'lqr'?"),
    (Parameters, {"law": 3}, "lab.toml: behaviour.law: got 3 (integer), expected one of 'vector_field', 'lqr'"),
    (
        Parameters,
        {"k_o": 3.0},
        'lab.toml: behaviour.k_o: got a key of law = "vector_field", which is not selected, expected one of v_min, '
        "v_max, law, radial_size, gain, peaks, floor, turning_radius, fixes. "
        'Set law = "vector_field", or remove k_o.',
    ),
    (
        Outer,
        {"law": "vector_field", "radial_size": 0.1},
        'lab.toml: behaviour.radial_size: got a key of law = "lqr", which is not selected',
    ),
    (Parameters, {"floor": 0.1}, "lab.toml: behaviour.peaks: got nothing, expected an array of an array of a number"),
    (Parameters, {"peaks": [[float("inf")]]}, "lab.toml: behaviour.peaks: got [[inf]] (array), expected an array of"),
]


@pytest.mark.parametrize(("kind", "table", "said"), WRONG, ids=[said[18:60] for _, _, said in WRONG])
def test_a_wrong_value_is_named(kind: type, table: dict[str, object], said: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(said)):
        read(kind, **table)


def test_a_default_may_be_given() -> None:
    found = read_section(Peaks, {"floor": 0.2}, Origin("lab.toml"), "density", Peaks(((1.0,),)))
    assert found == Peaks(((1.0,),), 0.2)


def test_the_element_of_an_array_is_where_the_array_is() -> None:
    origin = Origin("lab.toml")
    origin.note("behaviour.peaks", "--set ")
    assert origin.at("behaviour.peaks[1]") == "--set behaviour.peaks[1]"
    assert origin.at("behaviour.floor") == "lab.toml: behaviour.floor"


def test_an_error_keeps_its_parts() -> None:
    with pytest.raises(ConfigError) as caught:
        read(Parameters, v_min=0.5)
    assert caught.value.what == "lab.toml: behaviour.v_min"
    assert (caught.value.got, caught.value.expected) == ("0.5", "at most v_max, 0.4")


def test_all_keys_are_known_with_the_choice_that_they_depend_on() -> None:
    keys = all_keys(Parameters)
    assert " ".join(keys) == "v_min v_max law k_o gain radial_size peaks floor turning_radius fixes"
    assert keys["v_min"] is None
    assert keys["k_o"] == ("law", "vector_field")


# ---- what would be a mistake in a program


@dataclass(frozen=True, slots=True)
class Twice:
    profile: Profile = Profile()
    v_min: Speed = 0.2


@dataclass(frozen=True, slots=True)
class TwoChoices:
    law: Field | Lqr = Lqr()
    other: Field | Lqr = Lqr()


@dataclass(frozen=True, slots=True)
class NamedLikeAKey:
    gain: Field | Lqr = Lqr()


@dataclass(frozen=True, slots=True)
class Deep:
    twice: Twice = Twice()


@dataclass(frozen=True, slots=True)
class Nameless:
    law: Field | Profile = Field()


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        (Twice, "Twice: the fields 'profile' and 'v_min' both have the key 'v_min'"),
        (TwoChoices, "TwoChoices: the fields 'law' and 'other' both have the key 'gain'"),
        (NamedLikeAKey, "NamedLikeAKey: the fields 'gain' and 'gain' both have the key 'gain'"),
        (Deep, "Twice: the fields 'profile' and 'v_min' both have the key 'v_min'"),
        (Nameless, "Nameless.law: each option of a choice needs a NAME of its own"),
        (int, "int: expected a dataclass or a Struct"),
    ],
)
def test_a_schema_with_an_ambiguous_key_is_refused(kind: type, said: str) -> None:
    with pytest.raises(TypeError, match=re.escape(said)):
        check_schema(kind)
    with pytest.raises(TypeError, match=re.escape(said)):
        read(kind)


def test_a_field_without_a_default_must_be_given() -> None:
    assert [field.name for field in fields_of(Outer)] == ["inner", "name"]
    with pytest.raises(ConfigError, match="peaks: got nothing"):
        read(Peaks)
