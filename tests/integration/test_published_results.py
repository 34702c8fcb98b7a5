"""The figures of docs/results.md can be flown again by anyone: both scenarios, projected camera, 20 seeds."""

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import t

from ortilo_drake.flight.flight import FlightSimulator
from ortilo_drake.flight.intervals import quantile_interval
from ortilo_drake.flight.metrics import summary
from ortilo_drake.scenario import load_scenario

RESULTS = Path(__file__).parents[2] / "docs" / "results.md"
ROWS = {"imu_uwb": "IMU+UWB, preset `tuned`", "imu_uwb_yolo": "IMU+UWB+YOLO, preset `tuned`, projected camera"}


def published(title: str) -> dict[str, str]:
    """Return a row of the first table by column."""
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in RESULTS.read_text().splitlines()]
    head = next(row for row in rows if row[1:4] == ["x", "y", "z"])
    (found,) = (row for row in rows if row and row[0] == title)
    return dict(zip(head, found, strict=True))


@pytest.mark.long
@pytest.mark.parametrize(("scenario", "title"), ROWS.items())
def test_the_results_say_what_flies(scenario: str, title: str) -> None:
    row = published(title)
    simulator = FlightSimulator(load_scenario(scenario, ("camera.kind=projected",)))
    summaries = [summary(simulator.fly(seed)) for seed in range(20)]
    kept = [s for s in summaries if s.lost is None]
    assert row["lost"] == f"{len(summaries) - len(kept)} of {len(summaries)}"
    for column in ("x", "y", "z", "path"):
        values = [float(s.path_mse or np.nan) if column == "path" else s.mse[column] for s in kept]
        said = float(row[column])
        interval = quantile_interval(values)
        assert interval is not None
        assert interval[0] - 5e-5 <= said <= interval[1] + 5e-5, column
        assert said == pytest.approx(np.median(values), rel=0.02, abs=6e-5), column  # the flights are the same bits
    nees = [s.nees for s in kept]
    spread = t.ppf(0.975, len(nees) - 1) * np.std(nees, ddof=1) / np.sqrt(len(nees))
    assert abs(float(row["NEES"]) - np.mean(nees)) <= spread
    assert float(row["NEES"]) == pytest.approx(np.mean(nees), abs=0.06)
