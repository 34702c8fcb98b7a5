"""A figure of the filter's errors beside the least that any filter could have."""

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from ortilo_drake.flight.flight import AXES
from ortilo_drake.views.blackout_figures import shade_blackouts
from ortilo_drake.views.figures import TITLE
from ortilo_drake.views.palette import BLUE, GREEN, GREY, ORANGE, STYLE

_START = 2.0  # a flight starts without error, so that the floor is 0 there and a ratio says nothing [s]


def draw_floor(flights: dict[str, Sequence[xr.Dataset]], floors: dict[str, Sequence[np.ndarray]]) -> Figure:
    """Return a figure of errors and Cramer-Rao floor over time, one row for each scenario.

    Left: the position's error, the filter's own sd and the floor [m], each the root of the sum over x, y and z. The
    floor is a wide line, so that a sd that coincides with it is seen. Right: the filter's own sd over the floor, axis
    by axis. The blackouts are those of the first flight.

    Args:
        flights: flights by scenario; they are drawn up to the end of the shortest.
        floors: what floor_at_ticks returned of each (n, 3) [m²].
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(12, 2.9 * len(flights) + 0.3), layout="constrained")
        grid = figure.subplots(len(flights), 2, squeeze=False, sharex=True, sharey="col")
        for (left, right), (name, group) in zip(grid, flights.items(), strict=True):
            n = min(flight.sizes["tick"] for flight in group)
            time = group[0]["time"].values[:n]
            errors = [f["estimate"].values[:n, :3] - f["truth"].values[:n, :3] for f in group]
            squared = np.mean(np.square(errors), axis=0)
            believed = np.mean([np.diagonal(f["covariance"].values[:n, :3, :3], 0, 1, 2) for f in group], axis=0)
            least = np.mean([floor[:n] for floor in floors[name]], axis=0)
            for axes in (left, right):
                shade_blackouts(axes, group[0])
                axes.set_title(f"{TITLE.get(name, name)}  (grey: UWB blacked out, seed {group[0].attrs['seed']})")
            whole = [np.sqrt(values.sum(axis=1)) for values in (squared, believed, least)]
            left.plot(time, whole[0], color=GREY, lw=0.8, label=f"error, RMS of {len(group)} flights")
            left.plot(time, whole[2], color=ORANGE, lw=4.5, alpha=0.45, label="Cramér-Rao floor")
            left.plot(time, whole[1], color=BLUE, lw=1.2, label="filter's own sd")
            left.set_ylabel("position [m]")
            left.set_yscale("log")
            late = time > _START
            styles = ((BLUE, "-"), (ORANGE, "--"), (GREEN, "-."))
            for axis, (color, style) in zip(AXES, styles, strict=True):
                i = AXES.index(axis)
                ratio = np.sqrt(believed[late, i] / least[late, i])
                right.plot(time[late], ratio, color=color, ls=style, lw=1.3, label=axis)
            right.axhline(1.0, color="k", lw=0.8)
            right.set_ylabel("filter's own sd / floor [-]")
        grid[0, 0].legend(loc="upper right", fontsize=8)
        grid[0, 1].legend(loc="upper right", fontsize=8, ncols=3)
        grid[0, 0].set_xlim(time[0], time[-1])
        grid[0, 0].set_ylim(5e-3, 3.0)
        grid[0, 1].set_ylim(bottom=0.0)
        for axes in grid[-1]:
            axes.set_xlabel("time [s]")
        return figure
