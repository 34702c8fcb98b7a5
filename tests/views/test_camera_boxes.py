"""Boxes over a picture: they stand where they were found, and no name is over another or over a box."""

from itertools import combinations

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import same_color
from matplotlib.figure import Figure

from ortilo_drake.views.camera_boxes import draw_boxes
from ortilo_drake.views.palette import YELLOW

PICTURE = np.full((240, 320, 3), 90, dtype=np.uint8)
CROWD = np.array([[100 + 9 * i, 100 + 2 * i, 112 + 9 * i, 130 + 2 * i] for i in range(6)], dtype=float)


def test_boxes_are_where_they_were_found_and_expected() -> None:
    axes = Figure(figsize=(8, 6)).add_axes((0.0, 0.0, 1.0, 1.0))
    draw_boxes(axes, PICTURE, CROWD[:2], expected=[CROWD[4]])
    white, *yellow = axes.patches
    for patch, (u0, v0, u1, v1) in zip((white, *yellow), CROWD[[4, 0, 1]], strict=True):
        assert (*patch.get_xy(), patch.get_width(), patch.get_height()) == (u0, v0, u1 - u0, v1 - v0)
    assert same_color(white.get_edgecolor(), "white")
    assert all(same_color(patch.get_edgecolor(), YELLOW) for patch in yellow)
    assert list(axes.texts) == []
    assert (axes.get_xlim(), axes.get_ylim()) == ((-0.5, 319.5), (239.5, -0.5))


def test_no_name_is_over_another_nor_over_a_box() -> None:
    figure = Figure(figsize=(8, 6))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    names = [f"potted plant {i}" for i in range(len(CROWD))]
    draw_boxes(axes, PICTURE, CROWD, names)
    renderer = FigureCanvasAgg(figure).get_renderer()
    texts = [text.get_window_extent(renderer) for text in axes.texts]
    assert [text.get_text() for text in axes.texts] == names
    assert [a for a, b in combinations(texts, 2) if a.overlaps(b)] == []
    boxes = [patch.get_window_extent(renderer) for patch in axes.patches]
    assert [text for text in texts for box in boxes if text.overlaps(box)] == []
