"""What is kept of a map's flights: Parquet files of CHUNK flights each, named by their seeds.

A file is written to a temporary name and renamed, so that it is whole or not there: whatever is killed, no flight
counts twice or half.
"""

import io
import logging
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from ortilo_drake.flight.files import write_bytes

_LOG = logging.getLogger(__name__)
CHUNK: Final = 200
SEED: Final = "seed"


def chunks_of(seed: int, flights: int) -> list[range]:
    """Return the seeds of each chunk."""
    return [range(at, min(at + CHUNK, seed + flights)) for at in range(seed, seed + flights, CHUNK)]


def chunk_file(folder: Path, seeds: range) -> Path:
    """Return where a chunk is kept."""
    return folder / f"seeds_{seeds.start:08d}_{seeds.stop - 1:08d}.parquet"


def write_chunk(folder: Path, seeds: range, columns: tuple[str, ...], figures: np.ndarray) -> None:
    """Keep a chunk's figures (n, columns); InputError, naming the file, if that fails."""
    arrays = [pa.array(seeds, pa.int64()), *(pa.array(figures[:, i], pa.float64()) for i in range(len(columns)))]
    buffer = io.BytesIO()
    pq.write_table(pa.table(arrays, names=[SEED, *columns]), buffer)
    write_bytes(chunk_file(folder, seeds), buffer.getvalue(), sync=False)


def read_chunk(folder: Path, seeds: range, columns: tuple[str, ...]) -> np.ndarray | None:
    """Return a chunk's figures (n, columns); None where it is not there, and a warning where it is damaged."""
    file = chunk_file(folder, seeds)
    if not file.exists():
        return None
    try:
        table = pq.read_table(file, columns=[SEED, *columns])
        if table[SEED].to_pylist() != list(seeds):
            raise ValueError("holds other seeds")
    except (pa.ArrowException, OSError, ValueError) as error:
        _LOG.warning("%s: flown again: %s", file, " ".join(str(error).split())[:200])
        return None
    return np.column_stack([table[name].to_numpy() for name in columns])
