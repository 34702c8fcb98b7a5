"""Blocks of live rows in the order of their stamps: joined to earlier blocks, and split at a stamp."""

from typing import Any, NamedTuple

import numpy as np

from ortilo_drake.interop.recorded.range_rows import Ranges
from ortilo_drake.interop.recorded.recording import AidRows, Imu, between


class Block(NamedTuple):
    """Rows in the order of their stamps, which count from the first range [s]; imu is None if the map has no imu.

    If the map has a separate accelerometer, the imu's `force` is not filled in.
    """

    ranges: Ranges
    imu: Imu | None
    looks: AidRows


def joined(a: Any, b: Any) -> Any:
    """Return the rows of a followed by the later rows of b; both are arrays, or tuples whose parts are joined."""
    if a is None or b is None:
        return None
    if isinstance(a, np.ndarray):
        return np.concatenate((a, b))
    parts = map(joined, a, b)
    return a._make(parts) if hasattr(a, "_make") else tuple(parts)


def parted(block: Block, t: float) -> tuple[Block, Block]:
    """Return the rows up to and including the stamp t [s], and the rows after it."""
    ranges, imu, looks = block

    def part(after: float, until: float) -> Block:
        r, f, m = ((stamps > after) & (stamps <= until) for stamps in (ranges.t, looks.finder_t, looks.flow_t))
        finder = {"finder_t": looks.finder_t[f], "distance": looks.distance[f]}
        seen = looks._replace(**finder, flow_t=looks.flow_t[m], flow=looks.flow[m])
        return Block(ranges.only(r), None if imu is None else between(imu, after, until), seen)

    return part(-np.inf, t), part(t, np.inf)


def behind_gap(block: Block, longest: float) -> Block:
    """Return the rows from the first range after the last gap of ranges longer than `longest` [s]; else all rows."""
    gaps = np.flatnonzero(np.diff(block.ranges.t) > longest)
    return parted(block, float(np.nextafter(block.ranges.t[gaps[-1] + 1], -np.inf)))[1] if len(gaps) else block
