"""Losses imposed on recorded ranges: single ones at random, all of them for a while."""

import numpy as np

from ortilo_drake.interop.recorded.map_file import Gaps
from ortilo_drake.interop.recorded.recording import Ranges


def lose_some(ranges: Ranges, share: float, seed: int) -> Ranges:
    """Return the ranges without a share of them, each lost independently."""
    kept = np.random.Generator(np.random.Philox(seed)).random(len(ranges.t)) >= share
    return ranges.only(kept)


def gap_ends(ranges: Ranges, gaps: Gaps, first: float) -> np.ndarray:
    """Return the times at which the gaps end [s]: the first begins at `first`, the last ends before the ranges do."""
    starts = np.arange(first, ranges.t[-1] - gaps.last, gaps.every)
    return starts + gaps.last


def lose_gaps(ranges: Ranges, gaps: Gaps, ends: np.ndarray) -> Ranges:
    """Return the ranges outside the gaps that end then."""
    lost = np.zeros(len(ranges.t), dtype=bool)
    for end in ends:
        lost |= (ranges.t >= end - gaps.last) & (ranges.t < end)
    return ranges.only(~lost)
