"""Figures: trajectories in the room, errors, arrivals."""

import io
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.patches import Circle, Patch, Polygon, Rectangle

from ortilo_drake.flight.flight import AXES, scenario_of
from ortilo_drake.flight.verdict import ending
from ortilo_drake.model.room import Room
from ortilo_drake.scenario import PositionBlackout, Scenario
from ortilo_drake.views.palette import BLUE, COLOR, ESTIMATED, GREEN, ORANGE, OTHER, PLANNED, PURPLE, SKY, STYLE, TRUE
from ortilo_drake.views.pictures import figure_to, save_picture
from ortilo_drake.views.themes import for_slides

DRAWN = ["truth", "reference", "due", "arrival"]  # variables that trajectory_figure and arrival_figure read
TITLE = {"imu_uwb": "IMU+UWB", "imu_uwb_yolo": "IMU+UWB+YOLO"}


class ShownFigure(Figure):
    """A figure that a notebook shows as the result of a cell, even without `%matplotlib inline`.

    The figure is written with its current dpi, which a theme may have set; Matplotlib would use the original dpi.
    """

    def savefig(self, fname: Any, **settings: Any) -> None:
        """Write the figure like Matplotlib's savefig."""
        if settings.get("dpi", mpl.rcParams["savefig.dpi"]) == "figure":
            settings["dpi"] = self.dpi
        super().savefig(fname, **settings)

    def _repr_png_(self) -> bytes:
        drawn = io.BytesIO()
        self.savefig(drawn, format="png", dpi="figure")
        return drawn.getvalue()


def draw_room(axes: Axes, room: Room, scenario: Scenario) -> None:
    """Draw the room from above: walls, furniture, stands, anchors, landmarks and the UWB blackouts in x."""
    solids: list[Patch] = []
    for kind, x, y, *_, yaw in room.furniture:
        corners = turned(np.array([x, y]), yaw, 0.5 * np.array(room.furniture_size[kind][:2]))
        solids.append(Polygon(corners, facecolor="#e9e2d6", edgecolor="#b8ad9c", lw=0.4, label="furniture"))
    for x, y, _, yaw, half_x, half_y, _ in room.wall_boxes:
        corners = turned(np.array([x, y]), yaw, np.array([half_x, half_y]))
        solids.append(Polygon(corners, facecolor="#b9a08c", edgecolor="#8a725f", lw=0.4, label="wall"))
    for x, y, radius, _ in room.stand_cylinders:
        solids.append(Circle((x, y), radius, facecolor="#d9d9d9", edgecolor="#999999", lw=0.4, label="stand"))
    for blackout in scenario.uwb.link.blackouts:
        if isinstance(blackout, PositionBlackout) and blackout.axis == "x":
            corner, depth = (blackout.start, room.interior.min[1]), room.interior.max[1] - room.interior.min[1]
            width = blackout.end - blackout.start
            solids.append(Rectangle(corner, width, depth, color=BLUE, alpha=0.10, lw=0, label="no UWB"))
    low, high = np.array(room.interior.min[:2]), np.array(room.interior.max[:2])
    outer: Any = {"fill": False, "edgecolor": "#8a725f", "lw": 1.5, "label": "outer wall"}
    solids.append(Rectangle((low[0], low[1]), *(high - low), **outer))
    named = set()
    for solid in solids:
        axes.add_patch(solid)
        name = str(solid.get_label())
        solid.set_label(f"_{name}" if name in named else name)
        named.add(name)
    edge: Any = {"mec": "white", "mew": 0.4, "ls": ""}
    axes.plot(*room.anchor_positions[:, :2].T, "^", color=GREEN, ms=5, label="anchor", **edge)
    axes.plot(*room.landmark_positions[:, :2].T, "*", color=PURPLE, ms=6, label="landmark", **edge)
    axes.set_xlim(room.interior.min[0] - 0.6, room.interior.max[0] + 0.6)
    axes.set_ylim(room.interior.min[1] - 0.6, room.interior.max[1] + 0.6)
    axes.set_aspect("equal")
    axes.set_xlabel("x (east) [m]")
    axes.set_ylabel("y (north) [m]")


def turned(middle: np.ndarray, yaw: float, half: np.ndarray) -> np.ndarray:
    """Return the corners (4 x 2) of a rectangle with half sides `half` (2) about a point (2), turned by a yaw [rad]."""
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * half
    R = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    return np.asarray(corners @ R.T + middle)


def thicken(legend: Legend) -> None:
    """Make the lines of a legend thick enough to tell their colours apart."""
    for line in legend.get_lines():
        line.set_linewidth(max(line.get_linewidth(), 2.0))


def trajectory_figure(flights: dict[str, list[xr.Dataset]], path: Path) -> Path:
    """Draw the true paths of flights, by scenario, and the planned path in the room (the paper's figure).

    The first flight of each scenario has a stronger line.
    """
    with figure_to(path, (11, 4.4)) as figure:
        axes = figure.add_subplot()
        first = next(iter(flights.values()))[0]
        draw_room(axes, scenario_of(first).load_room(), scenario_of(first))
        for name, rows in flights.items():
            for k, flight in reversed(list(enumerate(rows))):
                strong = k == 0
                axes.plot(
                    *flight["truth"].values[:, :2].T,
                    color=COLOR.get(name, OTHER),
                    lw=1.6 if strong else 0.5,
                    alpha=1.0 if strong else 0.35,
                    label=TITLE.get(name, name) if strong else None,
                )
        axes.plot(*first["reference"].values[:, :2].T, "k--", lw=1.0, label="desired")
        thicken(axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=5, fontsize=8))
    return path


def flight_figure(flight: xr.Dataset, path: Path) -> Path:
    """Draw one flight to a file; see draw_flight."""
    return save_picture(draw_flight(flight), path)


def draw_flight(flight: xr.Dataset) -> Figure:
    """Return a figure of one flight: its path in the room, its errors in 3-sigma bands and the arrivals over time."""
    scenario = scenario_of(flight)
    room = scenario.load_room()
    with mpl.rc_context(STYLE):
        figure = ShownFigure(figsize=(11, 8.2), layout="constrained")
        room_axes, errors, arrivals = _places(figure, room)
        draw_room(room_axes, room, scenario)
        draw_paths(room_axes, flight)
        lost = ending(flight)
        told = f": {lost}" if lost.startswith("lost") else ""
        title = room_axes.set_title(f"{scenario.name}, seed {scenario.seed}{told}")
        if told:
            title.set_color(ORANGE)
        side_by_side = for_slides() and _is_wide(room)
        beside: Any = {"loc": "center left", "bbox_to_anchor": (1.01, 0.5)}
        below: Any = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.16), "ncols": 3 if for_slides() else 9}
        thicken(room_axes.legend(fontsize=8, **(beside if side_by_side else below)))
        time = flight["time"].values
        error, sigma = position_errors(flight)
        for i, (axis, axes) in enumerate(zip(AXES, errors, strict=True)):
            axes.fill_between(time, -3 * sigma[:, i], 3 * sigma[:, i], color=SKY, alpha=0.35, lw=0, label="3 sigma")
            axes.plot(time, error[:, i], color="k", lw=0.8, label="error of the estimate")
            axes.set_ylabel(
                f"{axis} [m]" if side_by_side else f"{axis} error [m]"
            )  # the axes are low: the legend names the error
            axes.tick_params(labelbottom=side_by_side)
            if side_by_side:
                axes.set_xlabel("time [s]")
        errors[0].legend(loc="lower right", bbox_to_anchor=(1.0, 0.92), ncols=2, fontsize=8)
        draw_arrivals(arrivals, flight)
        for axes in (*errors, arrivals):
            axes.set_xlim(time[0], time[-1])
        return figure


def _is_wide(room: Room) -> bool:
    width, depth = np.subtract(room.interior.max, room.interior.min)[:2]
    return bool(width > 1.8 * depth)


def _places(figure: Figure, room: Room) -> tuple[Axes, list[Axes], Axes]:
    """Return the axes of a flight's room, of its errors (3) and of its arrivals.

    All are one below the other; on a slide, the errors are side by side below a wide room, else all are beside it.
    """
    strips: Any = {"nrows": 4, "ncols": 1, "height_ratios": [1.2, 1.2, 1.2, 0.9]}
    if for_slides() and _is_wide(room):
        halves = figure.add_gridspec(2, 1, height_ratios=[1.3, 1.0])
        strips = {"nrows": 2, "ncols": 3, "height_ratios": [1.2, 0.7]}
    elif for_slides():
        halves = figure.add_gridspec(1, 2, width_ratios=[1.2, 1.0])
    else:
        halves = figure.add_gridspec(2, 1, height_ratios=[5.0, 4.5])
    grid = halves[1].subgridspec(**strips)
    last = grid[1, :] if strips["nrows"] == 2 else grid[3]
    return figure.add_subplot(halves[0]), [figure.add_subplot(grid[i]) for i in range(3)], figure.add_subplot(last)


def position_errors(flight: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors of the estimated position and the filter's standard deviations, both in W (n x 3) [m]."""
    error = flight["estimate"].values[:, :3] - flight["truth"].values[:, :3]
    return error, np.sqrt(np.diagonal(flight["covariance"].values[:, :3, :3], axis1=1, axis2=2))


def draw_paths(axes: Axes, flight: xr.Dataset) -> None:
    """Draw the planned, true and estimated path of a flight from above [m]."""
    # From wide to thin, so that each path is visible where the paths coincide.
    axes.plot(*flight["truth"].values[:, :2].T, color=TRUE, lw=3.2, alpha=0.6, label="true")
    axes.plot(*flight["estimate"].values[:, :2].T, color=ESTIMATED, lw=1.2, label="estimated")
    axes.plot(*flight["reference"].values[:, :2].T, color=PLANNED, ls=(0, (5, 4)), lw=0.7, label="planned")


def draw_arrivals(axes: Axes, flight: xr.Dataset) -> None:
    """Draw, for each sensor except the imu, a bar while its due values were used, a thin grey bar while they missed."""
    time, own = flight["time"].values, [s for s in flight["sensor"].values if s not in ("uwb", "camera", "imu")]
    flown = [s for s in ("camera", "uwb") if flight["due"].sel(sensor=s).values.any()]
    sensors = (*own, *flown)
    for row, sensor in enumerate(sensors):
        due = flight["due"].sel(sensor=sensor).values
        used = flight["arrival"].sel(sensor=sensor).values
        t_due, t_used = time[due], time[used]
        period = float(np.median(np.diff(t_due))) if len(t_due) > 1 else 0.05
        missing = np.searchsorted(t_used, t_due) == np.searchsorted(
            t_used, t_due + 0.99 * period
        )  # no value is used until the next one is due
        for t, height, color in ((t_due[missing], 0.25, "0.75"), (t_used, 0.8, COLOR.get(sensor, OTHER))):
            axes.broken_barh(_runs(t, period), (row - 0.5 * height, height), facecolors=color, edgecolors="none")
    axes.set_yticks(range(len(sensors)), [s.replace("uwb", "UWB") for s in sensors])
    axes.set_ylim(-0.6, max(len(sensors), 1) - 0.4)
    axes.set_xlabel("time [s]  (colour: fixes used; grey: expected, but none)")


def _runs(t: np.ndarray, period: float) -> list[tuple[float, float]]:
    """Return start and length [s] of each run in ascending times (n), where each time lasts for a period [s].

    A bar for each run replaces a line for each time: hundreds of lines would make a false pattern on a screen.
    """
    if not len(t):
        return []
    cuts = np.flatnonzero(np.diff(t) > 1.5 * period)
    first, last = t[np.r_[0, cuts + 1]], t[np.r_[cuts, len(t) - 1]]
    return [(float(a), float(b - a + period)) for a, b in zip(first, last, strict=True)]


def arrival_figure(flights: dict[str, xr.Dataset], path: Path) -> Path:
    """Draw the arrivals of one flight of each scenario over time."""
    with figure_to(path, (10, 1.5 * len(flights) + 0.4)) as figure:
        for k, (name, flight) in enumerate(flights.items()):
            axes = figure.add_subplot(len(flights), 1, k + 1)
            draw_arrivals(axes, flight)
            axes.set_xlim(0, float(flight["time"].values[-1]))
            axes.set_title(f"{TITLE.get(name, name)}, seed {flight.attrs['seed']}", loc="left")
    return path
