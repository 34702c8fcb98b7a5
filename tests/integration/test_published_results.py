"""The figures of docs/results.md can be flown again by anyone: rows of its first table, 200 seeds each."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binomtest, quantile_test

from ortilo_drake.flight.engine import Engine
from ortilo_drake.flight.lost import NOT_LOST
from ortilo_drake.scenario import load_scenario

RESULTS = Path(__file__).parents[2] / "docs" / "results.md"
FLIGHTS = 200
ROWS = {
    "printed_imu_uwb": "IMU+UWB, preset `printed`",
    "paper_imu_uwb": "IMU+UWB, preset `paper`",
    "nominal_imu_uwb": "IMU+UWB, preset `nominal`",
    "imu_uwb": "IMU+UWB, preset `tuned`",
    "imu_uwb_yolo": "IMU+UWB+YOLO, preset `tuned`, projected camera",
}
LARGE = 1e9  # stands for a lost flight in SciPy's test, which takes finite values


def published() -> dict[str, dict[str, str]]:
    """Return the rows of the first table by title, each by column."""
    lines = RESULTS.read_text(encoding="utf-8").splitlines()
    first = next(k for k, line in enumerate(lines) if line.startswith("| | x | y | z | path | lost |"))
    table = [line.split("|")[1:-1] for line in lines[first : lines.index("", first)]]
    head, _, *rows = [[cell.strip() for cell in row] for row in table]
    return {row[0]: dict(zip(head, row, strict=True)) for row in rows}


def agrees(cell: str, value: float, ends: tuple[float, float]) -> None:
    """Assert that a cell says a number and its interval, to half a unit of its last digit."""
    said = re.findall(r"lost|[\d.]+", cell)
    for text, number in zip(said, [value, *ends][: len(said)], strict=True):
        if text == "lost":
            assert number >= LARGE, cell
        else:
            half = 0.51 * 10.0 ** -len(text.partition(".")[2])
            assert float(text) == pytest.approx(number, abs=half), cell


@pytest.mark.long
@pytest.mark.parametrize(("scenario", "title"), ROWS.items())
def test_the_results_say_what_flies(scenario: str, title: str) -> None:
    engine = Engine(load_scenario(scenario, ("camera.kind=projected",)))
    figures = dict(zip(engine.columns, engine.figures(range(FLIGHTS)).T, strict=True))
    row, lost = published()[title], figures["cause"] != NOT_LOST
    count = int(lost.sum())
    share = binomtest(count, FLIGHTS).proportion_ci(0.95, method="wilson")
    assert row["lost"].startswith(f"{count} of {FLIGHTS} [")
    found = [float(text) for text in re.findall(r"[\d.]+", row["lost"].partition("[")[2])]
    assert found == pytest.approx([100.0 * share.low, 100.0 * share.high], abs=0.5)
    kept_row = published().get(f"{title}, the {FLIGHTS - count} kept")
    assert (kept_row is None) == (count in (0, FLIGHTS))
    for column in ("x", "y", "z", "path"):
        errors = figures["path_mse" if column == "path" else f"mse_{column}"]
        for which, values in ((row, np.where(lost, LARGE, errors)), (kept_row, errors[~lost])):
            if which is not None:
                ends = quantile_test(values).confidence_interval(0.95)
                agrees(which[column], float(np.median(values)), (float(ends.low), float(ends.high)))
    for which, values in ((row, figures["nees"]), (kept_row, figures["nees"][~lost])):
        if which is not None:
            half = 0.51 * 10.0 ** -len(which["NEES"].split()[0].partition(".")[2])
            assert float(which["NEES"].split()[0]) == pytest.approx(float(np.mean(values)), abs=half)


def test_the_verdict_is_that_of_the_table() -> None:
    """A column is reproduced where the intervals of the table meet, and each has its line."""
    rows = published()
    text = RESULTS.read_text(encoding="utf-8").partition("## The verdict on the paper")[2]
    for paper, ours in (
        ("IMU+UWB", ROWS["paper_imu_uwb"]),
        ("IMU+UWB+YOLO", "IMU+UWB+YOLO, preset `paper`, projected camera"),
    ):
        for column in ("x", "y", "z", "path"):
            (_, low, high), (_, least, most) = (
                [float(number) for number in re.findall(r"[\d.]+", rows[name][column])]
                for name in (f"{paper}, paper", ours)
            )
            meets = least <= high and low <= most
            (line,) = re.findall(rf"^\| {re.escape(paper)}, {column} \| (.*) \|$", text, re.MULTILINE)
            assert line.startswith("reproduced, " if meets else "not reproduced, ")
            assert rows[ours][column] in line
