"""Boxes over a camera picture, with names that overlap neither each other nor a box."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from ortilo_drake.views.labels import Label, put_labels
from ortilo_drake.views.palette import YELLOW


def draw_boxes(
    axes: Axes, picture: np.ndarray, boxes: np.ndarray, names: Sequence[str] = (), expected: Sequence[np.ndarray] = ()
) -> None:
    """Draw a picture, RGB (height, width, 3), with the boxes found in yellow and the boxes expected dotted in white.

    Boxes are u_min, v_min, u_max, v_max [px] (n, 4), with or without names beside them (n); those that a map expects
    are likewise (4) each. The axes' units are pixels of the picture, u to the right and v down. Call it once the
    figure's layout is final, as the place of a name depends on what it would cover.
    """
    axes.imshow(picture)
    axes.set(xlim=(-0.5, picture.shape[1] - 0.5), ylim=(picture.shape[0] - 0.5, -0.5), xticks=[], yticks=[])
    axes.grid(False)
    axes.apply_aspect()  # where the picture's corners come to lie decides where a name does
    for corners, ec, ls, lw, label in (
        *((box, "white", ":", 1.0, "expected by the map") for box in expected),
        *((box, YELLOW, "-", 1.3, "found") for box in boxes),
    ):
        u0, v0, u1, v1 = corners
        known = label in axes.get_legend_handles_labels()[1]
        style: Any = {"fill": False, "ec": ec, "ls": ls, "lw": lw}
        axes.add_patch(Rectangle((u0, v0), u1 - u0, v1 - v0, label="_" if known else label, **style))
    if names:
        low, high = axes.transData.transform(boxes[:, :2]), axes.transData.transform(boxes[:, 2:])
        sizes = np.abs(high - low) / 2.0
        # The points that no name may cover are the boxes whole; a name belongs to the middle of its box's upper edge.
        middles = np.hstack([(boxes[:, :2] + boxes[:, 2:]) / 2.0, sizes])
        labels = [Label((u0 + u1) / 2.0, v0, name, YELLOW) for (u0, v0, u1, _), name in zip(boxes, names, strict=True)]
        put_labels(axes, labels, middles, size=8.0, halo="black")
