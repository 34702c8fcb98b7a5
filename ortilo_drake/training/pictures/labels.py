"""The labels of a picture: every landmark in the picture, with its box and visible share."""

from dataclasses import dataclass

import numpy as np

MAX_OBJECTS = 32
CLASS, BOX, VISIBLE, LANDMARK, DISTANCE = 0, slice(1, 5), 5, 6, 7  # columns of the labels
LABEL_SIZE = 8
# Limits of an object that must be found: least visible share, and least width and height of its box [px].
LEAST = (0.5, 6.0)
LEAST_CLEAR = (0.6, 8.0)  # limits of objects in clearer view, which are judged separately


@dataclass(frozen=True)
class Frames:
    """Labelled pictures."""

    images: np.ndarray
    """RGB pictures (n, height, width, 3), uint8."""
    labels: np.ndarray
    """a row for each landmark in the picture (n, MAX_OBJECTS, 8): class; u_min, v_min, u_max, v_max [px] of the whole
    landmark, cut at the image's border; visible share [1]; the landmark's number; distance [m]. Unused rows have class
    -1."""


def is_to_be_found(labels: np.ndarray, least: tuple[float, float] = LEAST) -> np.ndarray:
    """Return the mask (...) of labels (..., 8) that a detector must find; the others do not count.

    `least` has the least visible share [1], and the least width and height of the box [px].
    """
    side = np.minimum(labels[..., 3] - labels[..., 1], labels[..., 4] - labels[..., 2])
    return (labels[..., CLASS] >= 0) & (labels[..., VISIBLE] >= least[0]) & (side >= least[1])
