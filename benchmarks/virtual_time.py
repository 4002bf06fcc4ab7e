"""How much faster than real time a fleet runs in virtual time: real agents and bases, a base station, the whole codec.

Pursuit on the in-memory network, on one core. Start-up is not counted. The spacing error at the end shows that it was
the real thing.

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


def scenario(robots: int) -> Scenario:
    """Robots in pursuit."""
    return parse_scenario({"robots": robots, "behaviour": {"name": "pursuit"}}, "benchmark", name="benchmark")


async def measure(robots: int, seconds: float) -> dict[str, Any]:
    """One run: a row of the table."""
    async with VirtualFleet(scenario(robots), seed=1) as fleet:
        await fleet.start()
        wall, processor = time.perf_counter(), time.process_time()
        await asyncio.sleep(seconds)
        wall, processor = time.perf_counter() - wall, time.process_time() - processor
        places = dict(enumerate(map(tuple, fleet.world.plant.pose[:, :2].tolist())))
        spacing_error = ring.spacing_error(ring.angles_round(places, fleet.scenario.circle))
        return {
            "robots": robots,
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
    runs = [run_virtually(measure(arguments.robots, arguments.seconds)) for _ in range(arguments.repeats)]
    row = min(runs, key=lambda run: float(run["processor_s"]))
    print(f"{'robots':>6}{'virtual':>10}{'processor':>11}{'wall':>9}{'times real time':>17}{'spacing error':>15}")
    print(
        f"{row['robots']:>6}{row['seconds']:>8.0f} s{row['processor_s']:>9.2f} s{row['wall_s']:>7.2f} s"
        f"{row['times_real_time']:>17.1f}{row['spacing_error_rad']:>11.4f} rad"
    )
    print(f"goal: a fleet of ten at least {GOAL:g} times real time")
    if arguments.json is not None:
        arguments.json.write_text(json.dumps([row], indent=2) + "\n")


if __name__ == "__main__":
    main()
