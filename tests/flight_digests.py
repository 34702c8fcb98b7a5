"""Digests of the ready-made flights, and tracks for where their last bits differ.

`python tests/flight_digests.py [SCENARIO ...]` flies them, or those named, and writes data/flight_digests.json anew:
only for a change that is meant to change flights, and that says so in the CHANGELOG.
"""

import hashlib
import json
import platform
import sys
from collections.abc import Iterable, Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr
from llvmlite.binding import get_host_cpu_name

from ortilo_drake.flight.flight import FlightSimulator
from ortilo_drake.scenario import Truth, load_scenario, scenario_names

FILE: Final = Path(__file__).parent / "data" / "flight_digests.json"
SEEDS: Final = range(5)
SHORT: Final = "planner={kind: waypoints, points: [[0, 0, 1.5], [1.2, 0.6, 1.5]]}"
PROJECTED: Final = [(name, "projected") for name in scenario_names()]
RENDERED: Final = [
    (name, "rendered") for name in ("nominal_imu_uwb_yolo", "paper_imu_uwb_yolo")
]  # drawing takes minutes
TRACK_EVERY: Final = 300  # ticks


def this_platform() -> str:
    """Return what the last bits of a flight depend on: the processor and the libraries that compute."""
    libraries = ("drake", "numba", "numpy", "onnxruntime", "scipy")
    return ", ".join((platform.machine(), get_host_cpu_name(), *(f"{name} {version(name)}" for name in libraries)))


def fly_ready_made(name: str, camera: str, seeds: Iterable[int] = SEEDS) -> Iterator[tuple[int, xr.Dataset]]:
    """Fly a ready-made scenario whole, but on a short path with the rendered camera or with a truth of its own.

    Both are slow: pictures are drawn, or rotors, gusts and clocks integrated.
    """
    is_slow = camera == "rendered" or load_scenario(name).truth != Truth()
    changes = (f"camera.kind={camera}", *((SHORT,) if is_slow else ()))
    simulator = FlightSimulator(load_scenario(name, changes))
    for seed in seeds:
        yield seed, simulator.fly(seed)


def digest(flight: xr.Dataset) -> str:
    """Return a digest over the bytes of every variable."""
    found = hashlib.sha256()
    for name in sorted(map(str, flight.data_vars)):
        found.update(name.encode() + np.ascontiguousarray(flight[name].values).tobytes())
    return found.hexdigest()[:32]


def track(flight: xr.Dataset) -> list[list[float]]:
    """Return the true and the estimated p_WB (6) of every TRACK_EVERY-th tick and of the last one [m]."""
    positions = np.hstack((flight["truth"].values[:, :3], flight["estimate"].values[:, :3]))
    rows: list[list[float]] = np.vstack((positions[::TRACK_EVERY], positions[-1:])).tolist()
    return rows


def main(names: list[str]) -> None:
    """Write the digests of this platform, and the tracks; of the scenarios named, by default of all."""
    kept: dict[str, Any] = json.loads(FILE.read_text()) if FILE.exists() else {"digests": {}}
    digests, tracks = {}, {}
    for name, camera in [pair for pair in (*PROJECTED, *RENDERED) if pair[0] in (names or scenario_names())]:
        for seed, flight in fly_ready_made(name, camera):
            key = f"{name} {camera} {seed}"
            digests[key] = digest(flight)
            if camera == "projected":
                tracks[key] = track(flight)
            print(key, digests[key])
    kept["digests"].setdefault(this_platform(), {}).update(digests)
    before = kept.get("tracks", {})
    kept["tracks"] = before | {key: tracks[key] for key in tracks if key not in before}  # flights are held to the first
    FILE.write_text(json.dumps(kept, indent=0) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
