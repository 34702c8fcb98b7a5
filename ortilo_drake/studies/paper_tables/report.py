"""The tables as text: ours with intervals, beside the paper's, with a summary and a verdict."""

import math
from functools import partial
from typing import Final

from ortilo_drake.flight.efficiency import Ratio
from ortilo_drake.flight.flight import AXES
from ortilo_drake.studies.paper_tables.tables import (
    ENOUGH_FOR_A_MEAN,
    QUANTILES,
    SCENARIOS,
    Drop,
    Interval,
    Statistics,
    Tables,
)
from ortilo_drake.views.numbers import count, number, share, table, with_interval

TITLES = {"imu_uwb": "IMU+UWB", "imu_uwb_yolo": "IMU+UWB+YOLO"}


def tables_summary(tables: Tables) -> list[str]:
    """Return a summary of the tables as a Markdown list of at most five lines, however many scenarios are beside."""
    lost = [f"{_title(name)} {count(n, tables.flights)}" for name, n in tables.lost.items()]
    lines = [f"Flights lost: {', '.join(lost)}."]
    for name in filter(tables.estimation.__contains__, SCENARIOS):
        lines.append(_medians(tables, name))
    drop = tables.drop_in_x.median
    if drop is not None:
        lines.append(f"The camera {'lowers' if drop >= 0.0 else 'raises'} that in x by {abs(drop):.0%}.")
    found = {_title(name): its for name, its in tables.nees.items() if its.value is not None}
    if nees := [f"{title} {with_interval(its.value, its.interval)}" for title, its in found.items()]:
        lines.append(f"Mean NEES of the position, 3 if the filter is consistent: {', '.join(nees)}.")
    return ["## In short", "", *(f"- {line}" for line in lines), ""]


def _medians(tables: Tables, name: str) -> str:
    axes, lost = tables.estimation[name], tables.lost[name]
    every, intervals = tables.with_lost[name], tables.with_lost_intervals[name]
    found = [with_interval(every[axis]["median"], intervals[axis]["median"]) for axis in axes]
    kept = [number(value) for its in axes.values() if (value := its["median"]) is not None]
    paper = [f"{axis['median']:.4f}" for axis in tables.paper.estimation[name].values()]
    said = f"{', '.join(found)} m² in {', '.join(axes)}"
    beside = f"kept: {', '.join(kept) or 'none'}; " if lost else ""
    return f"{TITLES[name]}, median squared error: {said} ({beside}paper: {', '.join(paper)})."


_NAME = {"mean": "mean", "median": "median", "p75": "75 %", "p25": "25 %"}


def _mean(value: float | None, interval: Interval | None, flights: int) -> str:
    return with_interval(value, interval) + (" (!)" if interval and flights < ENOUGH_FOR_A_MEAN else "")


def _ratio(ratio: Ratio, flights: int) -> str:
    return _mean(ratio.value, ratio.interval, flights)


def _title(scenario: str) -> str:
    return TITLES.get(scenario, scenario)


def _kept(tables: Tables, scenario: str) -> int:
    return tables.flights - tables.lost[scenario]


def _of_the_kept(tables: Tables, scenario: str) -> str:
    return " of the kept" if tables.lost[scenario] else ""


def _rows(tables: Tables, scenario: str, columns: dict[str, tuple[Statistics, dict[str, float] | None]]) -> list[str]:
    """Return the rows of a table, whose columns are ours and the paper's, None where the paper lacks the scenario."""
    heads = [head for name, (_, paper) in columns.items() for head in ([name, "paper"] if paper else [name])]
    kept, lost = _kept(tables, scenario), tables.lost[scenario]
    its, every = tables.intervals[scenario], tables.with_lost_intervals[scenario]
    rows = []

    def add(title: str, cells: dict[str, str], statistic: str) -> None:
        row = [title]
        for name, (_, paper) in columns.items():
            row += [cells[name], *([f"{paper[statistic]:.4f}"] if paper else [])]
        rows.append(row)

    for statistic in _NAME:
        if statistic in QUANTILES and lost:
            flown = tables.with_lost[scenario]
            cells = {name: with_interval(flown[name][statistic], every[name][statistic]) for name in columns}
            add(_NAME[statistic], cells, statistic)
        said = partial(_mean, flights=kept) if statistic == "mean" else with_interval
        cells = {name: said(ours[statistic], its[name][statistic]) for name, (ours, _) in columns.items()}
        add(_NAME[statistic] + _of_the_kept(tables, scenario), cells, statistic)
    counted = f"lost {count(lost, tables.flights)}; median and quartiles count each lost flight as worst"
    above = f"{_title(scenario)}: of {tables.flights} flights, {counted if lost else 'none was lost'}."
    return [above, "", *table([_title(scenario), *heads], rows)]


def _efficiency_rows(tables: Tables, scenario: str) -> list[str]:
    """Return the rows of a scenario's efficiencies, with a column for each axis."""
    axes, kept, lost = tables.efficiency[scenario], _kept(tables, scenario), tables.lost[scenario]
    columns, of_the_kept = list(axes.values()), _of_the_kept(tables, scenario)

    rows = []
    if lost:
        rows += [
            ["all together, lost ones up to their losses", *(_ratio(c.all_with_lost, kept + lost) for c in columns)],
            ["tick by tick, likewise", *(_ratio(c.ticks_with_lost, kept + lost) for c in columns)],
        ]
    rows += [
        [f"all together{of_the_kept}", *(_ratio(c.all, kept) for c in columns)],
        [f"tick by tick{of_the_kept}", *(_ratio(c.ticks, kept) for c in columns)],
        [f"mean{of_the_kept}", *(_mean(c.mean, c.intervals["mean"], kept) for c in columns)],
    ]
    for name in QUANTILES:
        if lost:
            cells = [with_interval(c.with_lost[name], c.with_lost_intervals[name]) for c in columns]
            rows.append([_NAME[name], *cells])
        rows.append([_NAME[name] + of_the_kept, *(with_interval(getattr(c, name), c.intervals[name]) for c in columns)])
    floors = ["none" if c.floor is None else f"{c.floor:.6f}" for c in columns]
    return table([_title(scenario), *axes], [*rows, [f"mean floor{of_the_kept} [m²]", *floors]])


def _drop(drop: Drop) -> list[str]:
    """Return the line on the camera's effect on the median in x."""
    if drop.kept is None:
        return []
    ways = [(drop.median, drop.interval), (drop.kept, drop.kept_interval)]
    said = [
        "lost" if value is None else f"{value:.1%}" + (f" [{_end(ends[0])}, {_end(ends[1])}]" if ends else " [?]")
        for value, ends in ways
    ]
    kept = f" (of the kept flights by {said[1]})" if said[0] != said[1] else ""
    return [f"- The camera lowers the median MSE in x by {said[0]}{kept}; paper 93.35 %."]


def _end(value: float) -> str:
    return "lost" if value == float("-inf") else f"{value:.1%}"


def table_text(tables: Tables) -> str:
    """Return tables I and II as Markdown, ours with 95 % intervals beside the paper's."""
    scenarios, paper = list(tables.estimation), tables.paper
    lines = [f"# The paper's tables, preset '{tables.preset}', {tables.flights} flights a scenario", ""]
    lines += tables_summary(tables)
    lines += verdict(tables)
    lines += [
        "Mean squared errors [m²] with 95 % intervals. Those of medians and quartiles are between order statistics and "
        "hold for any distribution; [?]: too few flights for one, 6 for a median, 13 for a quartile. A lost flight "
        "counts as worse than any that was kept; 'lost' stands where so many are lost that the number is of a lost "
        "flight. Means are of the flights that were kept, with bootstrap intervals; (!): too narrow to hold the true "
        f"mean in 90 % of all cases, which takes {ENOUGH_FOR_A_MEAN} flights (found with log-normal errors).",
        "",
        "## Table I: estimation error, xhat(k|k-1)",
        "",
    ]
    for scenario in scenarios:
        ours, papers = tables.estimation[scenario], paper.estimation.get(scenario, {})
        lines += _rows(tables, scenario, {a: (ours[a], papers.get(a)) for a in ours})
    lines += ["## Table II: path-following error, deviation in y at the actual x", ""]
    for scenario in scenarios:
        lines += _rows(tables, scenario, {"path": (tables.path[scenario], paper.path.get(scenario))})
    lines += ["## Efficiency: estimation error over the Cramer-Rao floor", ""]
    lines += [
        "No estimator from the same ranges, box centres and angles, and specific force and body rates where the "
        "filter reads them, has a mean squared error below the floor, on average over flights. What the scenario's "
        "truth lets differ counts as unknown; where it lets nothing differ the floor knows mass, force, torque and "
        "biases, which a filter that estimates them does not. All together: the flights' mean error over their mean "
        "floor, at best 1. Tick by tick: the mean of squared error over floor, where the blackouts count no "
        "more than the rest. Below: over single flights, whose errors come from a few blackouts, so that some are "
        "below 1.",
        "",
    ]
    for scenario in scenarios:
        lines += _efficiency_rows(tables, scenario)
    lines += ["## Beside the tables", "", *_drop(tables.drop_in_x)]
    for scenario in scenarios:
        rates = [f"{sensor} {rate:.1%}" for sensor, rate in tables.arrivals[scenario].items() if rate is not None]
        kept, lost = _kept(tables, scenario), tables.lost[scenario]
        nees = _ratio(tables.nees[scenario], kept)
        if lost:
            every = _ratio(tables.nees_with_lost[scenario], kept + lost)
            nees += f" of the kept, {every} with the lost up to their losses"
        of_all, its = tables.with_lost[scenario], tables.with_lost_intervals[scenario]
        distance = with_interval(of_all["path_distance"]["median"], its["path_distance"]["median"])
        lines.append(
            f"- {_title(scenario)}: {lost} of {tables.flights} flights lost "
            f"{share(lost, tables.flights)}, {tables.touched[scenario]} touched furniture; "
            f"fixes used: {', '.join(rates) or 'none'}; "
            f"mean position NEES {nees} (3 if consistent); "
            f"median squared distance to the path {distance} m²; flown by {tables.players[scenario]}."
        )
    return "\n".join(lines) + "\n"


# docs/results.md has the settings that showed this, with figures.
_NEAREST: Final = (
    "before a blackout the three nearest anchors have a poor geometry, and with W = I the filter follows the noise of "
    "their fixes; the paper says nothing about a disturbance"
)
_WHY: Final[dict[str, dict[tuple[str, str], str]]] = {
    "paper": {
        **dict.fromkeys((("imu_uwb", "y"), ("imu_uwb", "z"), ("imu_uwb", "path")), _NEAREST),
        ("imu_uwb_yolo", "path"): "the cause is unknown: not noise, disturbance, speed or the true velocities",
    }
}
OF_THE_PAPER: Final = ("paper", "printed")
_OF_PRESET: Final = {
    "paper": "the paper is silent on speed, disturbance and the sensors' errors, and ours differ",
    "printed": "where no fix arrives the printed integral takes in the reference itself, and the vehicle is thrown",
    "nominal": "another filter: W from the disturbance, V from each fix, estimated velocities",
    "tuned": "another filter: force, torque and lasting errors are its states",
}


def verdict(tables: Tables) -> list[str]:
    """Return the verdict on the paper as a Markdown list, a line for each column of both tables.

    A column is reproduced if the 95 % intervals of both medians overlap. The paper prints quartiles of 20 flights. The
    interval of the median of 20 goes from the 6th to the 15th, which lie within these quartiles: they stand for it.
    """
    flown = [scenario for scenario in SCENARIOS if scenario in tables.estimation]
    found = [_line(tables, scenario, axis) for scenario in flown for axis in AXES]
    found += [_line(tables, scenario, "path") for scenario in flown]
    return ["## The verdict on the paper", "", *(f"- {line}" for line in found), ""]


def _line(tables: Tables, scenario: str, column: str) -> str:
    papers = tables.paper
    its = papers.path[scenario] if column == "path" else papers.estimation[scenario][column]
    printed = f"{its['median']:.4f} [{its['p25']:.4f}, {its['p75']:.4f}]"
    ours = tables.with_lost[scenario][column]["median"]
    interval = tables.with_lost_intervals[scenario][column]["median"]
    said = f"{TITLES[scenario]}, {column}"
    if ours is None or interval is None:
        return f"{said}: open, too few flights for an interval; paper {printed}."
    beside = f"{with_interval(ours, interval)} m² beside {printed}"
    if interval[0] <= its["p75"] and its["p25"] <= interval[1]:
        return f"{said}: {'reproduced' if tables.preset in OF_THE_PAPER else 'met by another filter'}, {beside}."
    times = "" if math.isinf(ours) else f", {ours / its['median']:.2g} times"
    why = _WHY.get(tables.preset, {}).get((scenario, column)) or _OF_PRESET[tables.preset]
    return f"{said}: not reproduced, {beside}{times}: {why}."
