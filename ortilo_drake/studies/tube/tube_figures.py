"""Figures of the tube: its margins over arrival rates and bursts, the flights that checked them, and plans."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.colors import TwoSlopeNorm
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from ortilo_drake.scenario import Scenario
from ortilo_drake.sensors.described import title_of
from ortilo_drake.studies.tube.corridor import Corridor
from ortilo_drake.studies.tube.disc_radius import THREE_SIGMA
from ortilo_drake.studies.tube.tube import NominalFlight, Tube, predict_tube
from ortilo_drake.studies.tube.tube_flights import SHARE, Flown, Point, PointResult
from ortilo_drake.studies.tube.tube_map import MarginMap, map_sensors, with_rates
from ortilo_drake.views.figures import draw_room
from ortilo_drake.views.palette import BLUE, GREEN, ORANGE, PLANNED
from ortilo_drake.views.pictures import figure_to
from ortilo_drake.views.themes import for_slides

INSIDE: Final = "#9fd0f0"
OUTSIDE: Final = "#f3b78f"
LEVELS: Final = np.array([-2.0, -1.5, -1.0, -0.75, -0.5, -0.25, 0.0, 0.1, 0.2, 0.3, 0.4, 0.5])  # of margins [m]
_EVERY = 3  # ticks between drawn discs


def draw_tube(axes: Axes, tube: Tube, about: Corridor) -> None:
    """Draw the tube's discs along the plan from above [m]: blue within the corridor, orange beyond it."""
    outside = tube.radius > about.radius
    axes.plot(*tube.r[:, :2].T, color=PLANNED, ls="--", lw=1.0, label="planned")
    for part, color, label in ((~outside, INSIDE, "tube in the corridor"), (outside, OUTSIDE, "tube beyond it")):
        size = 2.0 * tube.radius[part][::_EVERY]
        discs = EllipseCollection(
            size, size, 0.0 * size, units="xy", offsets=tube.r[part][::_EVERY, :2], offset_transform=axes.transData,
            facecolors=color, edgecolors="none", zorder=0.5,
        )  # fmt: skip
        axes.add_collection(discs)
        if part.any():
            axes.plot([], [], "o", color=color, ms=9, label=label)  # a legend draws no such collection


def draw_deviations(axes: Axes, tube: Tube, about: Corridor, flights: Sequence[Flown]) -> None:
    """Draw the horizontal deviation of flights from the plan [m] over time [s], with tube and corridor."""
    axes.fill_between(tube.time, 0, tube.radius, color=INSIDE, lw=0, label="tube")
    axes.plot(tube.time, about.radius, "k", lw=1.2, label="corridor")
    for k, flight in enumerate(flights):
        n = len(flight.deviation)
        away = np.hypot(*flight.deviation[:, :2].T)
        axes.plot(tube.time[:n], away, color=BLUE, lw=0.8, label="_" if k else "a flight")
        if flight.lost is not None:
            axes.plot(tube.time[n - 1], away[-1], "X", color=ORANGE, mec="k", ms=9, ls="", label="lost")
    axes.set_xlim(tube.time[0], tube.time[-1])
    axes.set_ylim(0.0, 1.25 * max(tube.radius.max(), about.radius.min()))
    axes.set_ylabel("deviation [m]")


def fill_margins(axes: Axes, margins: MarginMap) -> QuadContourSet:
    """Fill the margins [m] over (a, b), draw the curve where they are 0, and return the filled set for a colour bar.

    A dotted curve shows where the margins up to the second sensor's last measurement are 0.
    """
    norm = TwoSlopeNorm(0.0, LEVELS[0], LEVELS[-1])
    # Purple to orange through white: colour-blind readers can tell them apart.
    filled = axes.contourf(
        margins.a, margins.b, margins.whole.T, levels=LEVELS, cmap="PuOr_r", norm=norm, extend="both", alpha=0.85
    )
    axes.contour(margins.a, margins.b, margins.whole.T, levels=[0.0], colors="k", linewidths=2.2)
    axes.contour(margins.a, margins.b, margins.guided.T, levels=[0.0], colors="k", linewidths=1.4, linestyles=":")
    return filled


_STYLE: Any = {"font.size": 10, "axes.spines.top": False, "axes.spines.right": False, "figure.dpi": 130}
_NO_LINK = "0.9"
_MANY = 20  # fewer flights tell little about their share in the tube
_NONE = 3e-3  # where a rate of 0 is drawn on a logarithmic axis


class ChanceGrid(NamedTuple):
    """The result of tube_map.chance_map (len(a), len(b)), with its two axes a and b."""

    a: np.ndarray
    b: np.ndarray
    chance: np.ndarray


def _draw_points(axes: Axes, results: Sequence[PointResult], floor: float) -> list[Line2D]:
    """Mark the points that were flown, points below `floor` at `floor`; return the legend's entries for the marks."""
    for r in results:
        at = max(r.at[0], floor), max(r.at[1], floor)
        marker, size, color = ("o", 9, GREEN) if r.holds else ("X", 11, ORANGE)
        axes.plot(*at, marker, ms=size, mfc=color, mec="k", mew=1.0, clip_on=False, zorder=5)
        side = -1 if r.at[0] >= 0.85 else 1
        axes.annotate(
            f"{100 * r.contained:.1f} %" + (f"\n{r.lost} lost" if r.lost else ""),
            at,
            xytext=(9 * side, -9 if floor and r.at[1] >= 0.85 else 0),  # below the edge of a map of rates
            textcoords="offset points",
            ha="right" if side < 0 else "left",
            va="center",
            fontsize=7.5,
            zorder=6,
            bbox={"facecolor": "white", "alpha": 0.65, "lw": 0, "pad": 0.8},
        )
    if not results:
        return []
    n = results[0].flights
    few = f" ({n} flights are too few to refute it)" if n < _MANY else f" ({n} flights)"
    held = f"as predicted: {SHARE:.0%} of the ticks in the tube,\nnone of {n} flights lost where the tube is inside"
    return [
        Line2D([], [], ls="", marker="o", ms=8, mfc=GREEN, mec="k", label=held),
        Line2D([], [], ls="", marker="X", ms=9, mfc=ORANGE, mec="k", label=f"not as predicted{few}"),
    ]


def _draw_map(
    figure: Figure, axes: Axes, second: str, margins: MarginMap, chance: ChanceGrid, results: Sequence[PointResult],
    floor: float,
) -> None:  # fmt: skip
    """Fill the margins over (a, b), draw the boundaries and the points flown, and add a legend."""
    bar = figure.colorbar(fill_margins(axes, margins), ax=axes, pad=0.02)
    bar.set_label("smallest margin: corridor radius minus tube radius [m]")
    log, level = np.log10(np.maximum(chance.chance.T, 1e-12)), [np.log10(THREE_SIGMA)]
    axes.contour(chance.a, chance.b, log, levels=level, colors=ORANGE, linewidths=2.2, linestyles="--")
    lines = [
        Line2D([], [], color="k", lw=2.2, label="3-sigma tube just inside the corridor"),
        Line2D([], [], color="k", lw=1.4, ls=":", label=f"the same, up to the last measurement of {second}"),
        Line2D([], [], color=ORANGE, lw=2.2, ls="--", label="0.27 % outside, mixture over arrivals"),
    ]
    handles = [*lines, *_draw_points(axes, results, floor)]
    where: Any = {"loc": "outside right center"} if for_slides() else {"loc": "outside lower center", "ncols": 2}
    figure.legend(handles=handles, fontsize=8.5, frameon=False, **where)


def rates_figure(
    sensors: tuple[str, str], margins: MarginMap, chance: ChanceGrid, results: Sequence[PointResult], path: Path
) -> Path:
    """Draw the margins over the arrival rates of the map_sensors, the mixture's boundary, and the pairs flown.

    A rate of 0 is drawn at the axis.
    """
    with figure_to(path, (8.6, 6.6), _STYLE) as figure:
        axes, (first, second) = figure.add_subplot(), map(title_of, sensors)
        _draw_map(figure, axes, second, margins, chance, results, _NONE)
        for name in ("x", "y"):
            axis = getattr(axes, f"{name}axis")
            axes.set(**{f"{name}scale": "log", f"{name}lim": (_NONE, 1.0)})
            axis.set_ticks([_NONE, 0.01, 0.03, 0.1, 0.3, 1.0], ["0", "0.01", "0.03", "0.1", "0.3", "1"])
            axis.set_ticks([], minor=True)
        axes.set_xlabel(f"share of {first} messages that arrive")
        axes.set_ylabel(f"share of {second} messages that arrive")
        axes.set_title("How few measurements keep the vehicle in the corridor", fontsize=11, pad=16)
    return path


def bursts_figure(
    sensors: tuple[str, str], margins: MarginMap, chance: ChanceGrid, results: Sequence[PointResult], path: Path
) -> Path:
    """Draw the margins over the arrival rate of both sensors and the mean length of bursts, like rates_figure."""
    with figure_to(path, (8.0, 5.8), _STYLE) as figure:
        axes, (first, second) = figure.add_subplot(), map(title_of, sensors)
        axes.set_facecolor(_NO_LINK)
        axes.text(
            0.01,
            0.01,
            "grey: no such link, its good stretches\nwould be shorter than a tick",
            transform=axes.transAxes,
            fontsize=7,
        )
        _draw_map(figure, axes, second, margins, chance, results, 0.0)
        axes.set_yscale("log")
        axes.set_yticks([0.1, 0.3, 1.0, 3.0, 10.0], ["0.1", "0.3", "1", "3", "10"])
        axes.set_yticks([], minor=True)
        axes.set_xlabel(f"share of the time in which a link is good ({first} and {second} alike, independent)")
        axes.set_ylabel("mean length of a burst of losses [s]")
        axes.set_title("How long bursts may last", fontsize=11)
    return path


def plan_figure(scenario: Scenario, nominal: NominalFlight, flights: dict[Point, Sequence[Flown]], path: Path) -> Path:
    """Draw the room from above with the tube along the path and the flights, one plan for each pair of rates."""
    names = [title_of(sensor) for sensor in map_sensors(scenario)]
    with figure_to(path, (9.5, 3.6 * len(flights)), _STYLE) as figure:
        for row, (pair, flown) in enumerate(flights.items()):
            axes = figure.add_subplot(len(flights), 1, row + 1)
            draw_room(axes, scenario.load_room(), scenario)
            tube = predict_tube(with_rates(scenario, *pair), nominal)
            for r, radius in zip(tube.r[::4], tube.radius[::4], strict=True):
                axes.add_patch(Circle((r[0], r[1]), radius, facecolor=INSIDE, lw=0, zorder=0.5))
            axes.plot(*tube.r[:, :2].T, "k--", lw=1.0, zorder=3, label="planned")
            axes.plot([], [], "o", color=INSIDE, ms=9, label="3-sigma tube")
            axes.plot([], [], color=BLUE, label="a flight")
            axes.plot([], [], color=ORANGE, marker="X", mec="k", label="a lost flight")
            for flight in flown:
                n = len(flight.deviation)
                track = tube.r[:n, :2] + flight.deviation[:, :2]
                color = BLUE if flight.lost is None else ORANGE
                axes.plot(*track.T, color=color, lw=0.6, alpha=0.7, zorder=2)
                if flight.lost is not None:
                    axes.plot(*track[-1], "X", color=ORANGE, mec="k", ms=7, zorder=4)
            lost = sum(flight.lost is not None for flight in flown)
            rates = " and ".join(f"{100 * rate:g} % of the {name}" for name, rate in zip(names, pair, strict=True))
            axes.set_title(f"{rates} messages arrive: {len(flown)} flights, {lost} lost", fontsize=10)
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=5, fontsize=8, frameon=False)
    return path
