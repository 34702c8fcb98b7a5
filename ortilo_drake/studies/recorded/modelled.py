"""Predicted ranges and differences of ranges, from the antennas' places, anchors and constants."""

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


def antennas(p: np.ndarray, R: np.ndarray | None, lever: np.ndarray, tags: np.ndarray, tag: np.ndarray) -> np.ndarray:
    """Return the tags' positions p + R (l + t) (n, 3); p where no attitude is known.

    Args:
        p: of the body's point (n, 3).
        R: attitudes (n, 3, 3).
        lever: l, from there to the point that the tags count from, body axes (3).
        tags: t of each tag (m, 3).
        tag: which one (n).
    """
    return p if R is None else p + R @ lever + np.einsum("kij,kj->ki", R, tags[tag])
