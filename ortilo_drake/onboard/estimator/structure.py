"""The zeros of Phi, so that Phi P Phi^T + W takes only what must be computed.

Most rows of Phi leave a state as it is, or shrink it; the others see few states.
"""

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable


class Structure(NamedTuple):
    """The entries of Phi (N, N) that are not 0."""

    columns: np.ndarray
    """of each row, which entries are not 0 (N, w); counts says how many of them are meant."""
    values: np.ndarray
    """those entries (N, w)."""
    counts: np.ndarray
    """how many there are (N)."""
    mixing: np.ndarray
    """the rows that see another state than their own (c)."""
    keeps: np.ndarray
    """of every other row its one entry, on the diagonal; 1 of those that mix (N)."""


@register_jitable
def structure_of(Phi: np.ndarray) -> Structure:
    """Return the nonzero entries of Phi (N, N)."""
    N = Phi.shape[0]
    columns, values, counts = np.zeros((N, N), np.int64), np.zeros((N, N)), np.zeros(N, np.int64)
    mixing, keeps, c = np.zeros(N, np.int64), np.ones(N), 0
    for i in range(N):
        for k in range(N):
            if Phi[i, k] != 0.0:
                columns[i, counts[i]], values[i, counts[i]] = k, Phi[i, k]
                counts[i] += 1
        if counts[i] == 1 and columns[i, 0] == i:
            keeps[i] = values[i, 0]
        else:
            mixing[c] = i
            c += 1
    w = max(1, counts.max())
    return Structure(columns[:, :w].copy(), values[:, :w].copy(), counts, mixing[:c].copy(), keeps)
