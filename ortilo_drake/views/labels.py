"""Labels beside points of a figure, none over another and none over a point."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.patheffects import withStroke
from matplotlib.text import Annotation

_GAP = 3.0  # between a label and what it must not touch [px]
_FIRST, _STEP, _RINGS = 11.0, 4.0, 120  # distances of a label from its point [px], and how many of them are tried
_DIRECTIONS = 24
_LEADER = 16.0  # a label farther from its point than that has a line to it [px]


class Label(NamedTuple):
    """A text of a colour to put beside the point (x, y), in the axes' data."""

    x: float
    y: float
    text: str
    color: str


def put_labels(
    axes: Axes, labels: Sequence[Label], points: np.ndarray, size: float = 7.0, halo: str = "white"
) -> list[Annotation]:
    """Put labels beside their points, each at the nearest place where it covers nothing; return them.

    Earlier ones choose first. None is over a point: x and y in the axes' data, half width and half height [px] (n, 4).
    The size is that of the text [pt], the halo a colour around it, which sets it off from what is behind. Call it once
    limits and layout of the figure are final.
    """
    figure = axes.get_figure(root=True)
    assert figure is not None
    renderer = FigureCanvasAgg(figure).get_renderer()
    middle = axes.transData.transform(points[:, :2])
    taken = np.hstack([middle - points[:, 2:], middle + points[:, 2:]])
    frame = axes.get_window_extent(renderer)
    turns = 2.0 * np.pi * (np.arange(_DIRECTIONS) + 0.5) / _DIRECTIONS
    ways = np.column_stack([np.cos(turns), np.sin(turns)])
    ways = ways[np.argsort(-np.abs(ways[:, 0]))]  # to the side rather than above or below
    placed = []
    for label in labels:
        stroke = withStroke(linewidth=2.2, foreground=halo, alpha=0.85)
        style: Any = {"fontsize": size, "color": label.color, "ha": "center", "va": "center", "path_effects": [stroke]}
        text = axes.annotate(
            label.text, (label.x, label.y), (0.0, 0.0), textcoords="offset pixels", zorder=6.0, **style
        )
        extent = text.get_window_extent(renderer)
        half = 0.5 * np.array([extent.width, extent.height])
        at = axes.transData.transform((label.x, label.y))
        offset = _free_place(at, half, ways, taken, (frame.x0, frame.y0, frame.x1, frame.y1))
        text.set_position((offset[0], offset[1]))
        taken = np.vstack([taken, np.hstack([at + offset - half, at + offset + half])])
        edge = offset - np.clip(offset, -half, half)
        if np.linalg.norm(edge) > _LEADER:
            end = at + edge
            line = axes.transData.inverted().transform(np.vstack([at, end]))
            axes.plot(*line.T, color=label.color, lw=0.5, alpha=0.6, zorder=2.5)
        placed.append(text)
    return placed


def _free_place(
    at: np.ndarray, half: np.ndarray, ways: np.ndarray, taken: np.ndarray, frame: tuple[float, float, float, float]
) -> np.ndarray:
    """Return the offset (2) [px] by which a label clears `taken` (n, 4) within `frame`, by `ways` in turn."""
    offset = np.zeros(2)
    for ring in range(_RINGS):
        for way in ways:
            offset = way * (half + _FIRST + ring * _STEP)
            low, high = at + offset - half - _GAP, at + offset + half + _GAP
            inside = low[0] >= frame[0] and low[1] >= frame[1] and high[0] <= frame[2] and high[1] <= frame[3]
            if inside and not np.any(np.all((taken[:, :2] < high) & (taken[:, 2:] > low), axis=1)):
                return offset
    return offset
