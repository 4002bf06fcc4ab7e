"""Records made by hand, for what judges them."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from muro_zenoh.checking.record import PERIOD, Record
from muro_zenoh.checking.trace import HealthReport
from muro_zenoh.config import parse_scenario
from muro_zenoh.config.faults import KINDS, Fault


def fault(kind: str, target: str, at: float, duration: float, **numbers: Any) -> Fault:
    """A fault."""
    return KINDS[kind](target=target, at=at, duration=duration, **numbers)


def still(robots: int = 2, seconds: float = 10.0) -> Record:
    """A fleet that stands in a row, 1 m apart, with everything fresh."""
    scenario = parse_scenario({"robots": robots, "duration": seconds}, "lab.toml", name="lab")
    count = round(seconds / PERIOD) + 1
    time = np.arange(count) * PERIOD
    pose = np.zeros((count, robots, 3))
    pose[:, :, 0] = np.arange(robots) - 0.5 * (robots - 1)
    fresh = np.repeat(time[:, None], robots, axis=1)
    return Record(
        scenario=scenario,
        seed=1,
        time=time,
        pose=pose,
        twist=np.zeros((count, robots, 2)),
        command=np.zeros((count, robots, 2)),
        good_command=fresh.copy(),
        good_pose=fresh.copy(),
        good_snapshot=fresh.copy(),
        latched=np.zeros((count, robots), dtype=bool),
        reports=tuple(HealthReport(0.5, name) for name in scenario.robots),
    )


def driving(record: Record, robot: int, start: float, end: float, v: float = 0.2) -> Record:
    """The record with a robot driven along x, from one time to another, without any lag; what was is not changed."""
    record = dataclasses.replace(
        record, pose=record.pose.copy(), twist=record.twist.copy(), command=record.command.copy()
    )
    rows = (record.time > start) & (record.time <= end)
    record.twist[rows, robot, 0] = v
    record.command[rows, robot, 0] = v
    record.pose[:, robot, 0] += np.cumsum(np.where(rows, v * PERIOD, 0.0))
    return record


def aged(ages: np.ndarray, time: np.ndarray, robot: int, since: float) -> np.ndarray:
    """Times of information with nothing new for a robot since a time."""
    ages = ages.copy()
    ages[time > since, robot] = since
    return ages
