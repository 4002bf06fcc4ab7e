"""Random trials: a fleet, its starts, behaviours and orders, and faults, all drawn from one seed.

The first fault of trial k is that of cell k of the coverage table (in a fixed random order), begun while its robots are
in that cell's state, so as many trials as there are cells meet every cell; the second one is any.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

from muro_zenoh.checking.coverage import CELLS, ROLES, Activity
from muro_zenoh.config import Scenario, as_table, parse_scenario
from muro_zenoh.config.faults import KINDS, Place

ROBOTS: Final = 10
DURATION: Final = 30.0
"""Of a random trial [s]."""

_NAMES: Final = tuple(f"r{number}" for number in range(1, ROBOTS + 1))
_CAMERA = "north"
_STARTING = 0.6
"""Most robots drive after this time [s]."""

_ROOM = 0.45
"""Two last goals are further apart than this [m]."""

_SETTLE = 1.2
"""An order is obeyed by all robots after this time [s], if nothing is wrong."""

_LONGEST_HOLD: Final = 2.0
"""Robots that are to hold when a fault begins are ordered to drive again after this time at most [s]: jammed wheels do
nothing before."""

_ORDER: Final = np.random.default_rng(8).permutation(len(CELLS))

Row = dict[str, Any]


def random_trial(seed: int) -> Scenario:
    """A trial of ten robots.

    Args:
        seed: of everything in it.
    """
    draw = _Draw(seed)
    robots = list(_NAMES)
    cell = CELLS[_ORDER[seed % len(CELLS)]]
    begin = draw.begin(cell.activity)
    first = draw.fault(cell.kind, draw.choice(_places(cell.kind, cell.role)), robots, [_CAMERA], begin)
    common = draw.behaviour([])
    own = [draw.behaviour([name]) for name in robots] if draw.chance(0.2) else []
    orders = [
        *own,
        *draw.state(cell.activity, begin, first, [common, *own]),
        *draw.change(robots, cell.activity, begin),
    ]
    circle = {"radius": draw.uniform(0.8, 1.1), "clockwise": draw.chance(0.5)}
    goals, second = draw.goals(robots), draw.any_fault(robots, [_CAMERA])
    if first["target"] in ("basestation", "router") and cell.activity is Activity.DRIVING:
        # A stop that the base station hears late, or not: what it says meanwhile must not lift it.
        orders += draw.stop_during(first, [])
    if second["target"] == "basestation":
        # It learns of a stop of one robot only by that order and by that robot's health.
        orders += draw.stop_during(second, [draw.choice(robots)])
    table: Row = {
        "description": f"random trial {seed}",
        "robots": ROBOTS,
        "duration": DURATION,
        "camera": {_CAMERA: {}},
        "circle": circle,
        "behaviour": {"name": common["behaviour"], **common["parameters"]},
        "goals": goals,
        "fault": [first, second],
        "order": sorted(orders, key=lambda row: float(row["at"])),
    }
    return parse_scenario(table, "random", name="random")


def faulty(scenario: Scenario, faults: int, seed: int) -> Scenario:
    """A scenario with random faults.

    Args:
        scenario: the scenario.
        faults: number of faults.
        seed: of the faults.
    """
    draw, share = _Draw(seed), min(1.0, scenario.duration / DURATION)
    rows = [draw.any_fault(list(scenario.robots), list(scenario.camera)) for _ in range(faults)]
    rows = [{**row, "at": round(share * row["at"], 3)} for row in rows]  # else a short trial would end before
    return parse_scenario({**as_table(scenario), "fault": rows}, scenario.name, name=scenario.name)


def _places(kind: str, role: str) -> list[Place]:
    return [place for place in KINDS[kind].places if ROLES[place] == role]


def _stop_for(at: float, lasts: float, robots: list[str]) -> list[Row]:
    """A stop and its resume, which is given again in case that nobody answered."""
    return [
        {"at": round(at, 3), "kind": "stop", "robots": robots},
        {"at": round(at + lasts, 3), "kind": "resume", "robots": robots},
        {"at": round(at + lasts + 3.0, 3), "kind": "resume", "robots": robots},
    ]


class _Draw:
    """Draws the parts of one trial."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng((seed, 6))

    def uniform(self, low: float, high: float) -> float:
        return round(float(self._rng.uniform(low, high)), 3)

    def chance(self, share: float) -> bool:
        return bool(self._rng.random() < share)

    def choice(self, options: Any) -> Any:
        return options[int(self._rng.integers(len(options)))]

    def signed(self, low: float, high: float) -> float:
        return self.uniform(low, high) * (1.0 if self.chance(0.5) else -1.0)

    def goals(self, robots: list[str]) -> dict[str, list[list[float]]]:
        """Of each robot; there is room for all of them at their last ones."""
        goals = {name: [self._place() for _ in range(7)] for name in robots}
        last: list[list[float]] = []
        while len(last) < len(robots):
            place = self._place()
            if all(math.dist(place, other) > _ROOM for other in last):
                last.append(place)
        return {name: [*goals[name], place] for name, place in zip(robots, last, strict=True)}

    def _place(self) -> list[float]:
        return [self.uniform(-1.75, 1.75), self.uniform(-1.15, 1.15)]

    # ---- behaviours and orders

    def change(self, robots: list[str], activity: Activity, begin: float) -> list[Row]:
        """The change of behaviour, of all robots or half of them; and sometimes a stop that is lifted again. Neither
        takes the robots of the first fault out of the state in which it is to find them."""
        some = list(self._rng.permutation(robots)[: len(robots) // 2]) if self.chance(0.3) else []
        at, stops = self.uniform(8.0, 20.0), self.uniform(4.0, 24.0)
        if activity is Activity.HOLDING and begin - _SETTLE <= at <= begin:
            at = round(begin + _LONGEST_HOLD, 3)
        rows = [self.behaviour([str(name) for name in some], at)]
        one = [str(self.choice(robots))] if self.chance(0.5) else []
        if self.chance(0.25) and activity in (Activity.STARTING, Activity.DRIVING):
            rows += self.stop(max(stops, round(begin + _SETTLE, 3)), one)
        return rows

    def stop_during(self, fault: Row, robots: list[str]) -> list[Row]:
        """A stop in the midst of a fault, and its resume."""
        return self.stop(round(fault["at"] + self.uniform(0.0, 0.7) * fault["duration"], 3), robots)

    def stop(self, at: float, robots: list[str], least: float = 1.5) -> list[Row]:
        """A stop and its resume; often one of another robot's within it, whose resume must not lift this one."""
        lasts = self.uniform(least, 4.0)
        rows = _stop_for(at, lasts, robots)
        if robots and self.chance(0.5):
            other = self.choice([name for name in _NAMES if name not in robots])
            rows += _stop_for(at + 0.1 * lasts, self.uniform(0.3, 0.5) * lasts, [other])
        return rows

    def behaviour(self, robots: list[str], at: float = 0.0) -> Row:
        """An order of a behaviour that drives."""
        name = self.choice(list(_BEHAVIOURS))
        return {"at": at, "behaviour": name, "robots": robots, "parameters": _BEHAVIOURS[name](self)}

    # ---- faults

    def begin(self, activity: Activity) -> float:
        """When a fault begins, for the robots to be in a state."""
        return self.uniform(0.0, _STARTING) if activity is Activity.STARTING else self.uniform(4.0, 18.0)

    def state(self, activity: Activity, begin: float, fault: Row, before: list[Row]) -> list[Row]:
        """The orders that bring the robots of a fault into a state."""
        robot = str(fault["target"]).partition("/")[0]
        robots = [] if robot in ("basestation", "camera", "router") else [robot]
        if activity is Activity.STOPPED:
            return self.stop(begin - self.uniform(_SETTLE, 2.0), robots, least=2.2)
        if activity is Activity.HOLDING:
            hold = {"at": round(begin - _SETTLE, 3), "behaviour": "hold", "robots": robots}
            end = round(begin + self.uniform(0.5, _LONGEST_HOLD), 3)
            again = round(max(end, begin + fault["duration"]) + 0.5, 3)  # in case that the fault kept it out
            mine = [row for row in before if not (robots and row["robots"]) or row["robots"] == robots]
            back = [{**row, "at": at, "robots": robots or row["robots"]} for at in (end, again) for row in mine]
            return [hold, *back]
        return []

    def any_fault(self, robots: list[str], cameras: list[str]) -> Row:
        """A fault of any kind, at any time."""
        kind = self.choice(list(KINDS))
        return self.fault(kind, self.choice(KINDS[kind].places), robots, cameras, self.uniform(1.0, 22.0))

    def fault(self, kind: str, place: Place, robots: list[str], cameras: list[str], at: float) -> Row:
        """A fault of a kind."""
        robot, camera = self.choice(robots), self.choice(cameras)
        target = {
            Place.ROBOT: robot,
            Place.AGENT: f"{robot}/agent",
            Place.BASE: f"{robot}/base",
            Place.CAMERA: f"camera/{camera}",
        }.get(place, str(place))
        return {
            "kind": kind,
            "target": target,
            "at": at,
            "duration": self.uniform(_LONGEST_HOLD + _SETTLE if kind == "halt" else 0.4, 5.0),
            **(_NUMBERS[kind](self) if kind in _NUMBERS else {}),
        }

    def carried(self) -> Row:
        """By the half of the arena's height at most."""
        far, way = self.uniform(0.4, 1.2), self.uniform(-math.pi, math.pi)
        return {
            "x": round(far * math.cos(way), 3),
            "y": round(far * math.sin(way), 3),
            "theta": self.uniform(-math.pi, math.pi),
            "duration": self.uniform(0.3, 2.0),
        }

    def lie(self) -> Row:
        """An estimate that stays where it was, is shifted, or has a wrong speed."""
        if self.chance(0.3):
            return {"stuck": True}
        if self.chance(0.3):
            return {"v": self.signed(0.4, 1.0), "omega": self.signed(0.0, 1.0)}
        return {"x": self.signed(0.4, 1.5), "y": self.signed(0.0, 1.5), "theta": self.signed(0.0, 3.0)}

    def driver(self) -> Row:
        """Somebody else at the wheels. With a joystick he drives backwards, as no behaviour does: one who did what the
        robot does by itself would be noticed by nobody."""
        if self.chance(0.3):
            return {"v": -self.uniform(0.15, 0.3), "omega": self.signed(0.0, 1.0), "by": "wheels"}
        return {"v": self.signed(0.05, 0.3), "omega": self.signed(0.0, 1.0), "by": "bus"}


_BEHAVIOURS: Final[Mapping[str, Callable[[_Draw], Row]]] = {
    "circle": lambda draw: {"speed": draw.uniform(0.1, 0.35)},
    "pursuit": lambda draw: {"cruise": draw.uniform(0.1, 0.3)},
    "dubins": lambda draw: {"turning_radius": draw.uniform(0.15, 0.35), "pause": 0.2},
    "coverage": lambda draw: {"turning_radius": draw.uniform(0.1, 0.25), "hold_time": 0.2},
    "steer": lambda draw: {"speed": draw.uniform(0.15, 0.35), "pause": 0.2},
}
"""The built-in behaviours that drive, with their parameters."""

_NUMBERS: Final[Mapping[str, Callable[[_Draw], Row]]] = {
    "delay": lambda draw: {"delay": draw.uniform(0.05, 0.8)},
    "jitter": lambda draw: {"jitter": draw.uniform(0.05, 0.5)},
    "loss": lambda draw: {"fraction": draw.uniform(0.1, 0.9)},
    "duplicate": lambda draw: {"fraction": draw.uniform(0.2, 1.0), "delay": draw.uniform(0.02, 0.6)},
    "reorder": lambda draw: {"fraction": draw.uniform(0.1, 0.5), "delay": draw.uniform(0.05, 0.5)},
    "clock_offset": lambda draw: {"offset": draw.signed(0.05, 3.0), "drift": draw.signed(0.0, 0.005)},
    "clock_step": lambda draw: {"step": draw.signed(0.1, 5.0)},
    "carry": _Draw.carried,
    "lie": _Draw.lie,
    "foreign_driver": _Draw.driver,
}
"""The numbers of each kind of fault that has some besides its times."""
