"""A recorded stream: stamps and a table of numbers, from whatever kind of file."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from ortilo_drake.interop.recorded.rejected import Rejections, kept_in_order, named
from ortilo_drake.interop.recorded.sources import Column, Source

UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


class Stream(NamedTuple):
    """Rising stamps [s] (n), numbers (n, columns), and what was rejected on the way."""

    t: np.ndarray
    values: np.ndarray
    rejected: Rejections


def read_stream(
    folder: Path, source: Source, columns: tuple[Column, ...], what: str, topic: str | None, repeats: bool = False
) -> Stream:
    """Read the columns of a source.

    Args:
        folder: where the map's files are; a file itself if the map names that one.
        source: the map's entry.
        columns: what to read of it; NaN where a row has none.
        what: what it is called in a line.
        topic: the topic, if it is a bag.
        repeats: whether rows may share a stamp.

    Raises:
        InputError: if the file cannot be read or hardly anything in it.
    """
    from ortilo_drake.interop.recorded.bag_columns import read_bag
    from ortilo_drake.interop.recorded.csv_columns import read_csv

    path = folder / source.file if folder.is_dir() else folder.parent / source.file
    rejected = Rejections(named(path, what if topic is None else f"{what}, {topic}"))
    if topic is None:
        t, values = read_csv(path, source, columns, rejected)
    else:
        t, values = read_bag(path, topic, source, columns, rejected)
    if source.time is not None:
        t = t * UNITS[source.unit]
    keep = kept_in_order(t, rejected, repeats)
    return Stream(t[keep] - source.late, values[keep], rejected)
