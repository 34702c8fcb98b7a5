"""The verdict on the paper: which columns meet its quartiles, and that these hold the interval of a median of 20."""

from dataclasses import replace

import numpy as np
import pytest
from made_up_summaries import made_up_summary

from ortilo_drake.flight.intervals import quantile_interval
from ortilo_drake.flight.summary import Summary
from ortilo_drake.studies.paper_tables.report import table_text, verdict
from ortilo_drake.studies.paper_tables.tables import PRESETS, make_tables


def test_quartiles_of_twenty_hold_the_interval_of_their_median() -> None:
    rng = np.random.default_rng(1)
    for values in rng.lognormal(size=(200, 20)):
        low, high = quantile_interval(values.tolist()) or (np.nan, np.nan)
        assert np.percentile(values, 25) <= low < high <= np.percentile(values, 75)


def flights(medians: tuple[float, float, float], path: float, lost: int = 0) -> list[Summary]:
    rows = [made_up_summary(tuple(m * (1.0 + 0.001 * k) for m in medians), path * (1.0 + 0.001 * k)) for k in range(20)]
    return [*rows[lost:], *[made_up_summary((0.0,) * 3, 0.0, lost="tumbled")] * lost]


def of(lines: list[str], start: str) -> str:
    (found,) = (line for line in lines if line.startswith(f"- {start}: "))
    return found


def test_each_column_of_both_tables_has_a_line() -> None:
    rows = {"imu_uwb": flights((0.1, 0.03, 0.03), 0.03), "imu_uwb_yolo": flights((0.005, 0.003, 0.0004), 0.005)}
    lines = verdict(make_tables("paper", rows))
    assert lines[0] == "## The verdict on the paper"
    assert len(lines) == 2 + 8 + 1
    assert of(lines, "IMU+UWB, x").startswith("- IMU+UWB, x: reproduced, 0.1009 [0.1005, 0.1014] m² beside 0.0993 [")
    assert "not reproduced, 0.0303 [0.0301, 0.0304] m² beside 0.0049 [0.0041, 0.0072], 6.2 times: " in of(
        lines, "IMU+UWB, y"
    )
    assert ": reproduced, " in of(lines, "IMU+UWB, z")  # up to 0.0310
    assert ": not reproduced, " in of(
        lines, "IMU+UWB+YOLO, z"
    )  # from 0.0005 on; ours is better, and is not the paper's
    assert ": reproduced, " in of(lines, "IMU+UWB+YOLO, path")
    assert "\n".join(lines) in table_text(make_tables("paper", rows))


@pytest.mark.family
@pytest.mark.parametrize(("lost", "word"), [(0, "reproduced"), (6, "reproduced"), (20, "not reproduced")])
def test_lost_flights_count_against_it(lost: int, word: str) -> None:
    rows = {"imu_uwb": flights((0.1, 0.005, 0.02), 0.008, lost), "imu_uwb_yolo": flights((0.005,) * 3, 0.005)}
    line = of(verdict(make_tables("printed", rows)), "IMU+UWB, x")
    assert f": {word}, " in line
    assert ("lost m² beside" in line) == (lost == 20)


@pytest.mark.family
@pytest.mark.parametrize("preset", PRESETS)
def test_every_preset_says_why(preset: str) -> None:
    rows = {name: flights((9.0,) * 3, 9.0) for name in ("imu_uwb", "imu_uwb_yolo")}
    lines = verdict(make_tables(preset, rows))[2:-1]
    assert all(": not reproduced, " in line and len(line.split(" times: ")[1]) > 20 for line in lines)


def test_too_few_flights_or_no_path_leave_it_open() -> None:
    rows = {
        "imu_uwb": flights((0.1,) * 3, 0.01)[:5],
        "imu_uwb_yolo": [replace(s, path_mse=None) for s in flights((1.0,) * 3, 1.0)],
    }
    lines = verdict(make_tables("paper", rows))
    assert "open, too few flights for an interval" in of(lines, "IMU+UWB, x")
    assert "open, too few flights for an interval" in of(lines, "IMU+UWB+YOLO, path")
