"""The tables as text: ours with intervals, beside the paper's."""

from ortilo_drake.studies.paper_tables.in_short import TITLES, in_short
from ortilo_drake.studies.paper_tables.tables import ENOUGH_FLIGHTS, SCENARIOS, STATISTICS, Interval, Statistics, Tables

_NAME = {"mean": "mean", "median": "median", "p75": "75 %", "p25": "25 %"}


def _mark(flights: int, statistic: str) -> str:
    return "" if flights >= ENOUGH_FLIGHTS[statistic] else " (!)"


def _cell(value: float | None, interval: Interval | None, mark: str) -> str:
    if value is None:
        return "none"
    return f"{value:.4f}" + (f" [{interval[0]:.4f}, {interval[1]:.4f}]{mark}" if interval else "")


def _shown(flights: int) -> list[str]:
    """Return the statistics that a table shows: no quartiles of fewer flights than say something of them."""
    quartiles = ("p75", "p25")
    return [s for s in STATISTICS if s not in quartiles or flights >= ENOUGH_FLIGHTS[s]]


def _title(scenario: str) -> str:
    return TITLES.get(scenario, scenario)


def _kept(tables: Tables, scenario: str) -> int:
    return tables.flights - tables.lost[scenario]


def _of_flights(tables: Tables, scenario: str) -> list[str]:
    """Return the line above a table: how many flights its numbers are of."""
    kept = _kept(tables, scenario)
    whole = "none was lost" if kept == tables.flights else f"the other {tables.flights - kept} are not counted"
    return [f"{_title(scenario)}: of {kept} flights that were not lost; {whole}.", ""]


def _rows(tables: Tables, scenario: str, columns: dict[str, tuple[Statistics, dict[str, float] | None]]) -> list[str]:
    """Return the rows of a table: its columns as ours and the paper's, None where the paper has no such scenario."""
    heads = [head for name, (_, paper) in columns.items() for head in ([name, "paper"] if paper else [name])]
    lines = [
        *_of_flights(tables, scenario),
        f"| {_title(scenario)} | " + " | ".join(heads) + " |",
        "|---" * (1 + len(heads)) + "|",
    ]
    for statistic in _shown(_kept(tables, scenario)):
        cells, mark = [], _mark(_kept(tables, scenario), statistic)
        for name, (ours, paper) in columns.items():
            cells.append(_cell(ours[statistic], tables.intervals[scenario][name][statistic], mark))
            if paper:
                cells.append(f"{paper[statistic]:.4f}")
        lines.append(f"| {_NAME[statistic]} | " + " | ".join(cells) + " |")
    return lines


def _ratio(value: float | None, interval: Interval | None, mark: str) -> str:
    if value is None:
        return "none"
    return f"{value:.2f}" + (f" [{interval[0]:.2f}, {interval[1]:.2f}]{mark}" if interval else "")


def _efficiency_rows(tables: Tables, scenario: str) -> list[str]:
    """Return the rows of a scenario's efficiency_table."""
    table, kept = tables.efficiency[scenario], _kept(tables, scenario)
    columns = list(table.values())
    lines = [f"| {_title(scenario)} | " + " | ".join(table) + " |", "|---" * (1 + len(columns)) + "|"]
    rows = {
        name: [_ratio(ratio.value, ratio.interval, _mark(kept, "mean")) for ratio in ratios]
        for name, ratios in (("all flights", [c.all for c in columns]), ("tick by tick", [c.ticks for c in columns]))
    }
    for statistic in _shown(kept):
        mark = _mark(kept, statistic)
        rows[_NAME[statistic]] = [_ratio(getattr(c, statistic), c.intervals[statistic], mark) for c in columns]
    rows["mean floor [m²]"] = ["none" if c.floor is None else f"{c.floor:.6f}" for c in columns]
    return lines + [f"| {name} | " + " | ".join(cells) + " |" for name, cells in rows.items()]


def table_text(tables: Tables) -> str:
    """Return tables I and II as Markdown, ours (bootstrap 95 % intervals) beside the paper's.

    Args:
        tables: what make_tables returned.
    """
    scenarios, paper = list(tables.estimation), tables.paper
    lines = [f"# The paper's tables, preset '{tables.preset}', {tables.flights} flights a scenario", ""]
    lines += in_short(tables)
    lines += [
        "Mean squared errors [m²] of flights not lost, with bootstrap 95 % intervals. An interval with (!) is too "
        "narrow to mean that: it takes more flights to hold the true value in 90 % of all cases, "
        f"{ENOUGH_FLIGHTS['mean']} for a mean and {ENOUGH_FLIGHTS['median']} for a median (found with "
        f"log-normal errors). Quartiles are shown of {ENOUGH_FLIGHTS['p75']} flights and more.",
        "",
    ]
    lines += ["## Table I: estimation error, xhat(k|k-1)", ""]
    for scenario in scenarios:
        ours, its = tables.estimation[scenario], paper.estimation.get(scenario, {})
        lines += [*_rows(tables, scenario, {a: (ours[a], its.get(a)) for a in ours}), ""]
    lines += ["## Table II: path-following error, deviation in y at the actual x", ""]
    for scenario in scenarios:
        columns = {"path": (tables.path[scenario], paper.path.get(scenario))}
        lines += [*_rows(tables, scenario, columns), ""]
    lines += ["## Efficiency: estimation error over the Cramer-Rao floor", ""]
    lines += [
        "No estimator from the same ranges, box centres and angles, and specific force and body rates where the "
        "filter reads them, has a mean squared error below the floor, on average over flights. What the scenario's "
        "truth lets differ counts as unknown; where it lets nothing differ the floor knows mass, force, torque and "
        "biases, which a filter that estimates them does not. All flights: their mean error over their mean floor, "
        "at best 1. Tick by tick: the mean of squared error over floor, where the blackouts count no "
        "more than the rest. Below: over single flights, whose errors come from a few blackouts, so that some are "
        "below 1.",
        "",
    ]
    for scenario in scenarios:
        lines += [*_efficiency_rows(tables, scenario), ""]
    lines += ["## Beside the tables", ""]
    drop = tables.drop_in_x
    if drop is not None:
        low, high = drop.interval
        mark = _mark(min(_kept(tables, scenario) for scenario in SCENARIOS), "median")
        lines.append(
            f"- The camera lowers the median MSE in x by {drop.median:.1%} [{low:.1%}, {high:.1%}]{mark}; "
            "paper 93.35 %."
        )
    for scenario in scenarios:
        rates = [f"{sensor} {rate:.1%}" for sensor, rate in tables.arrivals[scenario].items() if rate is not None]
        nees = tables.nees[scenario]
        distance = tables.path_distance[scenario]["median"]
        lines.append(
            f"- {_title(scenario)}: {tables.lost[scenario]} of {tables.flights} flights lost, "
            f"{tables.touched[scenario]} touched furniture; fixes used of due: {', '.join(rates) or 'none'}; "
            f"mean position NEES {'none' if nees is None else format(nees, '.2f')} (3 if consistent); "
            f"median squared distance to the path {_cell(distance, None, '')} m²; flown by {tables.players[scenario]}."
        )
    return "\n".join(lines) + "\n"
