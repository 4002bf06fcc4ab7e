"""A kept state to test: its scenario, and what agents report to it."""

from __future__ import annotations

from pathlib import Path

from basestation.fleet.state_store import StateStore
from muro_zenoh.config import Scenario, parse_scenario
from muro_zenoh.messages import Health


def scenario(robots: int = 3, **behaviour: object) -> Scenario:
    """A scenario for robots that pursue each other."""
    table = {"robots": robots, "behaviour": {"name": "pursuit", "cruise": 0.15, **behaviour}}
    return parse_scenario(table, "lab.toml", name="lab")


def fresh(path: Path | None = None, robots: int = 3) -> StateStore:
    """The kept state of such a scenario; without a path it has no file."""
    return StateStore(scenario(robots), path)


def files_in(folder: Path) -> list[str]:
    """The names of the files in a folder."""
    return sorted(path.name for path in folder.iterdir())


def stopped(kept: StateStore) -> tuple[bool, tuple[str, ...]]:
    """Whether all robots are stopped, and which by name."""
    return kept.stop.all, kept.stop.names


def reports(latched: bool, revision: int, everybody: bool = False) -> Health:
    """An agent's health, as far as stops are concerned."""
    return Health(role="agent", state="x", stop_latched=latched, stop_all=everybody, stop_revision=revision)
