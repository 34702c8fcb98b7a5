"""Boxes on a camera picture, with names that overlap neither each other nor a box."""

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
    """Draw an RGB picture (height x width x 3), with found boxes in yellow and expected boxes dotted in white.

    Found boxes are rows u_min, v_min, u_max, v_max [px] (n x 4), optionally with names (n). Each box that the map
    expects has the same four numbers (4). The axes' units are pixels of the picture, u to the right and v down. Call
    this once the figure's layout is final, because the place of a name depends on what the name would cover.
    """
    axes.imshow(picture)
    axes.set(xlim=(-0.5, picture.shape[1] - 0.5), ylim=(picture.shape[0] - 0.5, -0.5), xticks=[], yticks=[])
    axes.grid(False)
    axes.apply_aspect()  # the places of names depend on the picture's final corners
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
        # No name may cover any part of a box; a name belongs to the middle of its box's upper edge.
        middles = np.hstack([(boxes[:, :2] + boxes[:, 2:]) / 2.0, sizes])
        labels = [Label((u0 + u1) / 2.0, v0, name, YELLOW) for (u0, v0, u1, _), name in zip(boxes, names, strict=True)]
        put_labels(axes, labels, middles, size=8.0, halo="black")
