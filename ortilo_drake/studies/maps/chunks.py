"""The figures of flights, by any player, and the files that keep them.

A file is Parquet, of CHUNK flights, named by their seeds. It is written to a temporary name and renamed, so it is
complete or absent: whatever is killed, no flight counts twice or half.
"""

import io
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
import xarray as xr

from ortilo_drake.flight.engine import Engine
from ortilo_drake.flight.figures import FIGURES, figures_of, nees_of_ticks
from ortilo_drake.flight.flight import FlightSimulator, scenario_of
from ortilo_drake.flight.lost import CAUSES, NOT_LOST, Lost
from ortilo_drake.flight.metrics import loss_of
from ortilo_drake.flight.players import CHOICES, kept_player
from ortilo_drake.flight.store import in_folder, keep, kept
from ortilo_drake.flight.summary import Loss
from ortilo_drake.model.optional import later
from ortilo_drake.scenario import Scenario

pa, pq = later("pyarrow"), later("pyarrow.parquet")

CHUNK: Final = 200
SEED: Final = "seed"


def chunks_of(seed: int, flights: int) -> list[range]:
    """Return the seeds of each chunk of `flights` flights from `seed` on."""
    return [range(at, min(at + CHUNK, seed + flights)) for at in range(seed, seed + flights, CHUNK)]


def chunk_file(folder: Path, seeds: range) -> Path:
    """Return the file of a chunk."""
    return folder / f"seeds_{seeds.start:08d}_{seeds.stop - 1:08d}.parquet"


def write_chunk(
    folder: Path, seeds: range, columns: tuple[str, ...], figures: np.ndarray, player: str = "engine"
) -> None:
    """Keep a chunk's figures (n, columns) and its player; InputError, naming the file, if that fails."""
    buffer = io.BytesIO()
    table = pa.table({SEED: np.array(seeds)} | dict(zip(columns, figures.T.astype(float), strict=True)))
    pq.write_table(table.replace_schema_metadata({"player": player}), buffer, write_page_checksum=True)
    file = chunk_file(folder, seeds)
    keep(file, buffer.getvalue(), in_folder(file), sync=False)


def read_chunk(folder: Path, seeds: range, columns: tuple[str, ...]) -> np.ndarray | None:
    """Return a chunk's figures (n, columns); None if it is absent or damaged, with a warning if damaged."""
    file = chunk_file(folder, seeds)
    return kept(file, in_folder(file), partial(_figures, seeds, columns))


def player_of_chunk(folder: Path, seeds: range) -> str:
    """Return the player that flew a chunk, which read_chunk has read."""
    return str(pq.read_schema(chunk_file(folder, seeds)).metadata[b"player"].decode())


def _figures(seeds: range, columns: tuple[str, ...], data: bytes) -> np.ndarray:
    """Return the figures in a Parquet file's bytes; ValueError naming a value that no flight can have."""
    table = pq.read_table(io.BytesIO(data), page_checksum_verification=True)
    if table.schema.names != [SEED, *columns] or table.schema.types != [pa.int64(), *[pa.float64()] * len(columns)]:
        raise ValueError(f"{', '.join(table.schema.names)}: must be {SEED}, {', '.join(columns)}, all numbers")
    if table[SEED].to_pylist() != list(seeds):
        raise ValueError(f"{SEED}: must be {seeds.start} to {seeds.stop - 1}")
    if (table.schema.metadata or {}).get(b"player", b"").decode(errors="replace") not in CHOICES:
        raise ValueError(f"player: must be one of {', '.join(CHOICES)}")
    figures = {name: table[name].to_numpy() for name in columns}
    kept = figures.get("cause", np.full(len(seeds), NOT_LOST)) == NOT_LOST
    for name, values in figures.items():
        if (wrong := ~_may_be(name, values, kept)).any():
            raise ValueError(f"{name}: is {values[wrong][0]:g} of seed {seeds[int(np.argmax(wrong))]}: cannot be")
    return np.column_stack(list(figures.values()))


def _may_be(name: str, values: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """Return a mask of the values (n) that a figure may have (flight/figures.py), given which flights were kept (n)."""
    if name == "cause":
        return np.isin(values, range(NOT_LOST, len(CAUSES)))
    if name == "ticks" or name.startswith(("arrived_", "due_")):
        return (values >= 0.0) & (values == np.floor(values)) & np.isfinite(values)
    # An error may be NaN if the flight diverged at once, path_mse if the path turns back in x, NEES if P is bad.
    return (values >= 0.0) | (np.isnan(values) & (~kept | (name == "path_mse"))) | (name == "nees")


def columns_of(scenario: Scenario) -> tuple[str, ...]:
    """Return the names of a flight's figures, which are the engine's, see flight/engine.py."""
    flying = [name for name in scenario.measurement.sensors if name in scenario.sensors]
    return (*FIGURES, *(f"{what}_{sensor}" for sensor in flying for what in ("arrived", "due")))


def fly_figures(scenario_json: str, seeds: Sequence[int], folder: str, player: str = "fastest") -> np.ndarray:
    """Fly seeds and return the figures of each (n, columns). Runs in a worker: the arguments are plain data."""
    flying = kept_player(scenario_json, folder, player)
    if isinstance(flying, Engine):
        return flying.figures(seeds)
    return np.array([drake_figures(flying.fly(seed)) for seed in seeds])


def trace_of(flight: xr.Dataset) -> np.ndarray:
    """Return a flight's trace as the engine has it, a row for each tick (n, TRACE_SIZE), see flight/figures.py."""
    x, xhat, reference = (np.ascontiguousarray(flight[name].values) for name in ("truth", "estimate", "reference"))
    nees = nees_of_ticks(x, xhat, flight["covariance"].values.reshape(len(x), -1))
    return np.column_stack([x[:, :3], xhat[:, :3], nees, reference[:, :3]])


def traced(player: Engine | FlightSimulator, seed: int) -> tuple[np.ndarray, Loss | Lost | None]:
    """Fly a seed; return rows that begin with the figures of flight/figures.py, one for each tick, and its loss."""
    if isinstance(player, Engine):
        return player.trace(seed)
    flight = player.fly(seed)
    return trace_of(flight), loss_of(flight)


def drake_figures(flight: xr.Dataset) -> list[float]:
    """Return the figures of a flight that Drake flew, in the engine's form."""
    scenario, trace = scenario_of(flight), trace_of(flight)
    out = np.empty(len(FIGURES))
    figures_of(trace, np.ascontiguousarray(flight["reference"].values[:, :3]), out)
    loss, last = loss_of(flight), len(trace) - 1
    out[0], out[1] = last, NOT_LOST if loss is None else CAUSES.index(loss.cause)
    counts: list[float] = []
    for sensor in scenario.measurement.sensors:
        if sensor in scenario.sensors:
            counts += [float(flight["arrival"].sel(sensor=sensor).sum()), last // scenario.every(sensor) + 1]
    return [*out.tolist(), *counts]
