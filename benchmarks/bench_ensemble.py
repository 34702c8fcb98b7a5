"""The speed of the ensemble engine: simulated seconds per second of wall time, by scenario.

    python benchmarks/bench_ensemble.py --json F    # the figures of docs/how_to/ensemble.md
    python benchmarks/bench_ensemble.py --smoke     # a quick look that everything still runs

`simulated_s_per_s` is with two threads, `one_thread` with one; each is the best of a few rounds, for on a machine that
others use as well every other round is theirs. `per_cpu_s` is by processor time, on one thread: others disturb it less.
`compile_s` is the time to the first figures with numba's cache empty, in a process of its own, and `cached_s` the same
once it is filled.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from ortilo_drake.flight.engine import Engine
from ortilo_drake.scenario import load_scenario

PROJECTED = "camera.kind=projected"
NO_FORCE = ("estimator={force: none, rates: none, walks: {torque_sd: 0}, biases: {uwb_sd: [0, 0, 0]}}",)
SCENARIOS = {
    "paper_imu_uwb": ("paper_imu_uwb", ()),
    "imu_uwb, force: none": ("imu_uwb", NO_FORCE),
    "imu_uwb": ("imu_uwb", ()),
    "nominal_imu_uwb_yolo": ("nominal_imu_uwb_yolo", ()),
    "imu_uwb_yolo": ("imu_uwb_yolo", ()),
    "robust_imu_uwb": ("robust_imu_uwb", ()),
    "tight_imu_uwb": ("tight_imu_uwb", ()),
    "realistic": ("realistic", ()),
}
FIRST_FLIGHT = """
import sys, time
from ortilo_drake.flight.engine import Engine
from ortilo_drake.scenario import load_scenario
engine = Engine(load_scenario(sys.argv[1], tuple(sys.argv[2:])))
start = time.perf_counter()
engine.figures([0])
print(time.perf_counter() - start)
"""


def engine_of(name: str) -> Engine:
    """Return the engine of one of SCENARIOS."""
    base, changes = SCENARIOS[name]
    return Engine(load_scenario(base, (PROJECTED, *changes)))


def speeds(name: str, flights: int, rounds: int) -> dict[str, float]:
    """Return simulated seconds per second of wall time with two threads and one, and per second of processor time."""
    engine = engine_of(name)
    engine.figures([0])
    best = {"simulated_s_per_s": 0.0, "one_thread": 0.0, "per_cpu_s": 0.0}
    for k in range(rounds):
        for key, threads in (("simulated_s_per_s", 2), ("one_thread", 1)):
            seeds = range(k * flights, (k + 1) * flights)
            wall, cpu = time.perf_counter(), time.process_time()
            figures = engine.figures(seeds, threads)
            wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
            simulated = engine.simulated_time(figures)
            best[key] = max(best[key], simulated / wall)
            if threads == 1:
                best["per_cpu_s"] = max(best["per_cpu_s"], simulated / cpu)
    return best


def first_flights(name: str) -> tuple[float, float]:
    """Return the time to the first figures [s] with an empty cache and with a full one."""
    base, changes = SCENARIOS[name]
    command = [sys.executable, "-c", FIRST_FLIGHT, base, PROJECTED, *changes]
    with tempfile.TemporaryDirectory() as cache:
        environment = os.environ | {"NUMBA_CACHE_DIR": cache}
        cold, cached = (
            float(subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout)
            for _ in range(2)
        )
    return cold, cached


def main() -> None:
    """Print the figures as JSON, and write them if asked to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", type=Path, help="file to write")
    parser.add_argument("--smoke", action="store_true", help="the first scenario, few flights, one round")
    arguments = parser.parse_args()
    flights, rounds = (2, 1) if arguments.smoke else (32, 3)
    found: dict[str, dict[str, float]] = {}
    for name in list(SCENARIOS)[: 1 if arguments.smoke else None]:  # each kind of flight compiles for a minute
        figures = speeds(name, flights, rounds)
        if not arguments.smoke:
            figures["compile_s"], figures["cached_s"] = first_flights(name)
        for key, value in figures.items():
            found.setdefault(key, {})[name] = round(value, 1)
        print(name, figures, file=sys.stderr, flush=True)  # the whole takes a quarter of an hour
    text = json.dumps(found, indent=2)
    print(text)
    if arguments.json:
        arguments.json.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
