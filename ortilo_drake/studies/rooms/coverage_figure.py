"""The figure of a room's coverage: maps over the floor, and curves along the path."""

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator

from ortilo_drake.model.room import Room
from ortilo_drake.sensors.described import measuring
from ortilo_drake.studies.rooms.coverage import Coverage
from ortilo_drake.studies.rooms.planned_floor import ALL
from ortilo_drake.studies.rooms.room_scenario import OF_A_ROOM
from ortilo_drake.views.figures import ShownFigure
from ortilo_drake.views.palette import COLOR
from ortilo_drake.views.pictures import save_picture
from ortilo_drake.views.room_plan import STYLE, draw_fabric
from ortilo_drake.views.themes import add_title, for_slides

_LOST, _WORST = "#D00000", "#E69F00"  # colours of the worst stretch if the room loses the vehicle there, and if not
_WITHOUT = COLOR | {"altimeter": "#E69F00"}
_NOTHING = "#D9D9D9"  # colour where the ranges give no position, or nothing is in sight
_PDOP = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0, 10.0)
_WIDE = 2.5  # a room longer than this many times its width has its maps one above another
_WIDTH, _ROW = 13.0, 3.0  # width of the figure, and height of its lower rows [in]
_SLIDE_WIDTH, _SLIDE_HEIGHT = 8.6, 4.7  # width of all maps on a slide, and height of a slide without text [in]


def coverage_figure(found: Coverage, room: Room, file: Path) -> Path:
    """Draw a room's coverage to a file, see draw_coverage, and return the file's path."""
    return save_picture(draw_coverage(found, room), file)


def draw_coverage(found: Coverage, room: Room) -> Figure:
    """Return the figure with maps of anchors in sight, their dilution and landmarks in view, and the floor on the path.

    Without a camera, or in a room without landmarks, no landmarks are shown; a slide does not show them by heading.
    """
    sides = np.subtract(room.interior.max, room.interior.min)[:2]
    wide = not for_slides() and bool(sides[0] > _WIDE * sides[1])
    camera = measuring("landmarks") in found.cases and len(room.landmarks) > 0
    count = 3 if camera else 2
    rows, columns = (count, 1) if wide else (1, count)
    headings = camera and not for_slides()
    strips = (2 if headings else 1) * _ROW
    high = rows * min(max((_WIDTH / columns - 0.7) * sides[1] / sides[0] + (0.4 if wide else 1.3), 1.8), 8.0)
    with mpl.rc_context(STYLE):
        figure = ShownFigure(figsize=(_WIDTH, high + strips), layout="constrained")
        if for_slides():  # the maps get a map's height with labels, title and bar; the curves get the rest
            high = min(_SLIDE_WIDTH / columns * sides[1] / sides[0] + 1.35, 0.65 * _SLIDE_HEIGHT)
            strips = _SLIDE_HEIGHT - high
        parts: Any = figure.subfigures(2, 1, height_ratios=[high, strips])
        maps = parts[0].subplots(rows, columns, sharex=True, sharey=True).ravel()
        _draw_maps(parts[0], maps, found, room, wide)
        floor, *views = np.atleast_1d(parts[1].subplots(1 + headings, 1, sharex=True))
        _draw_floor(floor, found)
        floor.set_xlabel("" if headings else "way flown [m]")
        if headings:
            _draw_views(parts[1], views[0], found)
        of = found.room if found.scenario == OF_A_ROOM else found.scenario
        add_title(figure, f"{of}: where is the position lost?", found.answer)
        return figure


def _draw_maps(figure: Any, maps: np.ndarray, found: Coverage, room: Room, wide: bool) -> None:
    over, many = found.over_floor, max(int(found.over_floor.anchors.max()), 1)
    yaw = np.degrees(over.headings[0])
    most = max(int(over.landmarks[0].max()), 1)
    none = over.anchors == 0, ~np.isfinite(over.pdop), over.landmarks[0] == 0
    shown = (
        ("UWB anchors (▲) in sight", over.anchors, "Blues", np.arange(0.5, many + 1)),
        ("dilution of precision, PDOP", over.pdop, "YlOrRd", _PDOP),
        (f"landmarks (★) in view, heading {yaw:.0f}°", over.landmarks[0], "Purples", np.arange(0.5, most + 1)),
    )
    low, high = np.array(room.interior.min), np.array(room.interior.max)
    for axes, nothing, (title, values, colors, levels) in zip(maps, none, shown, strict=False):
        axes.add_patch(Rectangle((low[0], low[1]), *(high - low)[:2], facecolor=_NOTHING, lw=0, zorder=0))
        cmap = ListedColormap(mpl.colormaps[colors](np.linspace(0.12, 1.0, 256)))
        norm = BoundaryNorm(np.asarray(levels, dtype=float), cmap.N, extend="max" if colors == "YlOrRd" else "neither")
        shade = np.ma.masked_where(nothing | ~over.free, values)
        extent = (low[0], high[0], low[1], high[1])
        drawn = axes.imshow(
            shade, origin="lower", extent=extent, cmap=cmap, norm=norm, zorder=0.5, interpolation="nearest"
        )
        draw_fabric(axes, room, floor=False)
        placed: Any = {"mec": "white", "ls": "", "zorder": 4}
        axes.plot(*room.anchor_positions[:, :2].T, "^", ms=5, color="#0B3C6F", mew=0.6, **placed)
        if colors == "Purples" and len(room.landmarks):
            axes.plot(*room.landmark_positions[:, :2].T, "*", ms=7, color="#6A3D9A", mew=0.5, **placed)
        _draw_way(axes, found)
        axes.spines[:].set_visible(False)
        (left, bottom), (right, top) = low[:2] - 0.2, high[:2] + 0.2
        axes.set(aspect="equal", xlim=(left, right), ylim=(bottom, top), ylabel="y (north) [m]")
        seen = values[over.free]
        if colors == "Blues" and len(seen) and seen.min() == seen.max() == many:
            title += f": {many} everywhere"
        axes.set_title(title if for_slides() else f"{title}, {over.height:.2g} m high", fontsize=9)
        bar = figure.colorbar(drawn, ax=axes, pad=0.01, shrink=0.9, location="right" if wide else "bottom", aspect=25)
        if colors != "YlOrRd":
            whole = np.arange(1, (most if colors == "Purples" else many) + 1)
            bar.set_ticks(whole[:: -max(len(whole) // (4 if for_slides() else 8), 1)])  # down from the most
            bar.minorticks_off()
    for axes in maps if not wide else maps[-1:]:
        axes.set_xlabel("x (east) [m]")
    for axes in maps[1:] if not wide else ():
        axes.set_ylabel("")


def _draw_way(axes: Axes, found: Coverage) -> None:
    """Draw the path in white and black, its worst stretch in colour."""
    p, at, color = found.along.position, _in_worst(found), _worst_color(found)
    axes.plot(p[:, 0], p[:, 1], color="white", lw=3.2, zorder=4.5)
    axes.plot(p[:, 0], p[:, 1], color="k", lw=1.4, zorder=4.6)
    axes.plot(p[at, 0], p[at, 1], color=color, lw=3.0, zorder=4.7, solid_capstyle="round")
    axes.plot(*p[0, :2], "o", ms=6, mfc="white", mec="k", mew=1.3, zorder=4.8)
    axes.plot(*p[-1, :2], "o", ms=6, color="k", zorder=4.8)


def _worst_color(found: Coverage) -> str:
    return _WORST if found.cases[ALL].lost_at is None else _LOST


def _in_worst(found: Coverage) -> np.ndarray:
    """Return a mask (n) of the places along the path in the worst stretch, at least the nearest one."""
    first, last = found.worst_times
    time = found.along.time
    inside = (time >= first) & (time <= last)
    inside[np.argmin(np.abs(time - 0.5 * (first + last)))] = True
    return np.asarray(inside)


def _draw_floor(axes: Axes, found: Coverage) -> None:
    along, finding = found.along, {measuring("anchors"), measuring("landmarks")}
    for name, rows in along.floor.items():
        whole = name == ALL
        if not set(along.floor) - {ALL, name} & finding:  # the other sensors find no position, they only propagate it
            continue
        label = "all sensors" if whole else f"without {name}"
        color = "k" if whole else _WITHOUT.get(name, "#999999")
        axes.plot(along.distance[1:], rows[1:], color=color, lw=2.0 if whole else 1.2, label=label, zorder=3 + whole)
    third: Any = {"color": "#8C7B6B", "lw": 1.0, "ls": ":", "label": "three sigma of the floor reach a wall"}
    axes.plot(along.distance, along.free / 3.0, **third)
    at = np.flatnonzero(_in_worst(found))
    stretch: Any = {"color": _worst_color(found), "alpha": 0.15, "lw": 0, "label": "worst stretch"}
    axes.axvspan(along.distance[at[0]], along.distance[at[-1]], **stretch)
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.set_ylim(bottom=0.5 * max(min(np.percentile(rows, 5) for rows in along.floor.values()), 1e-6))
    axes.set_ylabel("least error [m]")
    axes.grid(alpha=0.25, which="both", lw=0.4)
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_title("Cramér-Rao floor of the position along the way", fontsize=9)
    axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.01, 0.5))


def _draw_views(figure: Any, axes: Axes, found: Coverage) -> None:
    along = found.along
    degrees = np.degrees(along.headings)
    most = max(int(along.landmarks_by_heading.max()), 1)
    half = 180.0 / len(degrees)
    cmap = mpl.colormaps["Purples"].resampled(most + 1)
    drawn = axes.pcolormesh(
        along.distance, degrees, along.landmarks_by_heading.T, cmap=cmap, vmin=-0.5, vmax=most + 0.5, shading="nearest"
    )
    axes.axhline(np.degrees(found.over_floor.headings[0]), color="k", lw=1.0, ls="--")
    limits = (-180.0 - half, 180.0 - half)
    axes.set(yticks=[-180, -90, 0, 90, 180], ylim=limits, ylabel="heading [°]", xlabel="way flown [m]")
    axes.set_title("landmarks in view by heading (dashed: the one flown)", fontsize=9)
    bar = figure.colorbar(drawn, cax=axes.inset_axes((1.02, 0.0, 0.015, 1.0)))
    bar.locator = MaxNLocator(6, integer=True)
    bar.update_ticks()
