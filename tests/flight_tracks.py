"""Tracks of the ready-made flights, to which later versions are held.

`python tests/flight_tracks.py [SCENARIO ...]` flies them, or those named, and writes data/flight_tracks.json anew: only
for a change that is meant to change flights, and that says so in the CHANGELOG.
"""

import hashlib
import json
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

import numpy as np
import xarray as xr

from ortilo_drake.flight.players import player_of
from ortilo_drake.scenario import Truth, load_scenario, scenario_names

FILE: Final = Path(__file__).parent / "data" / "flight_tracks.json"
SHORT: Final = "planner={kind: waypoints, points: [[0, 0, 1.5], [1.2, 0.6, 1.5]]}"
PROJECTED: Final = [(name, "projected") for name in scenario_names()]
RENDERED: Final = [(name, "rendered") for name in ("nominal_imu_uwb_yolo", "paper_imu_uwb_yolo")]
SEEDS: Final = {"projected": range(5), "rendered": range(2)}  # drawing takes minutes
TRACK_EVERY: Final = 600  # ticks


def fly_ready_made(
    name: str, camera: str, seeds: Iterable[int], player: str = "drake"
) -> Iterator[tuple[int, xr.Dataset]]:
    """Fly a ready-made scenario whole, but on a short path with the rendered camera or with a truth of its own.

    Both are slow: pictures are drawn, or rotors, gusts and clocks integrated.
    """
    is_slow = camera == "rendered" or load_scenario(name).truth != Truth()
    changes = (f"camera.kind={camera}", *((SHORT,) if is_slow else ()))
    flies = player_of(load_scenario(name, changes), player)
    for seed in seeds:
        yield seed, flies.fly(seed)


def digest(flight: xr.Dataset) -> str:
    """Return a digest over the bytes of every variable."""
    found = hashlib.sha256()
    for name in sorted(map(str, flight.data_vars)):
        found.update(name.encode() + np.ascontiguousarray(flight[name].values).tobytes())
    return found.hexdigest()[:32]


def track(flight: xr.Dataset) -> np.ndarray:
    """Return the true and the estimated p_WB (6) of every TRACK_EVERY-th tick and of the last one [m], as rows."""
    positions = np.hstack((flight["truth"].values[:, :3], flight["estimate"].values[:, :3]))
    return np.vstack((positions[::TRACK_EVERY], positions[-1:]))


def main(names: list[str]) -> None:
    """Write the tracks of the scenarios named, by default of all."""
    kept = json.loads(FILE.read_text()) if FILE.exists() else {}
    for name, camera in [pair for pair in (*PROJECTED, *RENDERED) if pair[0] in (names or scenario_names())]:
        for seed, flight in fly_ready_made(name, camera, SEEDS[camera]):
            kept[f"{name} {camera} {seed}"] = (np.round(track(flight), 11) + 0.0).tolist()  # no -0.0
            print(name, camera, seed)
    rows = (f"{json.dumps(key)}: {json.dumps(kept[key])}" for key in sorted(kept))
    FILE.write_text("{\n" + ",\n".join(rows) + "\n}\n")


if __name__ == "__main__":
    main(sys.argv[1:])
