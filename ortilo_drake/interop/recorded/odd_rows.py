"""Rows of a truth that hold a position which was not measured: it froze, or leaps away and back."""

import numpy as np

LEAP = (1.0, 10.0)  # of a lone position: [m], and usual steps beside


def frozen_rows(t: np.ndarray, p: np.ndarray, longest: float) -> np.ndarray:
    """Return a mask (n) of the rows that repeat the position before them, in runs longer than `longest`.

    Args:
        t: stamps (n) [s].
        p: positions (n, 3).
        longest: a repetition of no more than this is no freeze [s].
    """
    new = np.concatenate(([True], (np.diff(p, axis=0) != 0.0).any(axis=1)))
    starts, run = np.flatnonzero(new), np.cumsum(new) - 1
    lasts = np.maximum.reduceat(t, starts) - t[starts]
    return np.asarray(~new & (lasts > longest)[run])


def leaping_rows(p: np.ndarray) -> np.ndarray:
    """Return a mask (n) of the rows whose position (n, 3) alone lies far from both beside it, which are near another.

    Far is LEAP, and many usual steps.
    """
    steps = np.linalg.norm(np.diff(p, axis=0), axis=1)
    beside = np.linalg.norm(p[2:] - p[:-2], axis=1)
    least = np.minimum(steps[:-1], steps[1:])
    far = (least > LEAP[0] + LEAP[1] * np.median(steps)) & (beside < 0.5 * least)
    return np.concatenate(([False], far, [False]))
