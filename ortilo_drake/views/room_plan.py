"""The plan of a room from above, to scale."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib import transforms
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Polygon, Rectangle
from matplotlib.ticker import FixedLocator, MaxNLocator
from pydrake.trajectories import Trajectory

from ortilo_drake.model.room import Room
from ortilo_drake.views.figures import turned
from ortilo_drake.views.labels import Label, put_labels
from ortilo_drake.views.pictures import save_picture
from ortilo_drake.views.themes import SLIDE_DPI, SLIDE_SIZE, for_slides

STYLE: Any = {"font.size": 9, "legend.frameon": False, "figure.dpi": 150, "savefig.dpi": 150, "axes.linewidth": 0.6}
# Colours of landmark classes, in turn: Okabe and Ito's, then Tol's; colour-blind readers can tell them apart.
_CLASS = ("#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#882255", "#999933", "#44AA99", "#332288")
_ANCHOR, _PATH, _INK = "#0B3C6F", "#1A1A1A", "#333333"
_WALL, _WALL_EDGE, _FLOOR = "#8C7B6B", "#5E5146", "#FBF9F5"
_FRAME = 0.10  # drawn thickness of the outer walls [m]
_LARGEST = (11.0, 8.5)  # largest size of the drawn room [in]
_CORNER, _LEGEND = np.array([0.7, 0.6]), 0.55  # on a slide: margins left of and below the room, height of a legend [in]
_BELOW, _BESIDE = np.array([8.7, 3.7]), np.array([6.5, 4.25])  # largest room on a slide, legend below or beside [in]
_LEAST = np.array([2.6, 1.8])  # least size of a narrow room with its labels on a slide [in]
_STEPS = (1, 2, 5, 10)  # steps between ticks, times powers of ten


def plan_figure(room: Room, height: float = 1.25) -> tuple[Figure, Axes]:
    """Return a figure and axes that hold the room to scale, with `height` [in] left for a legend; slides are 16:9."""
    width, depth = np.subtract(room.interior.max, room.interior.min)[:2] + 4.0 * _FRAME
    scale = min(_LARGEST[0] / width, _LARGEST[1] / depth)
    inner = np.array([width, depth]) * scale
    whole = inner + [0.9, height]
    figure = Figure(figsize=(whole[0], whole[1]))
    axes = figure.add_axes((0.7 / whole[0], (height - 0.35) / whole[1], *(inner / whole)))
    low, high = np.array(room.interior.min[:2]) - 2.0 * _FRAME, np.array(room.interior.max[:2]) + 2.0 * _FRAME
    if for_slides():
        figure.set_size_inches(*SLIDE_SIZE)
        figure.set_dpi(SLIDE_DPI)  # the places of labels depend on the pixels
        size, place = _on_slide(inner)
        axes.set_position(place)
        walls, high = high, low + size / min(size / (high - low))
        axes.xaxis.set_major_locator(_ticks(low[0], high[0], walls[0]))
        axes.yaxis.set_major_locator(_ticks(low[1], high[1], walls[1]))
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal")
    axes.spines[:].set_visible(False)
    axes.set_xlabel("x (east) [m]")
    axes.set_ylabel("y (north) [m]")
    return figure, axes


def _ticks(low: float, high: float, wall: float) -> FixedLocator:
    """Return round ticks between the limits of an axis, none beyond the room's wall [m]."""
    ticks = MaxNLocator(8, steps=_STEPS).tick_values(low, high)
    return FixedLocator([tick for tick in ticks if low <= tick <= wall])


def _on_slide(inner: np.ndarray) -> tuple[np.ndarray, Any]:
    """Return the size [in] and the place on a slide of a room with these sides, as large as the legend allows.

    A narrow room leaves free space to the right or above, for its labels.
    """
    largest = _BESIDE if _beside(inner) else _BELOW
    size = np.maximum(inner * min(largest / inner), _LEAST)
    corner = _CORNER + [0.0, 0.0 if _beside(inner) else _LEGEND] + 0.5 * (largest - size)
    return size, (*corner / SLIDE_SIZE, *size / SLIDE_SIZE)


def _beside(sides: np.ndarray) -> bool:
    """Return whether a room with these sides is larger on a slide if the legend is beside it than below it."""
    return bool(min(_BESIDE / sides) > min(_BELOW / sides))


def draw_fabric(axes: Axes, room: Room, floor: bool = True) -> None:
    """Draw floor, outer walls, inner walls, furniture and stands."""
    low, high = np.array(room.interior.min[:2]), np.array(room.interior.max[:2])
    span = high - low
    if floor:
        axes.add_patch(Rectangle((low[0], low[1]), *span, facecolor=_FLOOR, lw=0, zorder=0))
    outer = np.array([low, [high[0], low[1]], high, [low[0], high[1]], low])
    for a, b in pairwise(outer):
        along = (b - a) / np.linalg.norm(b - a)
        out = np.array([along[1], -along[0]]) * _FRAME
        more = along * _FRAME
        axes.add_patch(Polygon([a - more, b + more, b + more + out, a - more + out], color=_WALL_EDGE, lw=0, zorder=1))
    for kind, x, y, *_, yaw in room.furniture:
        size = room.furniture_size[kind]
        corners = turned(np.array([x, y]), yaw, 0.5 * np.array(size[:2]))
        axes.add_patch(Polygon(corners, facecolor="#E9E2D6", edgecolor="#B8AD9C", lw=0.5, zorder=1.2))
    for x, y, radius, _ in room.stand_cylinders:
        axes.add_patch(Circle((x, y), radius, facecolor="#DADADA", edgecolor="#8F8F8F", lw=0.6, zorder=1.4))
    for x, y, _, yaw, half_x, half_y, _ in room.wall_boxes:
        corners = turned(np.array([x, y]), yaw, np.array([half_x, half_y]))
        axes.add_patch(Polygon(corners, facecolor=_WALL, edgecolor=_WALL_EDGE, lw=0.5, zorder=1.6))


def draw_path(axes: Axes, path: Trajectory) -> np.ndarray:
    """Draw a path with a ring at its start and a disc at its end; return points of the path in W (n x 2) [m]."""
    points = path.vector_values(np.linspace(path.start_time(), path.end_time(), 300)).T[:, :2]
    axes.plot(*points.T, color="white", lw=3.2, zorder=3.0, solid_capstyle="round")
    axes.plot(*points.T, color=_PATH, lw=1.5, zorder=3.1, solid_capstyle="round")
    axes.plot(*points[0], "o", ms=7, mfc="white", mec=_PATH, mew=1.5, zorder=3.2)
    axes.plot(*points[-1], "o", ms=7, color=_PATH, zorder=3.2)
    return np.asarray(points)


def draw_scale(axes: Axes) -> None:
    """Draw a scale bar of a round length above the axes, at their upper left corner."""
    low, high = axes.get_xlim()
    bar = max(length for length in (0.5, 1.0, 2.0, 5.0, 10.0, 20.0) if length <= max((high - low) / 5.0, 0.5))
    share = bar / (high - low)
    over = axes.transAxes + transforms.ScaledTranslation(0.0, 0.12, axes.figure.dpi_scale_trans)
    axes.plot([0.0, share], [1.0, 1.0], color=_INK, lw=2.5, transform=over, clip_on=False, solid_capstyle="butt")
    axes.text(share, 1.0, f"  {bar:g} m", transform=over, va="center", fontsize=8, color=_INK)


def draw_plan(room: Room, path: Trajectory | None, name: str | None = None) -> Figure:
    """Return the plan of a room: walls, furniture, stands, anchors with their heights, landmarks, the planned path.

    The title has `name`, or the room's name if there is none.
    """
    with mpl.rc_context(STYLE):
        figure, axes = plan_figure(room)
        draw_fabric(axes, room)
        colors = {label: _CLASS[i % len(_CLASS)] for i, label in enumerate(room.classes)}
        labels, points = [], []
        if path is not None:
            line = draw_path(axes, path)
            points += [[x, y, 3.0, 3.0] for x, y in line] + [[x, y, 9.0, 9.0] for x, y in line[[0, -1]]]
            labels += [Label(x, y, name, _PATH) for (x, y), name in zip(line[[0, -1]], ("start", "goal"), strict=True)]
        for i, (x, y, z) in enumerate(room.anchors):
            axes.plot(x, y, "^", ms=8, color=_ANCHOR, mec="white", mew=0.8, zorder=4.2)
            points.append([x, y, 10.0, 10.0])
            labels.append(Label(x, y, f"A{i}, {z:.1f} m", _ANCHOR))
        for i, landmark in enumerate(room.landmarks):
            x, y, _ = landmark.position
            axes.add_patch(Polygon(_outline(room, i), facecolor=colors[landmark.label], alpha=0.35, lw=0, zorder=3.8))
            axes.plot(x, y, "o", ms=6, color=colors[landmark.label], mec="white", mew=0.8, zorder=4.0)
            points.append([x, y, 9.0, 9.0])
            labels.append(Label(x, y, f"{i} {landmark.label}", _darker(colors[landmark.label])))
        size = np.subtract(room.interior.max, room.interior.min)
        title = f"{name or room.name}   {size[0]:.3g} x {size[1]:.3g} x {size[2]:.3g} m"
        above: Any = {"loc": "center", "pad": 18.0} if for_slides() else {"loc": "right"}  # above or beside the scale
        axes.set_title(title, fontsize=10, **above)
        draw_scale(axes)
        _add_legend(figure, room, path is not None)
        wall = np.array([[x, y, 2.0, 2.0] for x, y in _along_walls(room)])
        put_labels(axes, labels, np.vstack([np.array(points).reshape(-1, 4), wall]), 8.0 if for_slides() else 7.0)
        return figure


def _along_walls(room: Room) -> np.ndarray:
    """Return points in W on the outlines of the outer and inner walls, 0.2 m apart (n x 2) [m]."""
    low, high = np.array(room.interior.min[:2]), np.array(room.interior.max[:2])
    outlines = [turned(0.5 * (low + high), 0.0, 0.5 * (high - low) + _FRAME)]
    outlines += [turned(np.array([x, y]), yaw, np.array([a, b])) for x, y, _, yaw, a, b, _ in room.wall_boxes]
    found = []
    for corners in outlines:
        for a, b in pairwise([*corners, corners[0]]):
            found.append(np.linspace(a, b, max(int(np.linalg.norm(b - a) / 0.2), 2)))
    return np.vstack(found)


def _darker(color: str) -> str:
    r, g, b = to_rgb(color)
    return to_hex((0.7 * r, 0.7 * g, 0.7 * b))


def _outline(room: Room, i: int) -> np.ndarray:
    """Return the corners, in order, of landmark i's outline from above in W (n x 2) [m]."""
    from scipy.spatial import ConvexHull

    points = room.landmark_outlines[i][:, :2] + room.landmark_positions[i, :2]
    return np.asarray(points[ConvexHull(points).vertices])


def _add_legend(figure: Figure, room: Room, has_path: bool) -> None:
    handles: list[Any] = [Patch(facecolor=_WALL_EDGE, label="outer wall")]
    if room.walls:
        handles.append(Patch(facecolor=_WALL, edgecolor=_WALL_EDGE, label="wall"))
    if room.furniture:
        handles.append(Patch(facecolor="#E9E2D6", edgecolor="#B8AD9C", label="furniture"))
    if room.stands:
        handles.append(Line2D([], [], marker="o", ls="", ms=9, mfc="#DADADA", mec="#8F8F8F", label="stand"))
    handles.append(Line2D([], [], marker="^", ls="", ms=7, color=_ANCHOR, label="anchor, its height"))
    if room.landmarks:
        handles.append(Line2D([], [], marker="o", ls="", ms=6, color=_CLASS[0], label="landmark, its number and class"))
    if has_path:
        handles.append(Line2D([], [], color=_PATH, lw=1.5, label="planned path"))
    if for_slides() and _beside(np.subtract(room.interior.max, room.interior.min)[:2]):
        figure.legend(handles=handles, loc="center right", fontsize=8)
        return
    columns = min(len(handles), 4 if for_slides() else 7)
    figure.legend(handles=handles, loc="lower center", ncols=columns, fontsize=8, borderaxespad=0.3)


def save_plan(room: Room, path: Trajectory | None, file: Path, name: str | None = None) -> Path:
    """Draw the plan of a room to a file; see draw_plan."""
    return save_picture(draw_plan(room, path, name), file)
