"""What many flights cost: time and memory over flights, ticks, sensors and threads, with straight lines fitted.

    python benchmarks/bench_cost.py --json F --png F    # the figures of docs/how_to/ensemble.md, a quarter of an hour
    python benchmarks/bench_cost.py --smoke             # a quick look that everything still runs

Every measurement is a process of its own: time is that of its flights alone, memory the most that it ever held (peak
resident set). Memory over flights is that of `ortilo map` on short hovering flights, for a flight leaves as many
scalars however long it is; what a map holds at a time is what its largest point needs, so that flights are spread over
points of 10,000. Lines are fitted by least squares with SciPy, their slopes with 95 % intervals; a fit beyond what was
measured is an extrapolation and says so.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import matplotlib.pyplot as plt
import numpy as np
from scipy import stats

SENSORS = {
    "imu": ("nominal_imu_uwb", "sensors=[imu]", "servo.velocities=truth"),
    "imu, uwb": ("nominal_imu_uwb",),
    "imu, uwb, camera": ("nominal_imu_uwb_yolo", "camera.kind=projected"),
}
HOVER = "planner={kind: hover, point: [9.0, 0.5, 1.5], duration: %g}"
FLY = """
import json, resource, sys, time
from ortilo_drake.flight.engine import Engine
from ortilo_drake.scenario import load_scenario
flights, threads, name, *changes = json.loads(sys.argv[1])
engine = Engine(load_scenario(name, ("settle=0.0", *changes)))
engine.figures([0, 1], threads)
start = time.perf_counter()
figures = engine.figures(range(flights), threads)
wall = time.perf_counter() - start
ticks = float(figures[:, 0].sum())
print(json.dumps([wall, ticks, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0]))
"""
MAP = """
import json, resource, sys, time
from pathlib import Path
from ortilo_drake.studies.maps.map_flights import fly_map
from ortilo_drake.studies.maps.sweep import load_sweep
folder = Path(sys.argv[1])
start = time.perf_counter()
found = fly_map(load_sweep(folder / "sweep.yaml"), "sweep.yaml", folder / "flights", 1)
wall = time.perf_counter() - start
flights = sum(row.flights for row in found.rows)
print(json.dumps([wall, flights, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0]))
"""
POINT = 10_000  # flights of a point


def run(code: str, argument: str) -> list[float]:
    """Return what a process of its own prints: wall time [s], ticks or flights, and most memory [MiB]."""
    done = subprocess.run([sys.executable, "-c", code, argument], check=True, capture_output=True, text=True)
    found: list[float] = json.loads(done.stdout.splitlines()[-1])
    return found


def line(x: np.ndarray, y: np.ndarray) -> dict[str, Any]:
    """Return the least-squares line a + b x and the 95 % interval of b; more than two points."""
    fit = stats.linregress(x, y)
    half = float(stats.t.ppf(0.975, len(x) - 2) * fit.stderr)
    return {"a": float(fit.intercept), "b": float(fit.slope), "b_interval": [fit.slope - half, fit.slope + half]}


def time_over_ticks(sensors: str, totals: list[tuple[int, float]], threads: int = 1) -> list[list[float]]:
    """Return [ticks in all, wall time [s], memory [MiB]] for numbers of flights and their durations [s]."""
    rows = []
    for flights, duration in totals:
        name, *changes = SENSORS[sensors]
        wall, ticks, memory = run(FLY, json.dumps([flights, threads, name, *changes, HOVER % duration]))
        rows.append([ticks, wall, memory])
    return rows


def memory_of_maps(counts: list[int]) -> list[list[float]]:
    """Return [flights, wall time [s], memory [MiB]] of maps of so many flights of a few ticks."""
    rows = []
    for count in counts:
        with tempfile.TemporaryDirectory() as folder:
            at_a_point, points = min(count, POINT), max(count // POINT, 1)
            losses = ", ".join(f"{0.5 * i / points:.6f}" for i in range(points))
            text = (
                f"scenario: nominal_imu_uwb\nsettings: {{settle: 0.0, planner: {{kind: hover, duration: 0.1}}}}\n"
                f"axes: {{uwb.link.loss: [{losses}]}}\nflights: {at_a_point}\n"
            )
            (Path(folder) / "sweep.yaml").write_text(text)
            wall, flights, memory = run(MAP, folder)
            rows.append([flights, wall, memory])
    return rows


def measured(smoke: bool) -> dict[str, Any]:
    """Return all measurements and fits."""
    totals, counts = (
        [(25, 10.0), (100, 10.0), (100, 30.0), (100, 60.0), (400, 30.0)],
        [100, 1_000, 10_000, 10**5, 10**6],
    )
    if smoke:
        totals, counts = [(2, 1.0), (4, 1.0), (4, 2.0)], [100, 200, 300]
    time = {sensors: time_over_ticks(sensors, totals) for sensors in SENSORS}
    two = time_over_ticks("imu, uwb", totals[-1:], threads=2)[0]
    memory = memory_of_maps(counts)
    fits = {sensors: line(*np.array(rows)[:, :2].T) for sensors, rows in time.items()}
    tick_rows = {s: [dict(zip(("ticks", "s", "MiB"), row, strict=True)) for row in rows] for s, rows in time.items()}
    return {
        "time": tick_rows,
        "fits_of_time": fits,
        "microseconds_a_tick": {sensors: 1e6 * fit["b"] for sensors, fit in fits.items()},
        "two_threads_over_one": time["imu, uwb"][-1][1] / two[1],
        "memory": [dict(zip(("flights", "s", "MiB"), row, strict=True)) for row in memory],
        "fit_of_memory": line(*np.array(memory)[:, [0, 2]].T),
        # Of flights of 60 s at 30 Hz: an extrapolation.
        "core_hours_of_1e9_flights": {sensors: fit["b"] * 1e9 * 1800.0 / 3600.0 for sensors, fit in fits.items()},
    }


def draw(found: dict[str, Any], file: Path) -> None:
    """Draw time over ticks and memory over flights, with the lines."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.0, 4.0), layout="constrained")
    for sensors, rows in found["time"].items():
        x, fit = np.array([row["ticks"] for row in rows]), found["fits_of_time"][sensors]
        (points,) = left.loglog(x, [row["s"] for row in rows], "o")
        ends = np.array([x.min(), x.max()])
        label = f"{sensors}: {1e6 * fit['b']:.1f} µs a tick"
        left.loglog(ends, np.maximum(fit["a"] + fit["b"] * ends, 1e-6), color=points.get_color(), label=label)
    left.set(xlabel="ticks of all flights", ylabel="wall time, one thread [s]")
    left.legend()
    flights, fit = np.array([row["flights"] for row in found["memory"]]), found["fit_of_memory"]
    right.semilogx(flights, [row["MiB"] for row in found["memory"]], "o", color="C3")
    ends = np.geomspace(flights.min(), 1e6, 200)
    right.semilogx(ends, fit["a"] + fit["b"] * ends, "--", color="C3", label="straight line")
    right.set(xlabel="flights of a map", ylabel="most memory held [MiB]", ylim=(0.0, None))
    right.legend()
    figure.savefig(file, dpi=150)


def main() -> None:
    """Print the figures as JSON; write and draw them if asked to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", type=Path, help="file to write")
    parser.add_argument("--png", type=Path, help="picture to draw")
    parser.add_argument("--smoke", action="store_true", help="few and short flights")
    arguments = parser.parse_args()
    found = measured(arguments.smoke)
    text = json.dumps(found, indent=2)
    print(text)
    if arguments.json:
        arguments.json.write_text(text + "\n", encoding="utf-8")
    if arguments.png:
        draw(found, arguments.png)


if __name__ == "__main__":
    main()
