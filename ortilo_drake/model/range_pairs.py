"""Differences of the ranges to two anchors: the rows of the uwb message, and the order of the pairs of anchors.

A row is [a, b, value, there, age]: the indices of two anchors, value = r_b - r_a [m], there = 1, and the age [s] of the
difference at the message's stamp. For a missing difference, value, there and age are 0.
"""

from typing import Final, Literal

import numpy as np

from ortilo_drake.model.signals import PAYLOAD

A: Final = 0
B: Final = 1
VALUE: Final = 2
THERE: Final = 3
AGE: Final = 4
ROW: Final = 5

Pairs = Literal["cycle", "all"]


def pairs_in_turn(pairs: Pairs, n: int) -> np.ndarray:
    """Return the pairs (a, b) of n anchors, n at least 2, in the order of their packets (m, 2).

    'cycle' pairs each anchor with the next one, and the last one with the first. 'all' continues with each anchor and
    the next but one, and so on, until each pair has occurred once.
    """
    steps = range(1, 2 if pairs == "cycle" else n // 2 + 1)
    found = [(i, (i + step) % n) for step in steps for i in range(n // 2 if 2 * step == n else n)]
    return np.array(found, dtype=np.int64)


def differences_size(rows: int) -> int:
    """Return the size of a message with `rows` rows."""
    return PAYLOAD + ROW * rows
