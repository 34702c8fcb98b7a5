"""Figures of a flight with UWB blackouts: errors over time, fixes and errors along x."""

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ortilo_drake.flight.blackouts import in_blackout
from ortilo_drake.flight.flight import AXES, scenario_of
from ortilo_drake.scenario import InputError, PositionBlackout, Scenario
from ortilo_drake.views.figures import ShownFigure, position_errors
from ortilo_drake.views.palette import COLOR, ESTIMATED, GREY, OTHER, SHADE, STYLE

_STEP = 0.5  # width of the bins along x [m]
_LEAST = 1e-3  # smallest error that is drawn [m]


def shade_blackouts(axes: Axes, flight: xr.Dataset) -> None:
    """Shade the times [s] at which the true vehicle was in a UWB blackout."""
    dark = in_blackout(flight["truth"].values, scenario_of(flight))
    across = axes.get_xaxis_transform()
    axes.fill_between(flight["time"].values, 0, 1, where=dark.tolist(), color=SHADE, lw=0, transform=across, zorder=0)


def shade_blackouts_along_x(axes: Axes, scenario: Scenario) -> None:
    """Shade the ranges of x [m] in which UWB is blacked out."""
    for blackout in scenario.uwb.link.blackouts:
        if isinstance(blackout, PositionBlackout) and blackout.axis == "x":
            axes.axvspan(blackout.start, blackout.end, color=SHADE, lw=0, zorder=0)


def draw_blackout_errors(flights: dict[str, xr.Dataset], axis: str = "x") -> Figure:
    """Return a figure of each flight's error and the filter's standard deviation over time [m].

    `flights` has the flights by title, one per row of the figure; `axis` is 'x', 'y' or 'z' of W. InputError if not.
    """
    if axis not in AXES:
        raise InputError(f"axis: {axis!r}: must be one of {', '.join(AXES)}")
    i = AXES.index(axis)
    with mpl.rc_context(STYLE):
        figure = ShownFigure(figsize=(11, 2.1 * len(flights) + 0.4), layout="constrained")
        rows = figure.subplots(len(flights), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
        for axes, (title, flight) in zip(rows, flights.items(), strict=True):
            time = flight["time"].values
            error, sd = position_errors(flight)
            shade_blackouts(axes, flight)
            axes.plot(time, np.abs(error[:, i]), color=GREY, lw=0.9, label=f"|error in {axis}|")
            axes.plot(time, sd[:, i], color=ESTIMATED, lw=1.5, label="filter's sd")
            axes.set_title(title, loc="left")
            axes.set_ylabel(f"{axis} [m]")
            axes.set_xlim(time[0], time[-1])
        rows[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
        rows[-1].set_xlabel("time [s]  (grey: UWB blacked out)")
        return figure


def availability(flight: xr.Dataset, sensor: str, edges: np.ndarray) -> np.ndarray:
    """Return the share of a sensor's due values that were used, in each bin of the true x (n); NaN where none was due.

    `edges` are the edges of the bins along x [m] (n + 1). A late value counts in the bin where the vehicle is when the
    value is used.
    """
    scenario = scenario_of(flight)
    late = scenario.camera.latency if sensor == "camera" else 0
    due = np.zeros(flight.sizes["tick"], dtype=bool)
    due[late:] = flight["due"].sel(sensor=sensor).values[: len(due) - late]
    x = flight["truth"].values[:, 0]
    used = flight["arrival"].sel(sensor=sensor).values & due
    taken, asked = (np.histogram(x[chosen], edges)[0] for chosen in (used, due))
    return np.where(asked > 0, taken / np.maximum(asked, 1), np.nan)


def draw_availability(flight: xr.Dataset) -> Figure:
    """Return a figure along the true x [m]: the error of each camera fix, and the share of due fixes used by sensor."""
    scenario = scenario_of(flight)
    x = flight["truth"].values[:, 0]
    edges = np.arange(np.floor(x.min()), np.ceil(x.max()) + _STEP, _STEP)
    with mpl.rc_context(STYLE):
        figure = ShownFigure(figsize=(10, 4.8), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True)
        for axes in (above, below):
            shade_blackouts_along_x(axes, scenario)
        if "camera" in scenario.sensors:
            there = flight["arrival"].sel(sensor="camera").values
            rows = scenario.measurement.rows_of("camera")
            fix = flight["measurement"].values[there][:, rows][:, :3]
            error = np.linalg.norm(fix - flight["truth"].values[there, :3], axis=1)
            above.semilogy(x[there], np.maximum(error, _LEAST), ".", ms=3, color=COLOR["camera"], label="a camera fix")
            above.legend(loc="lower right")
        above.set_ylabel("error of a fix [m]")
        for sensor, name in (("camera", "camera"), ("uwb", "UWB")):
            if sensor in scenario.sensors:
                share = availability(flight, sensor, edges)
                fill = sensor == "camera"
                below.stairs(
                    share, edges, fill=fill, alpha=0.5 if fill else 1.0, lw=1.5,
                    color=COLOR.get(sensor, OTHER), label=name,
                )  # fmt: skip
        below.set_ylim(0.0, 1.05)
        below.set_ylabel("share of due fixes used [-]")
        below.set_xlabel("x (east) [m]  (grey: UWB blacked out)")
        below.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
        return figure


def draw_errors_along_x(flights: dict[str, xr.Dataset]) -> Figure:
    """Return a figure of the distance from estimate to truth [m] along the true x [m].

    `flights` has the flights by label; the blackouts of the first flight are shaded.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(10, 2.8), layout="constrained")
        axes = figure.subplots()
        shade_blackouts_along_x(axes, scenario_of(next(iter(flights.values()))))
        for label, flight in flights.items():
            color = COLOR["imu_uwb_yolo"] if "camera" in scenario_of(flight).sensors else COLOR["imu_uwb"]
            error = np.maximum(np.linalg.norm(position_errors(flight)[0], axis=1), _LEAST)
            axes.semilogy(flight["truth"].values[:, 0], error, color=color, lw=1.0, label=label)
        axes.set_xlabel("x (east) [m]  (grey: UWB blacked out)")
        axes.set_ylabel("error of the estimate [m]")
        axes.legend(loc="upper right")
        return figure
