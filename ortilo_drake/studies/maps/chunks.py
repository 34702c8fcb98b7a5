"""The kept flights of a map: Parquet files of CHUNK flights each, named by their seeds.

A file is written to a temporary name and renamed, so that it is whole or not there: whatever is killed, no flight
counts twice or half.
"""

import io
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from ortilo_drake.flight.lost import CAUSES, NOT_LOST
from ortilo_drake.flight.store import in_folder, keep, kept
from ortilo_drake.model.optional import later

pa, pq = later("pyarrow"), later("pyarrow.parquet")

CHUNK: Final = 200
SEED: Final = "seed"


def chunks_of(seed: int, flights: int) -> list[range]:
    """Return the seeds of each chunk."""
    return [range(at, min(at + CHUNK, seed + flights)) for at in range(seed, seed + flights, CHUNK)]


def chunk_file(folder: Path, seeds: range) -> Path:
    """Return the file of a chunk."""
    return folder / f"seeds_{seeds.start:08d}_{seeds.stop - 1:08d}.parquet"


def write_chunk(folder: Path, seeds: range, columns: tuple[str, ...], figures: np.ndarray) -> None:
    """Keep a chunk's figures (n, columns); InputError, naming the file, if that fails."""
    arrays = [pa.array(seeds, pa.int64()), *(pa.array(figures[:, i], pa.float64()) for i in range(len(columns)))]
    buffer = io.BytesIO()
    pq.write_table(pa.table(arrays, _schema(columns)), buffer, write_page_checksum=True)
    file = chunk_file(folder, seeds)
    keep(file, buffer.getvalue(), in_folder(file), sync=False)


def read_chunk(folder: Path, seeds: range, columns: tuple[str, ...]) -> np.ndarray | None:
    """Return a chunk's figures (n, columns); None where it is not there, and a warning where it is damaged."""
    file = chunk_file(folder, seeds)
    return kept(file, in_folder(file), partial(_figures, seeds, columns))


def _schema(columns: tuple[str, ...]) -> Any:
    return pa.schema([(SEED, pa.int64()), *((name, pa.float64()) for name in columns)])


def _figures(seeds: range, columns: tuple[str, ...], data: bytes) -> np.ndarray:
    """Return the figures in a Parquet file's bytes; ValueError naming what cannot be a flight's."""
    table = pq.read_table(io.BytesIO(data), page_checksum_verification=True)
    if not table.schema.equals(_schema(columns)):
        raise ValueError(f"{', '.join(table.schema.names)}: must be {SEED}, {', '.join(columns)}, all numbers")
    for name in table.schema.names:
        if table[name].null_count:
            raise ValueError(f"{name}: has nulls")
    if table[SEED].to_pylist() != list(seeds):
        raise ValueError(f"{SEED}: must be {seeds.start} to {seeds.stop - 1}")
    figures = {name: table[name].to_numpy() for name in columns}
    lost = figures["cause"] != NOT_LOST if "cause" in figures else np.zeros(len(seeds), dtype=bool)
    for name, values in figures.items():
        bad = ~_may_be(name, values, lost)
        if bad.any():
            raise ValueError(f"{name}: is {values[bad][0]:g} of seed {seeds[int(np.argmax(bad))]}: cannot be")
    return np.column_stack(list(figures.values()))


def _may_be(name: str, values: np.ndarray, lost: np.ndarray) -> np.ndarray:
    """Return a mask of the values (n) that a figure may have, see flight/figures.py."""
    if name == "cause":
        return np.isin(values, range(NOT_LOST, len(CAUSES)))
    if name == "ticks" or name.startswith(("arrived_", "due_")):
        return (values >= 0.0) & (values == np.floor(values)) & np.isfinite(values)
    if name == "nees":  # of an estimate whose P is not positive definite it is not known
        return np.ones(len(values), dtype=bool)
    unknown = np.isnan(values)  # of a flight that diverged at once; path_mse also of a path that turns back in x
    return (values >= 0.0) | (unknown if name == "path_mse" else unknown & lost)
