"""Tracks of the ready-made flights, which later versions must reproduce.

`python tests/flight_tracks.py [SCENARIO ...]` flies all scenarios, or the named ones, and rewrites
data/flight_tracks.json. Use it only for a change that is meant to change flights and that the CHANGELOG mentions.
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
SEEDS: Final = {"projected": range(5), "rendered": range(2)}  # rendering takes minutes
TRACK_EVERY: Final = 600  # interval of the track [ticks]


def fly_ready_made(
    name: str, camera: str, seeds: Iterable[int], player: str = "drake"
) -> Iterator[tuple[int, xr.Dataset]]:
    """Fly a ready-made scenario on its whole path; on a short path with a rendered camera or with a truth of its own.

    These two are slow: pictures are rendered, or rotors, gusts and clocks are integrated.
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
    """Return true and estimated p_WB [m] in every TRACK_EVERY-th tick and the last tick, a row for each (n x 6)."""
    positions = np.hstack((flight["truth"].values[:, :3], flight["estimate"].values[:, :3]))
    return np.vstack((positions[::TRACK_EVERY], positions[-1:]))


def main(names: list[str]) -> None:
    """Write the tracks of the named scenarios, by default of all."""
    kept = json.loads(FILE.read_text()) if FILE.exists() else {}
    for name, camera in [pair for pair in (*PROJECTED, *RENDERED) if pair[0] in (names or scenario_names())]:
        for seed, flight in fly_ready_made(name, camera, SEEDS[camera]):
            kept[f"{name} {camera} {seed}"] = (np.round(track(flight), 11) + 0.0).tolist()  # no -0.0
            print(name, camera, seed)
    rows = (f"{json.dumps(key)}: {json.dumps(kept[key])}" for key in sorted(kept))
    FILE.write_text("{\n" + ",\n".join(rows) + "\n}\n")


if __name__ == "__main__":
    main(sys.argv[1:])
