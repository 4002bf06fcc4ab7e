"""How much faster than real time a fleet runs in virtual time: real agents and bases, a base station, the whole codec.

Pursuit on the in-memory network, on one core, without the separation filter and with it. Start-up is not counted. The
spacing error at the end shows that it was the real thing.

    python benchmarks/virtual_time.py [--robots 10] [--seconds 30] [--json FILE]
"""

from __future__ import annotations

import argparse
import asyncio
import json
import time
from pathlib import Path
from typing import Any

from muro_zenoh.checking.fleet import VirtualFleet
from muro_zenoh.config import Scenario, parse_scenario
from muro_zenoh.control import ring
from muro_zenoh.runtime.virtual_time import run_virtually

GOAL = 20.0


def scenario(robots: int, separation: bool) -> Scenario:
    """Robots in pursuit."""
    table = {"robots": robots, "behaviour": {"name": "pursuit"}, "separation": {"enabled": separation}}
    return parse_scenario(table, "benchmark", name="benchmark")


async def measure(robots: int, seconds: float, separation: bool) -> dict[str, Any]:
    """One run: a row of the table."""
    async with VirtualFleet(scenario(robots, separation), seed=1) as fleet:
        await fleet.start()
        wall, processor = time.perf_counter(), time.process_time()
        await asyncio.sleep(seconds)
        wall, processor = time.perf_counter() - wall, time.process_time() - processor
        places = dict(enumerate(map(tuple, fleet.world.plant.pose[:, :2].tolist())))
        spacing_error = ring.spacing_error(ring.angles_round(places, fleet.scenario.circle))
        return {
            "robots": robots,
            "separation": separation,
            "seconds": seconds,
            "times_real_time": round(seconds / processor, 2),
            "processor_s": round(processor, 3),
            "wall_s": round(wall, 3),
            "spacing_error_rad": round(spacing_error, 5),
        }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=10, help="how many (default %(default)s)")
    parser.add_argument("--seconds", type=float, default=30.0, help="virtual length of a run (default %(default)s)")
    parser.add_argument("--repeats", type=int, default=3, help="runs, of which the quickest counts (default 3)")
    parser.add_argument("--json", type=Path, help="write the row to this file")
    arguments = parser.parse_args()
    # In turns, and the quickest counts: what else the machine does meanwhile befalls both.
    runs = [
        run_virtually(measure(arguments.robots, arguments.seconds, separation))
        for separation in (False, True) * arguments.repeats
    ]
    rows = [
        min((run for run in runs if run["separation"] is separation), key=lambda run: float(run["processor_s"]))
        for separation in (False, True)
    ]
    titles = f"{'robots':>6}{'filter':>8}{'virtual':>10}{'processor':>11}{'wall':>9}"
    print(f"{titles}{'times real time':>17}{'spacing error':>15}")
    for row in rows:
        print(
            f"{row['robots']:>6}{'on' if row['separation'] else 'off':>8}{row['seconds']:>8.0f} s"
            f"{row['processor_s']:>9.2f} s{row['wall_s']:>7.2f} s{row['times_real_time']:>17.1f}"
            f"{row['spacing_error_rad']:>11.4f} rad"
        )
    print(f"goal: a fleet of ten at least {GOAL:g} times real time, with the filter")
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(rows, indent=2) + "\n")


if __name__ == "__main__":
    main()
