"""Labels beside points of a figure that cover neither each other nor a point."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.patheffects import withStroke
from matplotlib.text import Annotation

_GAP = 3.0  # gap between a label and other labels or points [px]
_FIRST, _STEP, _RINGS = 11.0, 4.0, 120  # first distance of a label from its point, step [px], number of distances
_DIRECTIONS = 24  # directions tried at each distance
_LEADER = 16.0  # distance from its point beyond which a label has a line to the point [px]


class Label(NamedTuple):
    """A text and its colour, to put beside the point (x, y) in the axes' data coordinates."""

    x: float
    y: float
    text: str
    color: str


def put_labels(
    axes: Axes, labels: Sequence[Label], points: np.ndarray, size: float = 7.0, halo: str = "white"
) -> list[Annotation]:
    """Put labels beside their points, each at the nearest place where it covers nothing; return the annotations.

    Earlier labels choose first. No label covers one of `points`: x and y in the axes' data coordinates, half width and
    half height [px] (n x 4). `size` is the font size [pt]; `halo` is a colour around the text that separates it from
    the background. Call this once limits and layout of the figure are final.
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
    """Return the first offset (2) [px] with which a label clears `taken` (n x 4) inside `frame`, trying `ways`."""
    offset = np.zeros(2)
    for ring in range(_RINGS):
        for way in ways:
            offset = way * (half + _FIRST + ring * _STEP)
            low, high = at + offset - half - _GAP, at + offset + half + _GAP
            inside = low[0] >= frame[0] and low[1] >= frame[1] and high[0] <= frame[2] and high[1] <= frame[3]
            if inside and not np.any(np.all((taken[:, :2] < high) & (taken[:, 2:] > low), axis=1)):
                return offset
    return offset
