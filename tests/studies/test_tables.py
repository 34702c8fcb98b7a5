"""The paper's tables beside ours, against the printed numbers and plain statistics."""

import itertools
import json
import statistics as stdlib
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from made_up_summaries import made_up_summary

from ortilo_drake.flight.efficiency import Ratio
from ortilo_drake.flight.summary import Summary
from ortilo_drake.model.as_data import as_data
from ortilo_drake.studies.paper_tables.report import table_text
from ortilo_drake.studies.paper_tables.tables import (
    ENOUGH_FLIGHTS,
    PAPER,
    STATISTICS,
    bootstrap_interval,
    drop_in_x,
    make_tables,
    statistics,
)

# Tables I and II as the paper prints them, row by row: mean, median, 75 %, 25 %.
PRINTED_ESTIMATION = {
    "mean": ((0.0920, 0.0071, 0.0226), (0.0120, 0.0412, 0.0173)),
    "median": ((0.0993, 0.0049, 0.0179), (0.0066, 0.0032, 0.0120)),
    "p75": ((0.1210, 0.0072, 0.0310), (0.0082, 0.0103, 0.0277)),
    "p25": ((0.0673, 0.0041, 0.0028), (0.0037, 0.0020, 0.0005)),
}
PRINTED_PATH = {"mean": (0.0098, 0.0101), "median": (0.0080, 0.0052), "p75": (0.0096, 0.0066), "p25": (0.0071, 0.0046)}
NAMES = ("imu_uwb", "imu_uwb_yolo")


def random_summaries(seed: int, n: int = 20) -> list[Summary]:
    rng = np.random.default_rng(seed)
    return [made_up_summary(tuple(rng.gamma(2.0, 0.01, 3)), float(rng.gamma(2.0, 0.01))) for _ in range(n)]


@pytest.mark.parametrize("statistic", STATISTICS)
def test_the_papers_numbers_are_those_it_prints(statistic: str) -> None:
    for column, name in enumerate(NAMES):
        ours = tuple(PAPER.estimation[name][axis][statistic] for axis in "xyz")
        assert ours == PRINTED_ESTIMATION[statistic][column]
        assert PAPER.path[name][statistic] == PRINTED_PATH[statistic][column]


def test_the_papers_headline_follows_from_its_medians() -> None:
    found = drop_in_x([0.0993] * 3, [0.0066] * 3)
    assert found is not None
    assert round(100.0 * found.median, 2) == 93.35
    assert found.interval == pytest.approx([found.median] * 2)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 7, 20])
def test_statistics_agree_with_pythons_own(n: int) -> None:
    values = np.random.default_rng(n).gamma(2.0, 0.01, n).tolist()
    found = statistics(values)
    assert found["mean"] == pytest.approx(stdlib.fmean(values))
    assert found["median"] == pytest.approx(stdlib.median(values))
    if n > 1:
        low, _, high = stdlib.quantiles(values, n=4, method="inclusive")
        assert (found["p25"], found["p75"]) == (pytest.approx(low), pytest.approx(high))


def test_no_values_have_no_statistics() -> None:
    assert statistics([]) == dict.fromkeys(("mean", "median", "p75", "p25"))
    assert bootstrap_interval([0.1], "mean") is None
    assert drop_in_x([0.1], [0.1, 0.2]) is None
    assert drop_in_x([0.1, 0.2], []) is None


def plain_bootstrap(values: np.ndarray, function: Callable[[np.ndarray], float], draws: int = 20_000) -> np.ndarray:
    rng = np.random.default_rng(7)
    return np.array([function(values[rng.integers(0, len(values), len(values))]) for _ in range(draws)])


@pytest.mark.parametrize("statistic", ["mean", "median", "p75"])
def test_an_interval_is_the_percentile_bootstraps(statistic: str) -> None:
    values = np.random.default_rng(3).gamma(2.0, 0.01, 20)
    function = {"mean": np.mean, "median": np.median, "p75": lambda v: np.quantile(v, 0.75)}[statistic]
    drawn = plain_bootstrap(values, function, 4000)
    found = bootstrap_interval(values.tolist(), statistic)
    assert found is not None
    # Four sd of a 2.5 % quantile's own error from 4,000 draws.
    np.testing.assert_allclose(found, np.quantile(drawn, [0.025, 0.975]), atol=4.0 * 0.042 * drawn.std())
    assert bootstrap_interval(values.tolist(), statistic) == found  # nothing drawn afresh


def test_the_drops_interval_resamples_both_ensembles() -> None:
    rng = np.random.default_rng(4)
    without, with_camera = rng.gamma(4.0, 0.02, 20), rng.gamma(4.0, 0.004, 20)
    found = drop_in_x(without.tolist(), with_camera.tolist())
    assert found is not None
    assert found.median == pytest.approx(1.0 - np.median(with_camera) / np.median(without))
    drawn = [
        1.0 - np.median(with_camera[rng.integers(0, 20, 20)]) / np.median(without[rng.integers(0, 20, 20)])
        for _ in range(4000)
    ]
    np.testing.assert_allclose(found.interval, np.quantile(drawn, [0.025, 0.975]), atol=4.0 * 0.042 * np.std(drawn))


def test_tables_have_the_statistics_of_every_column() -> None:
    summaries = {name: random_summaries(seed) for seed, name in enumerate(NAMES)}
    found = make_tables("tuned", summaries)
    assert found.preset == "tuned"
    assert found.flights == 20
    assert found.lost == {"imu_uwb": 0, "imu_uwb_yolo": 0}
    for name, axis in itertools.product(NAMES, "xyz"):
        values = [s.mse[axis] for s in summaries[name]]
        low, _, high = stdlib.quantiles(values, n=4, method="inclusive")
        expected = {"mean": stdlib.fmean(values), "median": stdlib.median(values), "p75": high, "p25": low}
        assert found.estimation[name][axis] == pytest.approx(expected)
    for name in NAMES:
        assert found.path[name]["median"] == pytest.approx(stdlib.median(s.path_mse for s in summaries[name]))
    assert json.loads(json.dumps(as_data(found), allow_nan=False))["estimation"] == found.estimation


def test_lost_flights_are_counted_and_left_out_of_every_average() -> None:
    good = {name: random_summaries(seed, 8) for seed, name in enumerate(NAMES)}
    bad = made_up_summary((1e9, 1e9, 1e9), 1e9, lost="hit a wall", touched=("chair",))
    mixed = {"imu_uwb": [bad, *good["imu_uwb"], bad], "imu_uwb_yolo": [*good["imu_uwb_yolo"], bad, bad]}
    found, expected = make_tables("tuned", mixed), make_tables("tuned", good)
    assert found.lost == {"imu_uwb": 2, "imu_uwb_yolo": 2}
    assert found.flights == 10
    assert replace(found, lost=expected.lost, flights=expected.flights) == expected


def test_touched_furniture_is_counted_but_not_left_out() -> None:
    rows = [made_up_summary((k / 10.0,) * 3, touched=("chair",) * (k % 2)) for k in (1, 2, 3, 4, 6)]
    found = make_tables("paper", dict.fromkeys(NAMES, rows))
    assert found.touched == {"imu_uwb": 2, "imu_uwb_yolo": 2}
    assert found.estimation["imu_uwb"]["x"]["mean"] == pytest.approx(0.32)


@pytest.mark.parametrize("n", [1, 2])
def test_tables_of_flights_that_are_all_lost_have_no_numbers_but_a_text(n: int) -> None:
    found = make_tables("paper", {name: [made_up_summary((1.0,) * 3, lost="tumbled")] * n for name in NAMES})
    assert found.drop_in_x is None
    assert found.estimation["imu_uwb"]["x"] == dict.fromkeys(STATISTICS)
    assert f"{n} of {n} flights lost" in table_text(found)


def test_tables_of_a_path_without_the_authors_error_have_none_there() -> None:
    found = make_tables("tuned", {name: [made_up_summary((0.1,) * 3, path=None)] * 2 for name in NAMES})
    assert found.path["imu_uwb"] == dict.fromkeys(STATISTICS)
    assert "| mean | none | 0.0098 |" in table_text(found)


def test_the_text_shows_ours_beside_the_papers() -> None:
    found = make_tables("tuned", {name: random_summaries(seed) for seed, name in enumerate(NAMES)})
    text = table_text(found)
    for name, axis, statistic in itertools.product(NAMES, "xyz", STATISTICS):
        assert f"{found.estimation[name][axis][statistic]:.4f} [" in text
        assert f"| {PAPER.estimation[name][axis][statistic]:.4f} |" in text
    assert "paper 93.35 %" in text


@pytest.mark.parametrize(("statistic", "true"), [("mean", np.exp(0.5)), ("median", 1.0), ("p75", np.exp(0.67449))])
def test_from_enough_flights_on_an_interval_holds_the_true_value_in_nine_of_ten(statistic: str, true: float) -> None:
    enough, rng = ENOUGH_FLIGHTS[statistic], np.random.default_rng(5)

    def coverage(flights: int, ensembles: int = 400) -> float:
        values = rng.lognormal(size=(ensembles, flights))
        drawn = values[np.arange(ensembles)[:, None, None], rng.integers(0, flights, (ensembles, 500, flights))]
        function = {"mean": np.mean, "median": np.median, "p75": lambda v, axis: np.percentile(v, 75, axis=axis)}
        low, high = np.percentile(function[statistic](drawn, axis=2), [2.5, 97.5], axis=1)
        return float(np.mean((low <= true) & (true <= high)))

    # The share of 400 has a standard deviation of 0.015.
    assert coverage(enough) > 0.90 - 3.0 * 0.015
    assert coverage(enough // 3) < 0.90 - 3.0 * 0.015


def rows_of(text: str, heading: str, title: str) -> list[str]:
    return text.split(heading)[1].split(f"| {title} | ")[1].split("\n\n")[0].splitlines()[2:]


def test_numbers_say_of_how_many_flights_they_are() -> None:
    lost = [made_up_summary((1e9,) * 3, 1e9, lost="hit a wall")] * 7
    summaries = {"imu_uwb": [*random_summaries(0, 13), *lost], "imu_uwb_yolo": random_summaries(1)}
    text = table_text(make_tables("paper", summaries))
    assert text.count("IMU+UWB: of 13 flights that were not lost; the other 7 are not counted.") == 2  # tables I and II
    assert text.count("IMU+UWB+YOLO: of 20 flights that were not lost; none was lost.") == 2


def test_a_scenario_beside_the_papers_has_the_same_rows_and_no_paper_column() -> None:
    two = {name: random_summaries(seed) for seed, name in enumerate(NAMES)}
    rows = [replace(row, arrivals={"uwb": 0.7, "altimeter": 0.9}) for row in random_summaries(7)]
    found = make_tables("tuned", two | {"altimeter": rows})
    assert found.estimation["altimeter"]["z"]["median"] == pytest.approx(stdlib.median(row.mse["z"] for row in rows))
    assert found.arrivals["altimeter"] == pytest.approx({"uwb": 0.7, "altimeter": 0.9})
    text, plain = table_text(found), table_text(make_tables("tuned", two))
    assert "| altimeter | x | y | z |" in text
    assert "| altimeter | path |" in text
    assert "fixes used of due: uwb 70.0%, altimeter 90.0%" in text
    for heading in ("## Table I:", "## Table II:"):
        of_altimeter = rows_of(text, heading, "altimeter")
        columns = {"## Table I:": 3, "## Table II:": 1}[heading]
        assert all(row.count(" | ") == columns for row in of_altimeter)
        assert rows_of(text, heading, "IMU+UWB") == rows_of(plain, heading, "IMU+UWB")


@pytest.mark.parametrize(
    ("flights", "marked"),
    [
        (5, {"mean", "median"}),
        (9, {"mean"}),
        (20, {"mean"}),
        (60, set()),
    ],
)
def test_intervals_too_narrow_to_mean_anything_are_marked(flights: int, marked: set[str]) -> None:
    text = table_text(make_tables("tuned", {name: random_summaries(seed, flights) for seed, name in enumerate(NAMES)}))
    for heading in ("## Table I:", "## Table II:"):
        rows = {row.split(" | ")[0].strip("| "): row for row in rows_of(text, heading, "IMU+UWB")}
        quartiles = {"75 %", "25 %"} if flights >= 10 else set()
        assert set(rows) == {"mean", "median"} | quartiles
        for name, row in rows.items():
            assert row.count("] (!) |") == (row.count(" [") if name in marked else 0), row
    efficiency = text.split("## Efficiency")[1]
    assert ("(!)" in efficiency.split("| tick by tick |")[1].splitlines()[0]) == ("mean" in marked)
    assert ("] (!); paper 93.35 %" in text) == ("median" in marked)


def in_short(text: str) -> list[str]:
    """Return the lines of a report's summary, which must come before everything else."""
    title, heading, *rest = (line for line in text.splitlines() if line)
    assert title.startswith("# ")
    assert heading == "## In short"
    return list(itertools.takewhile(lambda line: line.startswith("- "), rest))


@pytest.mark.parametrize("beside", [0, 3])
def test_the_text_begins_with_five_lines_of_what_it_says(beside: int) -> None:
    rows = {name: random_summaries(seed) for seed, name in enumerate((*NAMES, "a", "b", "c")[: 2 + beside])}
    rows["imu_uwb"] = [*rows["imu_uwb"][1:], made_up_summary((1e9,) * 3, lost="hit a wall")]
    lost, *medians, drop, nees = in_short(table_text(make_tables("tuned", rows)))
    assert lost.startswith("- Flights lost: IMU+UWB 1 of 20, IMU+UWB+YOLO 0 of 20")
    for name, line in zip(NAMES, medians, strict=True):
        kept = [s for s in rows[name] if s.lost is None]
        expected = [stdlib.median(s.mse[axis] for s in kept) for axis in "xyz"]
        assert f": {', '.join(f'{value:.4f}' for value in expected)} m² in x, y, z (paper: " in line
    assert "(paper: 0.0993, 0.0049, 0.0179)" in medians[0]
    assert "(paper: 0.0066, 0.0032, 0.0120)" in medians[1]
    x = [stdlib.median(s.mse["x"] for s in rows[name] if s.lost is None) for name in NAMES]
    assert drop == f"- The camera {'lowers' if x[1] <= x[0] else 'raises'} that in x by {abs(1.0 - x[1] / x[0]):.0%}."
    assert nees.count("3.00") == 2 + beside


def test_the_summary_says_that_a_camera_made_it_worse() -> None:
    rows = {"imu_uwb": [made_up_summary((0.1,) * 3)] * 2, "imu_uwb_yolo": [made_up_summary((0.15,) * 3)] * 2}
    assert "- The camera raises that in x by 50%." in in_short(table_text(make_tables("tuned", rows)))


def test_the_summary_of_flights_that_are_all_lost_has_no_numbers() -> None:
    found = make_tables("paper", {name: [made_up_summary((1.0,) * 3, lost="tumbled")] * 2 for name in NAMES})
    lost, *medians = in_short(table_text(found))
    assert lost == "- Flights lost: IMU+UWB 2 of 2, IMU+UWB+YOLO 2 of 2."
    assert [": none (paper" in line for line in medians] == [True, True]


def test_efficiency_is_over_single_flights_and_over_all_of_them() -> None:
    rng = np.random.default_rng(9)
    rows = [made_up_summary(tuple(rng.gamma(2.0, 0.01, 3)), floor=tuple(rng.gamma(4.0, 0.002, 3))) for _ in range(12)]
    found = make_tables("tuned", dict.fromkeys(NAMES, rows))
    text = table_text(found)
    for k, axis in enumerate("xyz"):
        table, floors = found.efficiency["imu_uwb"][axis], [s.floor[axis] for s in rows]
        values = [s.mse[axis] / s.floor[axis] for s in rows]
        low, _, high = stdlib.quantiles(values, n=4, method="inclusive")
        assert table.median == pytest.approx(stdlib.median(values))
        assert (table.p25, table.p75) == (pytest.approx(low), pytest.approx(high))
        assert table.floor == pytest.approx(stdlib.fmean(floors))
        assert table.all.value == pytest.approx(sum(s.mse[axis] for s in rows) / sum(floors))
        assert table.ticks.value == pytest.approx(2.0 * stdlib.fmean(values))
        assert table.ticks.interval == pytest.approx([2.0 * v for v in bootstrap_interval(values, "mean") or []])
        for statistic in STATISTICS:
            assert table.intervals[statistic] == bootstrap_interval(values, statistic)
        for name in NAMES:
            title = {"imu_uwb": "IMU+UWB", "imu_uwb_yolo": "IMU+UWB+YOLO"}[name]
            printed = text.split("Cramer-Rao")[1].split(f"| {title} | x | y | z |")[1].splitlines()[2:9]
            cells = [line.strip("| ").split(" | ")[1 + k] for line in printed]
            expected = [table.all.value, table.ticks.value, *(getattr(table, s) for s in STATISTICS)]
            assert [cell.split(" [")[0] for cell in cells[:6]] == [f"{value:.2f}" for value in expected]
            assert cells[6] == f"{table.floor:.6f}"


def test_efficiency_is_none_where_no_floor_is_known() -> None:
    found = make_tables("tuned", dict.fromkeys(NAMES, [made_up_summary((0.1,) * 3, floor=None)] * 3))
    assert found.efficiency["imu_uwb"]["x"].median is None
    assert found.efficiency["imu_uwb"]["x"].all == Ratio(None, None)
    for row in ("all flights", "tick by tick", "median", "mean floor [m²]"):
        assert f"| {row} | none | none | none |" in table_text(found)
