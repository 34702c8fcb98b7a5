"""The paper's tables in at most five lines."""

from ortilo_drake.studies.paper_tables.tables import SCENARIOS, Tables
from ortilo_drake.views.numbers import count, number, with_interval

TITLES = {"imu_uwb": "IMU+UWB", "imu_uwb_yolo": "IMU+UWB+YOLO"}


def tables_summary(tables: Tables) -> list[str]:
    """Return a summary of the tables, as Markdown's list: at most five lines, whatever stands beside the paper's.

    Args:
        tables: what make_tables returned.
    """
    lost = [f"{TITLES.get(name, name)} {count(n, tables.flights)}" for name, n in tables.lost.items()]
    lines = [f"Flights lost: {', '.join(lost)}."]
    for name in filter(tables.estimation.__contains__, SCENARIOS):
        lines.append(_medians(tables, name))
    drop = tables.drop_in_x.median
    if drop is not None:
        lines.append(f"The camera {'lowers' if drop >= 0.0 else 'raises'} that in x by {abs(drop):.0%}.")
    nees = [
        f"{TITLES.get(name, name)} {with_interval(its.value, its.interval)}"
        for name, its in tables.nees.items()
        if its.value is not None
    ]
    if nees:
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
