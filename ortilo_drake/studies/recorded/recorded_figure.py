"""The figure of a recorded motion: path, errors with three standard deviations, NIS and availability."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from ortilo_drake.studies.recorded.filtered import Estimate
from ortilo_drake.studies.recorded.recorded_report import main_row
from ortilo_drake.studies.recorded.replayed import Drawn, Replayed
from ortilo_drake.views.palette import BLUE, GREEN, ORANGE, PURPLE, SKY
from ortilo_drake.views.pictures import figure_to
from ortilo_drake.views.themes import add_title, for_slides

RED, GREY = ORANGE, "#999999"
WIDEST, FARTHEST = 0.8, 0.99  # shares of the bands, and of the errors, that an axis shows whole while available
TIME = "time since the first range [s]"
BIN = 1.0  # NIS is a mean over this time [s]


def motion_figure(found: Replayed, drawn: Drawn, below: float, path: Path) -> Path:
    """Draw a motion and return the file's path; the filter is available while its deviation is below `below` [m]."""
    name = main_row(drawn)
    estimate, truth = drawn[name]
    anchors = np.array(found.anchors)
    with figure_to(path, (11, 8)) as figure:
        paths, strips, nis, last = _places(figure, 3 if truth is not None else 0)
        for axes, k in zip(paths, (1, 2), strict=False):
            if truth is not None:
                axes.plot(truth[:, 0], truth[:, k], color="0.6", lw=2.5, label="truth")
            axes.plot(estimate.p[:, 0], estimate.p[:, k], color=BLUE, lw=0.8, label=name)
            axes.plot(anchors[:, 0], anchors[:, k], "^", color=RED, ms=5, label="anchors", clip_on=False)
            axes.set_xlabel("x [m]")
            axes.set_ylabel(f"{'xyz'[k]} [m]")
            axes.set_aspect("equal", adjustable="box")
        paths[0].legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), fontsize=7, ncols=3)
        for side in paths[1:]:
            side.locator_params(axis="y", nbins=3)
        t = estimate.t
        deviations = np.sqrt(np.einsum("kii->ki", estimate.P))
        usable = np.linalg.norm(deviations, axis=1) < below
        for k, axes in enumerate(strips):
            axes.fill_between(t, -3 * deviations[:, k], 3 * deviations[:, k], color=BLUE, alpha=0.15, lw=0)
            error = (estimate.p - np.asarray(truth))[:, k]
            axes.plot(t, error, color=BLUE, lw=0.8)
            axes.set_ylabel(f"error {'xyz'[k]} [m]\nand 3 σ")
            _cut(axes, t, usable, 3.0 * deviations[:, k], error)
            _calibration(axes, found)
        if nis is None:
            strips[-1].set_xlabel(TIME)
        else:
            _draw_nis(nis, estimate)
            _calibration(nis, found)
        axes = last
        axes.set_prop_cycle(color=(GREEN, "#E69F00", PURPLE, SKY, "0.4"))
        for row, (other, _) in drawn.items():
            if row in (name, f"{name}, smoothed") or (row.startswith(name) and not for_slides()):
                total = np.sqrt(np.trace(other.P, axis1=1, axis2=2))
                main: Any = {"color": BLUE, "lw": 1.8, "zorder": 3} if row == name else {"lw": 0.9}
                axes.plot(other.t, total, label=f"{row} ({found.rows[row].available:.0%})", **main)
        axes.axhline(below, color=RED, lw=0.8, ls="--")
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.set_ylabel("σ [m], available\nbelow the line")
        axes.set_xlabel(TIME)
        said = "in brackets the share of the time in which σ is below the line"
        handles = axes.get_legend_handles_labels()
        figure.legend(
            *handles,
            loc="outside lower left" if for_slides() else "outside lower right",
            fontsize=7,
            ncols=2,
            title=said,
            title_fontsize=7,
        )
        _calibration(axes, found)
        ate = found.rows[name].ate
        rms = "" if ate is None else f", RMS error {ate:.3f} m"
        add_title(figure, f"{found.name}: {name}{rms}" + " (grey: the part that calibrates)" * _calibrates(found))
    return path


def _places(figure: Figure, errors: int) -> tuple[list[Axes], list[Axes], Axes | None, Axes]:
    """Return the axes of the path from above and from the side, of `errors` error plots, of NIS and of deviations.

    A slide with errors shows neither the path from the side nor NIS.
    """
    if for_slides() and errors:
        grid = figure.add_gridspec(6, 2, width_ratios=[1.0, 1.1])
        path, *strips, last = (
            figure.add_subplot(spot)
            for spot in (grid[:3, 0], *(grid[2 * k : 2 * k + 2, 1] for k in range(3)), grid[3:, 0])
        )
        return [path], strips, None, last
    rows = errors + 2
    grid = figure.add_gridspec(rows, 2, width_ratios=[1.0, 1.5])
    spots = [grid[: (rows + 1) // 2, 0], grid[(rows + 1) // 2 :, 0], *(grid[k, 1] for k in range(rows))]
    above, side, *strips, nis, last = map(figure.add_subplot, spots)
    return [above, side], strips, nis, last


def _draw_nis(axes: Axes, estimate: Estimate) -> None:
    """Draw the mean NIS of the ranges in each second, and the value 1 of a consistent filter."""
    taken = estimate.run.taken
    bins = np.arange(estimate.range_stamps[0], estimate.range_stamps[-1] + BIN, BIN)
    squares = estimate.run.innovation[taken] ** 2 / estimate.run.variance[taken]
    sums, _ = np.histogram(estimate.range_stamps[taken], bins, weights=squares)
    counts, _ = np.histogram(estimate.range_stamps[taken], bins)
    means = np.divide(sums, counts, out=np.full(len(counts), np.nan), where=counts > 0)  # no line without ranges
    axes.plot(bins[:-1] + BIN / 2, means, color=BLUE, lw=0.9)
    axes.axhline(1.0, color=GREY, lw=0.8)
    axes.set_ylabel("NIS")


def error_limit(usable: np.ndarray, band: np.ndarray, error: np.ndarray) -> float:
    """Return the limit of an axis of errors [m], at which they stay readable although an outage's band is far wider.

    Args:
        usable: mask of the stamps at which the filter is available (m); if it is nowhere, all stamps count.
        band: three standard deviations (m) [m].
        error: the errors (m) [m].
    """
    counted = usable if usable.any() else np.ones(len(band), dtype=bool)
    return 1.2 * float(max(np.quantile(band[counted], WIDEST), np.quantile(np.abs(error[counted]), FARTHEST)))


def _cut(axes: Axes, t: np.ndarray, usable: np.ndarray, band: np.ndarray, error: np.ndarray) -> None:
    """Limit an axis by error_limit; write above it how far band and error reach beyond, and mark such errors."""
    limit = error_limit(usable, band, error)
    farthest = np.abs(error)
    beyond = farthest > limit
    if max(band.max(), farthest.max()) <= limit:
        return
    axes.set_ylim(-limit, limit)
    said = [f"3 σ reaches ±{band.max():.2g} m"] if band.max() > limit else []
    if beyond.any():
        said.append(f"the error {farthest.max():.2g} m (orange)")
        axes.plot(t[beyond], 0.97 * limit * np.sign(error[beyond]), ".", color=RED, ms=3)
    axes.set_title(f"beyond the axis: {', '.join(said)}", loc="right", fontsize=7, pad=2)


def _calibrates(found: Replayed) -> bool:
    """Return whether the motion's first part calibrated it: with a truth, and the map's `share` above 0."""
    return found.offset is not None and bool(found.judged_from > 0.0)


def _calibration(axes: Axes, found: Replayed) -> None:
    if _calibrates(found):
        axes.axvspan(0.0, found.judged_from, color=GREY, alpha=0.15, lw=0)
    axes.margins(x=0.01)
