"""Recordings read back by Rerun's own reader, as plain arrays by entity path and component."""

from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

needs_rerun = pytest.mark.skipif(
    find_spec("rerun") is None, reason="rerun-sdk missing: pip install 'ortilo-drake[rerun]'"
)


class Rows(NamedTuple):
    """What an entity has of a component: times [ns] (none of what is static), and a value for each."""

    times: np.ndarray
    values: list[Any]


def read_entities(path: Path) -> dict[tuple[str, str], Rows]:
    """Return the rows of each (entity path, component) of a file's recording."""
    from rerun.chunk import RrdReader

    found: dict[tuple[str, str], Rows] = {}
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        static = chunk.is_static
        assert static or chunk.timeline_names == ["time"]
        times = np.array([]) if static else batch.column("time").cast("int64").to_numpy()
        for name in batch.schema.names:
            if ":" in name and not name.startswith("rerun"):
                key = chunk.entity_path, name
                assert key not in found, key
                found[key] = Rows(times, batch.column(name).to_pylist())
    return found


def kinds(path: Path) -> tuple[int, int]:
    """Return how many recordings and blueprints a file has."""
    from rerun.chunk import RrdReader

    reader = RrdReader(path)
    return len(reader.recordings()), len(reader.blueprints())
