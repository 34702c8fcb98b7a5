"""Ranges and differences of a live message as rows (anchor, value [m], other anchor or -1), or why they are dropped."""

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from ortilo_drake.interop.recorded.live_stream import Row
from ortilo_drake.interop.recorded.range_rows import FARTHEST, LONGER
from ortilo_drake.interop.recorded.range_sources import DifferenceSource, RangeSource


def each_range(
    source: RangeSource, anchors_in: Callable[[tuple[str, ...]], Iterable[int]]
) -> Callable[[list[float], tuple[str, ...]], Iterator[Row | str]]:
    """Return a function that splits a message's ranges into rows (anchor, range [m], -1) or reasons to drop one."""

    def rows_of(numbers: list[float], names: tuple[str, ...]) -> Iterator[Row | str]:
        for anchor, r in zip(anchors_in(names), numbers, strict=True):
            if anchor < 0:
                yield "ranges to anchors that the map does not name"
            elif not np.isfinite(r):
                yield "ranges that are NaN or empty"
            elif r <= 0.0:
                yield "ranges of 0 or less"
            elif r > FARTHEST / source.scale:
                yield f"ranges of more than {FARTHEST / 1000:g} km"
            else:
                yield float(anchor), source.scale * r, -1.0

    return rows_of


def each_difference(
    source: DifferenceSource, anchors: np.ndarray, index_of: Callable[[str], int]
) -> Callable[[list[float], tuple[str, ...]], Iterator[Row | str]]:
    """Return a function that makes a message's difference a row (b, value [m], a) or a reason to drop it.

    Args:
        source: the map's.
        anchors: positions (n, 3).
        index_of: an anchor by its name, negative if it is not surveyed.
    """

    def rows_of(numbers: list[float], names: tuple[str, ...]) -> Iterator[Row | str]:
        b, a, value = index_of(names[0]), index_of(names[1]), numbers[0]
        if a < 0 or b < 0:
            yield "differences to anchors that are not surveyed"
        elif not np.isfinite(value):
            yield "differences that are NaN or empty"
        elif a == b:
            yield "differences of one anchor to itself"
        elif abs(source.scale * value) > np.linalg.norm(anchors[a] - anchors[b]) + LONGER:
            yield f"differences longer by {LONGER:g} m than their anchors lie apart"
        else:
            yield float(b), source.sign * source.scale * value, float(a)

    return rows_of
