"""The report of a map: a summary, Sobol's indices, and a table with a row for each point; and the map's theory.

If a map's axes are a link's rates and losses, theory gives lines over the flights. The filter's error: the fixed point
of the expected Riccati equation bounds the mean of P_k from above, for rates, independent losses and bursts
(studies/arrivals). Lost vehicles: let a share p of all messages be lost in bursts of the mean length L in a flight of
the duration D. It has about p D / L bursts, and each is longer than T with the probability exp(-T / L). If a flight
were lost if and only if one is longer than T,

    P(lost) = 1 - exp(-p D / L exp(-T / L)).
"""

import re
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.optimize import minimize_scalar
from scipy.stats import sobol_indices

from ortilo_drake.flight.flyable import flight_ticks
from ortilo_drake.flight.intervals import Middle
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.arrivals.arrival_map import diagonals, filter_model, link_chain
from ortilo_drake.studies.command_link.command_flights import hover_point, hover_V, learned_at
from ortilo_drake.studies.loop.hover_loop import filter_V, hover_loop
from ortilo_drake.studies.maps.map_flights import Map, MapPoint
from ortilo_drake.studies.maps.sweep import Sensitivity, scenario_at
from ortilo_drake.views.numbers import count, in_its_digits, of_all_and_kept, share, table, with_interval

_KNOWN = re.compile(r"(uwb|camera)\.link\.(rate|loss(\..+)?)")
_TWO_MODES = ("bursts", "gilbert_elliott")
MOST_MODES = 128  # most modes of a chain of arrivals; points with more are left out: rates with a long common period
_SHORTEST, _LONGEST = 0.1, 1000.0  # T [s]


class MapTheory(NamedTuple):
    """The theory at each of n points of a map; silence is None, or a line on why there is none.

    rms (n) is the root of the bound on the mean squared error of the position [m], NaN where there is none. lost (n) is
    the share of flights lost [1] for bursts, and longest the burst T that a flight survives [s], fitted to the map's
    own flights; both are None for other axes, or if no flight was lost, or all were.
    """

    rms: np.ndarray
    lost: np.ndarray | None
    longest: float | None
    silence: str | None


def lost_in_bursts(share: np.ndarray, length: np.ndarray, duration: np.ndarray | float, longest: float) -> np.ndarray:
    """Return the probability of a burst longer than T, `longest` [s], in a flight of D [s].

    A share p [1] of its messages is lost, in bursts of the mean length L [s].
    """
    return np.asarray(1.0 - np.exp(-share * duration / length * np.exp(-longest / length)))


def theory_of(found: Map) -> MapTheory:
    """Return the theory of a map."""
    nothing = np.full(len(found.rows), np.nan)
    other = [key for key in found.sweep.axes if not _KNOWN.fullmatch(key)]
    if other:
        return MapTheory(nothing, None, None, f"theory has lines for rates and losses of links, not for {other[0]}")
    try:
        scenarios = [scenario_at(found.sweep, row.point, "map") for row in found.rows]
        rms = np.array([expected_rms(scenario) for scenario in scenarios])
    except InputError as error:
        return MapTheory(nothing, None, None, f"theory says nothing of this scenario: {error}")
    lost = _fitted(found, scenarios)
    if np.isnan(rms).all() and lost is None:
        return MapTheory(rms, None, None, f"the links' rates have no common period of {MOST_MODES} ticks or fewer")
    share, longest = lost or (None, None)
    return MapTheory(rms, share, longest, None)


def expected_rms(scenario: Scenario) -> float:
    """Return the root of the bound on the trace of E[P_k] of the position, hovering [m].

    Infinity if position is never seen; NaN if the arrivals have more than MOST_MODES modes. InputError if the
    scenario's filter has no such bound.
    """
    h = scenario.h
    mapped = scenario.measurement.positions[:2]
    links = [scenario.link_of(name) if name in scenario.sensors else None for name in mapped]
    period = int(np.lcm.reduce([1 if link is None else link.every(h) for link in links]))
    modes = period * int(np.prod([2 if link is not None and link.loss.kind in _TWO_MODES else 1 for link in links]))
    if modes > MOST_MODES:
        return float("nan")
    point = hover_point(scenario)
    told = learned_at(scenario, point)
    model = filter_model(hover_loop(told), filter_V(told, hover_V(told, point)))
    return float(np.sqrt(np.sum(diagonals(model, link_chain(links[0], links[1], h)).upper[:3])))


def _fitted(found: Map, scenarios: list[Scenario]) -> tuple[np.ndarray, float] | None:
    """Return lost_in_bursts at each point and the T of the greatest likelihood.

    None if a point has no bursts, or if no flight was lost, or all were: then any T beyond some bound is as likely.
    """
    sensors = {key.split(".")[0] for key in found.sweep.axes}
    losses = [scenario.link_of(next(iter(sensors))).loss for scenario in scenarios]
    if len(sensors) != 1 or any(loss.kind != "bursts" for loss in losses):
        return None
    p, L = np.array([(loss.loss, loss.mean_length) for loss in losses if loss.kind == "bursts"]).T
    D = np.array([flight_ticks(scenario) * scenario.h for scenario in scenarios])
    lost, flights = np.array([(row.lost, row.flights) for row in found.rows]).T
    if lost.sum() in (0, flights.sum()):
        return None

    def unlikely(log_T: float) -> float:
        chance = np.clip(lost_in_bursts(p, L, D, float(np.exp(log_T))), 1e-12, 1.0 - 1e-12)
        return -float(np.sum(lost * np.log(chance) + (flights - lost) * np.log(1.0 - chance)))

    T = float(np.exp(minimize_scalar(unlikely, bounds=np.log([_SHORTEST, _LONGEST]), method="bounded").x))
    return lost_in_bursts(p, L, D, T), T


class Index(NamedTuple):
    """A figure, a setting, and the setting's Sobol indices for the figure [1].

    The setting alone causes the share `first` of the variance; the share `total` would remain if all others were fixed.
    """

    figure: str
    setting: str
    first: float
    total: float


def indices_of(found: Map) -> list[Index]:
    """Return the indices of the share of lost flights and of the RMS error's logarithm; none for other designs.

    They come from Saltelli's estimators (SciPy). A figure that is the same everywhere has none, nor has the error if
    all flights of a point were lost.
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


MOST_ROWS = 60  # most rows in the report; the table of all points is a file of its own
SAID = (
    "RMS: median over flights, a lost one worse than any that was kept; all else is of the flights that were kept. In "
    "brackets 95 % intervals: Wilson's of the share lost, of medians between order statistics; [?]: too few flights."
)


def map_text(found: Map, theory: MapTheory | None = None) -> str:
    """Return the report in Markdown, with a line on what theory draws over the map."""
    rows, flights = found.rows, sum(row.flights for row in found.rows)
    lost = sum(row.lost for row in rows)

    def badness(row: MapPoint) -> tuple[float, float]:
        return row.lost / row.flights, np.inf if row.kept_rms is None else row.kept_rms

    best, worst = min(found.rows, key=badness), max(found.rows, key=badness)
    lines = [f"# A map of {found.sweep.scenario} over {', '.join(found.sweep.axes)}", "", "## In short", ""]
    lines += [
        f"- Lost: {lost:,} of {flights:,} flights {share(lost, flights)}, at {len(rows):,} points.",
        f"- Best: {_said(best)}.",
        f"- Worst: {_said(worst)}.",
        f"- Flown by {found.flown_by}.",
    ]
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

    A figure is empty where there is none, and inf where it is that of a lost flight.
    """
    singles = ["flights", "lost", "lost_low", "lost_high", "rms", "kept_rms", "rms_low", "rms_high", "farthest", "nees"]
    rows = []
    for row in found.rows:
        its = row.point | {name: getattr(row, name) for name in singles}
        for name in ("rms_interval", "kept_interval", "farthest_interval", "nees_interval"):
            its[f"{name}_low"], its[f"{name}_high"] = getattr(row, name) or (None, None)
        rows.append(its | {f"arrived_{sensor}": share for sensor, share in row.arrived.items()})
    return pd.DataFrame(rows, dtype=object).to_csv(index=False, lineterminator="\n")
