"""What ranges and differences of ranges should be, from the antenna's places, anchors and constants."""

import numpy as np

from ortilo_drake.interop.recorded.recording import Ranges


def modelled(p: np.ndarray, anchors: np.ndarray, c: np.ndarray, ranges: Ranges) -> np.ndarray:
    """Return |p - a_b| + c_b, of a difference less |p - a_a| + c_a (n) [m].

    Args:
        p: the antenna's place at each of them (n, 3).
        anchors: positions (m, 3).
        c: constants of the anchors (m).
        ranges: which anchors they are of.
    """
    found = np.linalg.norm(p - anchors[ranges.anchor], axis=1) + c[ranges.anchor]
    two = ranges.other >= 0
    if two.any():
        of = ranges.other[two]
        found[two] -= np.linalg.norm(p[two] - anchors[of], axis=1) + c[of]
    return found
