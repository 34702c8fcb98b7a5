"""The report of a map: a summary, Sobol's indices, and a table with a row for each point."""

from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.stats import sobol_indices

from ortilo_drake.flight.intervals import Middle
from ortilo_drake.studies.maps.map_figure import best_and_worst
from ortilo_drake.studies.maps.map_flights import Map, MapPoint
from ortilo_drake.studies.maps.map_theory import MapTheory
from ortilo_drake.studies.maps.sweep import Sensitivity
from ortilo_drake.views.markdown import table
from ortilo_drake.views.numbers import count, in_its_digits, of_all_and_kept, share, with_interval


class Index(NamedTuple):
    """A figure, a setting, and the setting's indices for it [1].

    It makes the share `first` of the variance alone; the share `total` would be left if all others were held.
    """

    figure: str
    setting: str
    first: float
    total: float


def indices_of(found: Map) -> list[Index]:
    """Return the indices of the share of lost flights and of the RMS error's logarithm; none for other designs.

    By Saltelli's estimators, SciPy's. A figure that is the same everywhere has none, nor has the error where at a point
    all flights were lost.
    """
    design = found.sweep.design
    if not isinstance(design, Sensitivity):
        return []
    n, settings = design.points, list(found.sweep.axes)
    figures = {
        "share of lost flights": [row.lost / row.flights for row in found.rows],
        "logarithm of the RMS error": [np.log(row.kept_rms) if row.kept_rms else np.nan for row in found.rows],
    }
    rows = []
    for name, values in figures.items():
        f = np.array(values)
        if not np.isfinite(f).all() or np.ptp(f[: 2 * n]) == 0.0:
            continue
        parts = {"f_A": f[None, :n], "f_B": f[None, n : 2 * n], "f_AB": f[2 * n :].reshape(len(settings), 1, n)}
        result = sobol_indices(func=parts, n=n)
        first, total = np.atleast_2d(result.first_order)[0], np.atleast_2d(result.total_order)[0]
        rows += [Index(name, *of) for of in zip(settings, first.tolist(), total.tolist(), strict=True)]
    return rows


MOST_ROWS = 60  # of the report; the table of all points is a file of its own
SAID = (
    "RMS: median over flights, a lost one worse than any that was kept; all else is of the flights that were kept. In "
    "brackets 95 % intervals: Wilson's of the share lost, of medians between order statistics; [?]: too few flights."
)


def map_text(found: Map, theory: MapTheory | None = None) -> str:
    """Return the report in Markdown, with a line on what theory draws over the map."""
    rows, flights = found.rows, sum(row.flights for row in found.rows)
    lost = sum(row.lost for row in rows)
    best, worst = best_and_worst(found)
    lines = [f"# A map of {found.sweep.scenario} over {', '.join(found.sweep.axes)}", "", "## In short", ""]
    lines += [
        f"- Lost: {lost:,} of {flights:,} flights {share(lost, flights)}, at {len(rows):,} points.",
        f"- Best: {_said(best)}.",
        f"- Worst: {_said(worst)}.",
    ]
    if found.by_drake:
        lines.append(f"- Drake flew what the compiled engine does not: {found.by_drake}.")
    if theory is not None:
        lines.append(f"- {_on(theory)}.")
    lines.append("")
    if indices := indices_of(found):
        cells = [[i.figure, i.setting, f"{i.first:.2f}", f"{i.total:.2f}"] for i in indices]
        lines += ["## What each setting makes of the spread", ""]
        lines += table(["figure", "setting", "alone", "with the others"], cells)
    elif found.sweep.design.kind == "sensitivity":
        lines += ["No indices: the figures are the same everywhere, or all flights of a point were lost.", ""]
    header = [*found.sweep.axes, "lost", "RMS [m]", "middle half [m]", "farthest [m]", "NEES (3)"]
    lines += ["## Points", "", *table(header, [_cells(row) for row in rows[:MOST_ROWS]])]
    lines += [SAID, ""]
    if len(rows) > MOST_ROWS:
        lines += [f"The first {MOST_ROWS} of {len(rows)}; all of them are in map.csv.", ""]
    return "\n".join(lines)


def _on(theory: MapTheory) -> str:
    if theory.silence is not None:
        return f"No lines of theory: {theory.silence}"
    said = (
        "Dashed in the figure, by theory, where it reaches the values of the lines: "
        "the bound on the filter's mean error (expected Riccati equation), "
        "approximate, near hover"
    )
    if theory.longest is not None:
        said += f"; the share of flights with a burst longer than {theory.longest:.3g} s, fitted to this map's losses"
    return said


def _said(row: MapPoint) -> str:
    where = ", ".join(f"{key} {_number(value)}" for key, value in row.point.items())
    error = "" if row.kept_rms is None else f", RMS error {_rms(row)} m"
    return f"{where}: {count(row.lost, row.flights)} lost{error}"


def _rms(row: MapPoint) -> str:
    return of_all_and_kept(Middle(row.rms, row.rms_interval, row.kept_rms, row.kept_interval), row.lost)


def _cells(row: MapPoint) -> list[str]:
    low, high, kept = row.rms_low, row.rms_high, row.kept_rms
    half = "-"
    if low is not None and high is not None and kept is not None:
        half = " to ".join(in_its_digits(end, kept, row.kept_interval) for end in (low, high))
    figures = [
        "-" if value is None else with_interval(value, interval)
        for value, interval in ((row.farthest, row.farthest_interval), (row.nees, row.nees_interval))
    ]
    settings = [_number(value) for value in row.point.values()]
    return [*settings, count(row.lost, row.flights), _rms(row), half, *figures]


def _number(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def map_csv(found: Map) -> str:
    """Return the map as CSV, a row for each point: its settings, then its figures.

    A figure is empty where there is none, and inf where a lost flight stands.
    """
    singles = ["flights", "lost", "lost_low", "lost_high", "rms", "kept_rms", "rms_low", "rms_high", "farthest", "nees"]
    rows = []
    for row in found.rows:
        its = row.point | {name: getattr(row, name) for name in singles}
        for name in ("rms_interval", "kept_interval", "farthest_interval", "nees_interval"):
            its[f"{name}_low"], its[f"{name}_high"] = getattr(row, name) or (None, None)
        rows.append(its | {f"arrived_{sensor}": share for sensor, share in row.arrived.items()})
    return pd.DataFrame(rows, dtype=object).to_csv(index=False, lineterminator="\n")
