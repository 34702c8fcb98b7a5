"""The verdict on the paper: of each column of its tables, whether its median was reproduced, and if not, why.

A column is reproduced where the 95 % intervals of both medians meet. The paper prints quartiles of 20 flights. The
interval of the median of 20 goes from the 6th to the 15th, which lie within these quartiles: they stand for it.
"""

import math
from typing import Final

from ortilo_drake.flight.flight import AXES
from ortilo_drake.studies.paper_tables.summary import TITLES
from ortilo_drake.studies.paper_tables.tables import SCENARIOS, Tables
from ortilo_drake.views.numbers import with_interval

# docs/results.md has the settings that showed it, with figures.
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
    """Return the verdict as Markdown's list, a line for each column of both tables.

    Args:
        tables: what make_tables returned.
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
