"""Resident memory and speed over many flights of one scenario in one process.

    python benchmarks/bench_memory.py --flights 200 --camera projected
    python benchmarks/bench_memory.py --flights 50 --camera rendered
    python benchmarks/bench_memory.py --smoke    # a quick look that everything still runs

Flies `nominal_imu_uwb_yolo` by fly_many, files included, and prints a line of JSON: the memory after some of the
flights, and how much more there is after the last than after the tenth. A rendered flight is on a short path.
"""

import argparse
import json
import platform
import tempfile
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ortilo_drake.flight.ensemble import fly_many
from ortilo_drake.scenario import load_scenario

SHORT = "planner={kind: waypoints, points: [[0, 0, 1.5], [1.2, 0.6, 1.5]]}"
SETTLED = 10  # the flight after which memory is to stay what it is
PAGE = 4096 / 2**20  # [MiB]


def resident() -> float:
    """Return this process's resident memory [MiB]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE


def memory_of_flights(flights: int, camera: str) -> dict[str, Any]:
    """Return the memory after each of that many flights [MiB], and the flights per second after the first."""
    settings = (f"camera.kind={camera}", *((SHORT,) if camera == "rendered" else ()))
    after: list[float] = []
    ends: list[float] = []

    def note(_: dict[str, Any]) -> None:
        after.append(resident())
        ends.append(time.perf_counter())

    with tempfile.TemporaryDirectory() as folder:
        fly_many(load_scenario("nominal_imu_uwb_yolo", settings), range(flights), Path(folder), progress=note)
    shown = [n for n in (1, 2, SETTLED, 20, 50, 100, 150, 200, flights) if n <= flights]
    return {
        "drake": version("drake"),
        "python": platform.python_version(),
        "camera": camera,
        "resident_MiB": {n: round(after[n - 1], 1) for n in shown},
        "more_than_after_the_tenth_MiB": round(after[-1] - after[min(SETTLED, flights) - 1], 1),
        "flights_per_s": round((flights - 1) / (ends[-1] - ends[0]), 3) if flights > 1 else None,
    }


def main() -> None:
    """Print the figures as JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--flights", type=int, default=200)
    parser.add_argument("--camera", choices=("projected", "rendered"), default="projected")
    parser.add_argument("--smoke", action="store_true", help="three flights")
    arguments = parser.parse_args()
    print(json.dumps(memory_of_flights(3 if arguments.smoke else arguments.flights, arguments.camera)))


if __name__ == "__main__":
    main()
