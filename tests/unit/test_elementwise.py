"""A law spelled once: floats and arrays agree."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from muro_zenoh import arrays, elementwise
from muro_zenoh.arrays import ARRAYS
from muro_zenoh.elementwise import FLOATS

numbers = st.floats(-1e3, 1e3)
PUBLIC = {
    name
    for cls in (elementwise.Floats, arrays.Arrays)
    for name in vars(cls)
    if not name.startswith("_")
}  # fmt: skip


def test_both_spell_the_same_functions() -> None:
    for name in PUBLIC:
        assert callable(getattr(FLOATS, name)), name
        assert callable(getattr(ARRAYS, name)), name


def test_the_namespace_fits_the_value() -> None:
    assert elementwise.of(1.0) is FLOATS
    assert elementwise.of(np.float64(1.0)) is FLOATS
    assert elementwise.of(np.zeros(3)) is ARRAYS
    assert elementwise.of(np.zeros((2, 3))) is ARRAYS


ONE = {
    "sin": numbers,
    "cos": numbers,
    "tan": st.floats(-1.5, 1.5),
    "atan": numbers,
    "sinc": numbers,
    "sqrt": st.floats(0.0, 1e3),
    "exp": st.floats(-50.0, 50.0),
    "log": st.floats(1e-3, 1e3),
    "floor": numbers,
    "wrap": numbers,
}
TWO = ("atan2", "hypot", "copysign", "minimum", "maximum")


@pytest.mark.parametrize("name", ONE)
@given(data=st.data())
def test_functions_of_one_number_agree(name: str, data: st.DataObject) -> None:
    value = data.draw(ONE[name])
    one = getattr(FLOATS, name)(value)
    many = getattr(ARRAYS, name)(np.array([value, value]))
    assert many.shape == (2,)
    assert many[0] == pytest.approx(one, rel=1e-12, abs=1e-9)


@pytest.mark.parametrize("name", TWO)
@given(a=numbers, b=numbers)
def test_functions_of_two_numbers_agree(name: str, a: float, b: float) -> None:
    one = getattr(FLOATS, name)(a, b)
    many = getattr(ARRAYS, name)(np.array([a]), np.array([b]))
    assert many[0] == pytest.approx(one, rel=1e-12)


@given(angle=numbers)
def test_sine_and_cosine_come_together(angle: float) -> None:
    one = FLOATS.sincos(angle)
    many = ARRAYS.sincos(np.array([angle]))
    assert [float(part[0]) for part in many] == pytest.approx(one, abs=1e-9)
    assert one == (math.sin(angle), math.cos(angle))


@given(value=numbers, low=numbers, width=st.floats(0.0, 10.0))
def test_clipping_agrees(value: float, low: float, width: float) -> None:
    clipped = FLOATS.clip(value, low, low + width)
    assert low <= clipped <= low + width
    assert ARRAYS.clip(np.array([value]), low, low + width)[0] == clipped


@given(condition=st.booleans(), a=numbers, b=numbers)
def test_choosing_agrees(condition: bool, a: float, b: float) -> None:
    assert FLOATS.where(condition, a, b) == ARRAYS.where(np.array([condition]), a, b)[0]


@pytest.mark.parametrize("angle", [math.pi, -math.pi, 3 * math.pi, 0.0, -1e-300, 7.0])
def test_half_a_turn_wraps_alike(angle: float) -> None:
    wrapped = float(ARRAYS.wrap(np.array([angle]))[0])
    assert -math.pi < wrapped <= math.pi
    assert wrapped == pytest.approx(FLOATS.wrap(angle))


def test_every_function_is_tested_here() -> None:
    assert {*ONE, *TWO, "sincos", "clip", "where"} >= PUBLIC


def test_plain_floats_stay_plain() -> None:
    results: list[Any] = [getattr(FLOATS, name)(0.5) for name in ONE if name != "floor"]
    results += [getattr(FLOATS, name)(0.5, 0.25) for name in TWO]
    assert all(type(result) is float for result in results)
