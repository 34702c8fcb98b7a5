"""Boxes over a camera picture, with names of which none is over another nor over a box."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from ortilo_drake.views.labels import Label, put_labels
from ortilo_drake.views.palette import YELLOW


def draw_boxes(
    axes: Axes, picture: np.ndarray, boxes: np.ndarray, names: Sequence[str] = (), expected: Sequence[np.ndarray] = ()
) -> None:
    """Draw a picture, what was found in it in yellow and what was expected in it dotted in white.

    Call it once the figure's layout is what it will be, as names are placed by what they would cover.

    Args:
        axes: where; their units are pixels of the picture, u to the right and v down.
        picture: RGB (height, width, 3).
        boxes: u_min, v_min, u_max, v_max of what was found [px] (n, 4).
        names: what stands beside each of these boxes (n), or nothing.
        expected: boxes that a map expects [px], each (4).
    """
    axes.imshow(picture)
    axes.set(xlim=(-0.5, picture.shape[1] - 0.5), ylim=(picture.shape[0] - 0.5, -0.5), xticks=[], yticks=[])
    axes.grid(False)
    for u0, v0, u1, v1 in expected:
        axes.add_patch(Rectangle((u0, v0), u1 - u0, v1 - v0, fill=False, ec="white", ls=":", lw=1.0))
    for u0, v0, u1, v1 in boxes:
        axes.add_patch(Rectangle((u0, v0), u1 - u0, v1 - v0, fill=False, ec=YELLOW, lw=1.3))
    if names:
        low, high = axes.transData.transform(boxes[:, :2]), axes.transData.transform(boxes[:, 2:])
        sizes = np.abs(high - low) / 2.0
        # The points that no name may cover are the boxes whole; a name belongs to the middle of its box's upper edge.
        middles = np.hstack([(boxes[:, :2] + boxes[:, 2:]) / 2.0, sizes])
        labels = [Label((u0 + u1) / 2.0, v0, name, YELLOW) for (u0, v0, u1, _), name in zip(boxes, names, strict=True)]
        put_labels(axes, labels, middles, halo="black")
