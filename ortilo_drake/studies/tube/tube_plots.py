"""Plots of the tube: the tube on a plan, flights in it over time, its margins over two losses."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.colors import TwoSlopeNorm
from matplotlib.contour import QuadContourSet

from ortilo_drake.studies.tube.corridor import Corridor
from ortilo_drake.studies.tube.tube import Tube
from ortilo_drake.studies.tube.tube_flights import Flown
from ortilo_drake.studies.tube.tube_map import MarginMap
from ortilo_drake.views.palette import BLUE, ORANGE, PLANNED

INSIDE: Final = "#9fd0f0"
OUTSIDE: Final = "#f3b78f"
LEVELS: Final = np.array([-2.0, -1.5, -1.0, -0.75, -0.5, -0.25, 0.0, 0.1, 0.2, 0.3, 0.4, 0.5])  # of margins [m]
_EVERY = 3  # ticks from one drawn disc to the next


def draw_tube(axes: Axes, tube: Tube, about: Corridor) -> None:
    """Draw the tube's discs along the plan from above [m]: blue within the corridor, orange where they leave it."""
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
    """Draw the horizontal deviation of flights from the plan over time [s, m], in the tube and below the corridor."""
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
    """Fill the margins [m] over (a, b) and draw where they are 0; return what a colour bar shows.

    Dotted is where they are 0 up to the last measurement of the second sensor.
    """
    norm = TwoSlopeNorm(0.0, LEVELS[0], LEVELS[-1])
    # Purple to orange through white: told apart by everyone.
    filled = axes.contourf(
        margins.a, margins.b, margins.whole.T, levels=LEVELS, cmap="PuOr_r", norm=norm, extend="both", alpha=0.85
    )
    axes.contour(margins.a, margins.b, margins.whole.T, levels=[0.0], colors="k", linewidths=2.2)
    axes.contour(margins.a, margins.b, margins.guided.T, levels=[0.0], colors="k", linewidths=1.4, linestyles=":")
    return filled
