"""Figures of consistency: NEES over time, innovations, a tuning, and errors beside their floor."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from ortilo_drake.flight.blackouts import in_blackout
from ortilo_drake.flight.flight import AXES, scenario_of
from ortilo_drake.flight.metrics import position_nees
from ortilo_drake.sensors.described import described, title_of
from ortilo_drake.studies.consistency.consistency_flights import ConsistencyReport, finite_part
from ortilo_drake.studies.tuning.tune import Tuning
from ortilo_drake.theory.consistency.consistency import average_band, ensemble_average
from ortilo_drake.views.blackout_figures import shade_blackouts
from ortilo_drake.views.figures import TITLE
from ortilo_drake.views.palette import BLUE, GREEN, GREY, ORANGE, SKY, STYLE
from ortilo_drake.views.pictures import figure_to

_SMALLEST_P = 1e-16  # smallest p that is shown as a number


def _draw_nees(axes: Axes, flights: Sequence[xr.Dataset]) -> None:
    """Draw the flights' average NEES of position at each tick, its 95 % band and the share of flights in a blackout."""
    whole = [finite_part(flight) for flight in flights]
    average, count = ensemble_average([position_nees(flight) for flight in whole])
    time = np.arange(len(average)) * scenario_of(flights[0]).h
    low, high = average_band(3, count)
    black = np.zeros(len(average))
    for flight in whole:
        here = in_blackout(flight["truth"].values, scenario_of(flight))
        black[: len(here)] += here
    axes.fill_between(time, low, high, color=SKY, alpha=0.4, lw=0, label="95 % band if consistent")
    axes.plot(time, np.maximum(average, 1e-4), color="k", lw=0.9, label=f"mean of {len(flights)} flights")
    axes.axhline(3.0, color=BLUE, lw=0.8, ls="--", label="3, its mean if consistent")
    axes.set_yscale("log")
    # The bar below the curve shows the share of flights in a UWB blackout, dark where it is all of them.
    bar = axes.inset_axes((0.0, 0.0, 1.0, 0.035))
    bar.imshow((black / count)[np.newaxis], aspect="auto", cmap="Greys", vmin=0.0, vmax=1.0)
    bar.set_axis_off()
    shown = average[time > 1.0] if time[-1] > 1.0 else average
    limits = min(0.5, 0.5 * max(float(np.nanmin(shown)), 1e-3)), max(20.0, 1.5 * float(np.nanmax(average)))
    axes.set(xlim=(0.0, time[-1]), ylim=limits, ylabel="NEES of position [-]")


def nees_figure(flights: dict[str, list[xr.Dataset]], path: Path) -> Path:
    """Draw the average NEES of position over time with its band, one row for each scenario."""
    with figure_to(path, (10, 2.4 * len(flights) + 0.7)) as figure:
        for k, (name, rows) in enumerate(flights.items()):
            axes = figure.add_subplot(len(flights), 1, k + 1)
            _draw_nees(axes, rows)
            bar = "bar below: share of flights in a UWB blackout, none white, all black"
            axes.set_title(f"{TITLE.get(name, name)}  ({bar})", loc="left")
        figure.axes[-1].set_xlabel("time [s]")
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8)
    return path


def whiteness_figure(reports: dict[str, ConsistencyReport], path: Path) -> Path:
    """Draw the autocorrelation of the normalised innovations, a row for each scenario, a column for each sensor."""
    sensors = list(dict.fromkeys(s for report in reports.values() for s in report.whiteness))
    with figure_to(path, (3.4 * len(sensors) + 0.4, 2.2 * len(reports) + 0.5)) as figure:
        grid = figure.subplots(len(reports), len(sensors), squeeze=False, sharex=True)
        for row, (name, report) in zip(grid, reports.items(), strict=True):
            for axes, sensor in zip(row, sensors, strict=True):
                found = report.whiteness.get(sensor)
                if found is None:
                    axes.set_axis_off()
                    continue
                lagged = found.lag_arrivals
                lags = np.arange(1, len(lagged.r) + 1)
                m = max(len(value) for value in lagged.r if value is not None)
                r = np.array([value or [np.nan] * m for value in lagged.r], dtype=float)
                band = np.array(lagged.band, dtype=float)
                axes.fill_between(lags, -band, band, color="0.8", lw=0)
                axes.axhline(0.0, color="k", lw=0.6)
                for i, colour in zip(range(min(m, 3)), (BLUE, ORANGE, GREEN), strict=False):
                    label = (described(sensor).components or "123")[i]
                    axes.plot(lags + 0.16 * (i - 1), r[:, i], "o", ms=3, color=colour, label=label)
                axes.set_ylim(min(-0.15, 1.1 * float(np.nanmin(r))), max(0.15, 1.1 * float(np.nanmax(r))))
                p = f"= {lagged.p_value:.2g}" if lagged.p_value >= _SMALLEST_P else f"< {_SMALLEST_P:g}"
                axes.set_title(f"{TITLE.get(name, name)}: {title_of(sensor)}, p {p}", fontsize=8)
        for axes in grid[-1]:
            axes.set_xlabel("lag [arrivals]")
            axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        for row in grid:
            row[0].set_ylabel("autocorrelation [-]")
        for axes in grid[0]:
            if axes.axison:
                axes.legend(fontsize=7, ncols=3, loc="upper right")
    return path


def tuning_figure(tuning: Tuning, path: Path) -> Path:
    """Draw the effect of a tuning: the numbers with their 95 % intervals, NEES by region and NIS by sensor."""
    with figure_to(path, (11, 0.32 * len(tuning.numbers) + 2.2)) as figure:
        numbers, nees, nis = figure.subplots(1, 3, width_ratios=[1.7, 1.2, 1.0])
        for row, number in enumerate(tuning.numbers.values()):
            ratio = number.after / number.before
            error = 1.96 * (number.robust_error or number.standard_error or 0.0) / number.before
            colour = "0.6" if number.stays else ORANGE
            low = max(ratio - error, 0.02 * ratio)  # the axis is logarithmic
            numbers.plot([low, ratio + error], [row, row], color=colour, lw=1.5)
            numbers.plot(ratio, row, "o", color=colour, ms=5)
        numbers.axvline(1.0, color=BLUE, lw=1.0, ls="--")
        numbers.set_xscale("log")
        numbers.xaxis.set_major_locator(LogLocator(subs=(1.0, 1.5, 2.0, 3.0, 5.0), numticks=6))
        numbers.xaxis.set_major_formatter("{x:g}")
        numbers.xaxis.set_minor_formatter(NullFormatter())
        names = [name.replace("multilateration", "multilat") for name in tuning.numbers]
        numbers.set_yticks(range(len(names)), names)
        numbers.invert_yaxis()
        numbers.set_xlabel("fitted / before [-], 95 % interval (grey: stays)")
        for axes, title, kind in ((nees, "NEES of position", "nees"), (nis, "NIS", "nis")):
            names = [name for name, found in getattr(tuning.before, kind).items() if found]
            for shift, colour, label in ((-0.15, BLUE, "before"), (0.15, ORANGE, "after")):
                figures = getattr(getattr(tuning, label), kind)
                for i, found in enumerate(figures[name] for name in names):
                    if found is None:
                        continue
                    low, high = found.interval or (found.mean, found.mean)
                    axes.plot([i + shift] * 2, [max(low, 0.02 * found.mean), high], color=colour, lw=1.5)
                    axes.plot(i + shift, found.mean, "o", color=colour, ms=5, label=label if i == 0 else None)
            axes.axhline(3.0, color="k", lw=0.8, ls="--")
            axes.set_yscale("log")
            axes.set_xticks(range(len(names)), names, rotation=30, ha="right")
            axes.set_title(f"{title} (3 if consistent)", fontsize=9)
            axes.legend(fontsize=8)
        figure.suptitle(f"{tuning.scenario}: fitted to {len(tuning.flights)} flights", fontsize=10)
    return path


_START = 2.0  # a flight starts without error, so that the floor is 0 there and a ratio says nothing [s]


def draw_floor(flights: dict[str, Sequence[xr.Dataset]], floors: dict[str, Sequence[np.ndarray]]) -> Figure:
    """Return a figure of errors and their floors (n, 3) [m²], as of floor_at_ticks, over time, a row for each scenario.

    Left: the position's error, the filter's own sd and the floor [m], each the root of the sum over x, y and z. The
    floor is a wide line, so that a sd that coincides with it is seen. Right: the filter's own sd over the floor, axis
    by axis. The blackouts are those of the first flight; flights are drawn up to the end of the shortest.
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
            left.set(ylabel="position [m]", yscale="log")
            late = time > _START
            ratio = np.sqrt(believed[late] / least[late])
            for i, (axis, color, style) in enumerate(zip(AXES, (BLUE, ORANGE, GREEN), ("-", "--", "-."), strict=True)):
                right.plot(time[late], ratio[:, i], color=color, ls=style, lw=1.3, label=axis)
            right.axhline(1.0, color="k", lw=0.8)
            right.set_ylabel("filter's own sd / floor [-]")
        grid[0, 0].legend(loc="upper right", fontsize=8)
        grid[0, 1].legend(loc="upper right", fontsize=8, ncols=3)
        grid[0, 0].set(xlim=(time[0], time[-1]), ylim=(5e-3, 3.0))
        grid[0, 1].set_ylim(bottom=0.0)
        for axes in grid[-1]:
            axes.set_xlabel("time [s]")
        return figure
