"""Print the table of docs/unknown.md: flights under one mismatch at a time, by the ensemble engine.

    python scripts/mismatch_table.py [FLIGHTS]      # of each cell, seeds from 0; 200

A cell has the lost flights with Wilson's interval; the medians of the mean squared errors in x, y and z [m^2], a lost
flight being worse than any that was kept, with their intervals; and the mean NEES of the kept flights, then with the
lost ones up to their losses.
"""

import sys
from typing import Any, Final

import numpy as np

from ortilo_drake.flight.engine import Engine
from ortilo_drake.flight.intervals import middle_of
from ortilo_drake.flight.lost import NOT_LOST
from ortilo_drake.scenario import load_scenario
from ortilo_drake.views.numbers import count, number, table, with_interval

Settings = tuple[tuple[str, Any], ...]

BESIDE: Final = {"z_alt": 0.025, "x_dot_flow": 0.02, "y_dot_flow": 0.02}
COLUMNS: Final[dict[str, tuple[str, Settings]]] = {
    "`imu_uwb`": ("imu_uwb", ()),
    "with range finder and flow": (
        "imu_uwb",
        (
            ("sensors", ["uwb", "imu", "altimeter", "flow"]),
            ("estimator.biases.row_sd", BESIDE),
            ("estimator.biases.row_time", 5.0),
        ),
    ),
    "`imu_uwb_yolo`": ("imu_uwb_yolo", (("camera.kind", "projected"),)),
}
ANCHORS, LANDMARKS = ("truth.survey.anchors_sd", 0.05), ("truth.survey.landmarks_sd", 0.05)
BOXES, HEAVIER = ("landmark_fix.shapes", "boxes"), ("truth.vehicle.mass_factor", 1.1)
AHEAD, FORCE = ("truth.vehicle.center_of_gravity", [0.01, 0.0]), ("truth.force.mean", [0.0, 0.5, 0.0])
LEVEL, YAW = ("truth.imu.level", [np.radians(0.5).item()] * 2), ("truth.imu.yaw", np.radians(2.0).item())
ROWS: Final[dict[str, Settings]] = {
    "nothing": (),
    "mass 10 % higher": (HEAVIER,),
    "mass 10 % lower": (("truth.vehicle.mass_factor", 0.9),),
    "centre of gravity 1 cm ahead": (AHEAD,),
    "constant force 0.5 N in y": (FORCE,),
    "imu turned by 0.5 degree in roll and pitch": (LEVEL,),
    "yaw off by 2 degrees": (YAW,),
    "anchors surveyed to 5 cm": (ANCHORS,),
    "landmarks surveyed to 5 cm": (LANDMARKS,),
    "of the landmarks only the boxes known": (BOXES,),
    "all of it at once, mass higher": (HEAVIER, AHEAD, FORCE, LEVEL, YAW, ANCHORS, LANDMARKS, BOXES),
}
OF_CAMERAS: Final = (LANDMARKS, BOXES)


def cell(scenario: str, settings: Settings, flights: int) -> str:
    """Return what so many flights of a scenario with settings give."""
    engine = Engine(load_scenario(scenario, settings))
    figures = dict(zip(engine.columns, engine.figures(range(flights)).T, strict=True))
    lost = figures["cause"] != NOT_LOST
    middles = [middle_of(figures[f"mse_{axis}"][~lost].tolist(), int(lost.sum())) for axis in "xyz"]
    medians = ", ".join(with_interval(middle.median, middle.interval) for middle in middles)
    nees = [number(float(np.mean(values))) for values in (figures["nees"][~lost], figures["nees"]) if len(values)]
    return f"{count(int(lost.sum()), flights)}; {medians}; {', '.join(dict.fromkeys(nees))}"


def main(flights: int = 200) -> None:
    """Print a row at a time."""
    head, line, _ = table(["what the filter does not know", *COLUMNS], [])
    print(head, line, sep="\n")
    for name, mismatch in ROWS.items():
        cells = []
        for scenario, settings in COLUMNS.values():
            is_seen = "yolo" in scenario or not set(map(str, mismatch)) & set(map(str, OF_CAMERAS))
            cells.append(cell(scenario, (*settings, *mismatch), flights) if is_seen else "")
        print(f"| {' | '.join([name, *cells])} |", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
