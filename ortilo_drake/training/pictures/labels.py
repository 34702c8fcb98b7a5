"""Labels of a picture: every landmark in it, with its box and visible share."""

from dataclasses import dataclass

import numpy as np

MAX_OBJECTS = 32
CLASS, BOX, VISIBLE, LANDMARK, DISTANCE = 0, slice(1, 5), 5, 6, 7  # columns of the labels
LABEL_SIZE = 8
# Limits of an object to be found: least visible share, and least width and height of its box [px].
LEAST = (0.5, 6.0)
LEAST_CLEAR = (0.6, 8.0)  # of objects in clearer view, judged separately


@dataclass(frozen=True)
class Frames:
    """Pictures and labels."""

    images: np.ndarray
    """RGB (n, height, width, 3), uint8."""
    labels: np.ndarray
    """one row for each landmark in the picture (n, MAX_OBJECTS, 8): class, u_min, v_min, u_max, v_max [px] of the whole
    landmark cut at the image's border, share of it that nothing hides, landmark's number, distance [m]; unused rows
    have class -1."""


def is_to_be_found(labels: np.ndarray, least: tuple[float, float] = LEAST) -> np.ndarray:
    """Return a mask of the labels (..., 8) that a detector must find; the others do not count.

    Of a label that must be found share and side of the box [px] are at least `least`.
    """
    side = np.minimum(labels[..., 3] - labels[..., 1], labels[..., 4] - labels[..., 2])
    return (labels[..., CLASS] >= 0) & (labels[..., VISIBLE] >= least[0]) & (side >= least[1])
