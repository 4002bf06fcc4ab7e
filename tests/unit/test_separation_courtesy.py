"""Parked robots that make room."""

from __future__ import annotations

import math
from itertools import pairwise

from muro_zenoh.geometry import Bounds, State
from muro_zenoh.safety.separation.courtesy import Courtesy
from muro_zenoh.safety.separation.gates import Gate
from muro_zenoh.safety.separation.guidance import FIDGET, Near

INSIDE = Bounds(-2.1, 2.1, -1.5, 1.5).shrunk(0.197)


def times(
    courtesy: Courtesy,
    near: list[Near],
    start: float,
    seconds: float,
    target: tuple[float, float],
    away: tuple[float, float] | None = None,
) -> list[float]:
    """When a robot that stands where it wants to be, and while it makes room ``away`` from there, begins to [s]."""
    home, spot = State(*target, 0.0, 0.0, 0.0), State(*(away or target), 0.0, 0.0, 0.0)
    began, made_room = [], False
    for k in range(round(seconds / 0.05)):
        now = start + 0.05 * k
        makes_room = courtesy.look(now, spot if made_room else home, True, target, near, INSIDE) is not None
        if makes_room and not made_room:
            began.append(now)
        made_room = makes_room
    return began


def test_a_robot_makes_room_again_and_again_but_ever_less_often() -> None:
    waits = Near(0.5, 0.0, 0.0, 0.0, 0.4, "r2", math.pi, FIDGET)
    courtesy = Courtesy()
    began = times(courtesy, [waits], 0.0, 200.0, (0.0, 0.0))
    assert began[0] == 0.0
    assert len(began) > 4
    gaps = [after - before for before, after in pairwise(began)]
    assert all(after > before + 3.0 for before, after in pairwise(gaps))
    assert times(courtesy, [waits], 200.0, 12.0, (0.0, 0.0)) == [200.4], "and not for the next half minute"
    courtesy.look(212.0, State(0.0, 0.0, 0.0, 0.0, 0.0), False, (-0.02, 0.0), [], INSIDE)  # it drives elsewhere
    assert times(courtesy, [waits], 212.05, 1.0, (-0.02, 0.0)) == [212.05], "there it starts anew"


def test_a_robot_makes_room_for_nobody_right_after_it_did_even_when_that_one_has_gone() -> None:
    waits = Near(0.5, 0.0, 0.0, 0.0, 0.4, "r2", math.pi, FIDGET)
    courtesy = Courtesy()
    assert times(courtesy, [waits], 0.0, 0.1, (0.0, 0.0)) == [0.0]
    assert times(courtesy, [], 0.1, 5.0, (0.0, 0.0)) == [0.1]  # still
    assert times(courtesy, [waits._replace(name="r3")], 5.1, 2.0, (0.0, 0.0)) == []


def test_a_robot_that_is_parked_in_a_passage_makes_room_as_often_as_it_is_asked() -> None:
    waits = Near(0.5, 0.0, 0.0, 0.0, 0.4, "r2", math.pi, FIDGET)
    beside, within = (
        [after - before for before, after in pairwise(times(courtesy, [waits], 0.0, 60.0, (0.0, 0.0), (-0.3, 0.0)))]
        for courtesy in (Courtesy([Gate(x, 0.0, 1.0, 0.0, 0.4)]) for x in (1.0, 0.6))
    )
    assert max(within) < 8.0 < max(beside)
