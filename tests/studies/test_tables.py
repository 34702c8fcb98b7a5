"""The paper's tables beside ours, against the printed numbers and plain statistics."""

import itertools
import json
import statistics as stdlib
from dataclasses import replace

import numpy as np
import pytest
from made_up_summaries import made_up_summary
from scipy.stats import binomtest, quantile_test

from ortilo_drake.flight.efficiency import Ratio
from ortilo_drake.flight.summary import Summary
from ortilo_drake.model.as_data import as_data
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.paper_tables.flown_tables import scenarios_of_tables
from ortilo_drake.studies.paper_tables.report import table_text
from ortilo_drake.studies.paper_tables.tables import (
    ENOUGH_FOR_A_MEAN,
    PAPER,
    QUANTILES,
    STATISTICS,
    Drop,
    drop_in_x,
    make_tables,
    mean_interval,
    statistics,
)
from ortilo_drake.views.numbers import with_interval

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
    found = drop_in_x([0.0993] * 7, [0.0066] * 7, (7, 7))
    assert found.median is not None
    assert round(100.0 * found.median, 2) == 93.35
    assert found.interval == pytest.approx([found.median] * 2)
    assert (found.kept, found.kept_interval) == (found.median, found.interval)


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
    assert mean_interval([0.1]) is None
    assert drop_in_x([0.1, 0.2], [], (2, 0)) == Drop(None, None, None, None)


def test_a_means_interval_is_the_percentile_bootstraps() -> None:
    values, rng = np.random.default_rng(3).gamma(2.0, 0.01, 20), np.random.default_rng(7)
    drawn = np.array([np.mean(values[rng.integers(0, 20, 20)]) for _ in range(4000)])
    found = mean_interval(values.tolist())
    assert found is not None
    # Four sd of a 2.5 % quantile's own error from 4,000 draws.
    np.testing.assert_allclose(found, np.quantile(drawn, [0.025, 0.975]), atol=4.0 * 0.042 * drawn.std())
    assert mean_interval(values.tolist()) == found  # nothing drawn afresh


@pytest.mark.long
@pytest.mark.parametrize("share_lost", [0.0, 0.3])
def test_the_drops_interval_holds_the_true_drop(share_lost: float) -> None:
    """Flights of a seed are alike with and without the camera; lost ones are the worst of those without it."""
    rng, drawn, held = np.random.default_rng(4), 1000, 0
    true = 1.0 - np.exp(-2.0)  # of the medians of both log-normal distributions
    for _ in range(drawn):
        common = rng.normal(size=20)
        without = np.exp(common + 0.5 * rng.normal(size=20))
        with_camera = np.exp(common - 2.0)
        kept = np.sort(without)[: 20 - rng.binomial(20, share_lost)]
        found = drop_in_x(kept.tolist(), with_camera.tolist(), (20, 20))
        assert found.interval is not None
        held += found.interval[0] <= true <= found.interval[1]
    assert held / drawn > 0.95


def test_a_drop_from_lost_flights_is_lost() -> None:
    found = drop_in_x([0.1] * 10, [0.01] * 20, (21, 20))
    assert (found.median, found.kept) == (None, pytest.approx(0.9))
    assert found.interval == pytest.approx((0.9, 1.0))
    worse = drop_in_x([0.1] * 20, [0.01] * 11, (20, 20))
    assert worse.median == pytest.approx(0.9)
    assert worse.interval == pytest.approx((-np.inf, 0.9))


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


def test_lost_flights_are_counted_and_left_out_of_what_is_of_the_kept() -> None:
    good = {name: random_summaries(seed, 8) for seed, name in enumerate(NAMES)}
    bad = made_up_summary((1e9, 1e9, 1e9), 1e9, lost="hit a wall", touched=("chair",))
    mixed = {"imu_uwb": [bad, *good["imu_uwb"], bad], "imu_uwb_yolo": [*good["imu_uwb_yolo"], bad, bad]}
    found, expected = make_tables("tuned", mixed), make_tables("tuned", good)
    assert found.lost == {"imu_uwb": 2, "imu_uwb_yolo": 2}
    assert found.flights == 10
    share = binomtest(2, 10).proportion_ci(0.95, method="wilson")
    assert found.lost_share["imu_uwb"] == pytest.approx((share.low, share.high))
    for field in ("estimation", "path", "path_distance", "intervals", "touched", "nees", "arrivals"):
        assert getattr(found, field) == getattr(expected, field), field
    for axis in "xyz":
        ours, its = found.efficiency["imu_uwb"][axis], expected.efficiency["imu_uwb"][axis]
        assert (ours.median, ours.all, ours.ticks, ours.floor) == (its.median, its.all, its.ticks, its.floor)
    assert found.drop_in_x.kept == expected.drop_in_x.kept
    assert found.drop_in_x.kept_interval == expected.drop_in_x.kept_interval


@pytest.mark.family
@pytest.mark.parametrize("lost", [1, 4, 12, 13, 25])
def test_a_lost_flight_is_worse_than_any_other(lost: int) -> None:
    """Medians and quartiles are those of NumPy where a lost flight's error is larger than any."""
    kept = random_summaries(0, 13)
    bad = made_up_summary((0.0, 0.0, 0.0), 0.0, lost="hit a wall")  # its errors up to the loss may be the least
    found = make_tables("paper", dict.fromkeys(NAMES, [bad] * lost + kept))
    for column in ("x", "path"):
        values = [1e9] * lost + [s.path_mse if column == "path" else s.mse[column] for s in kept]
        for statistic, q in QUANTILES.items():
            its = found.with_lost["imu_uwb"][column][statistic]
            least = np.quantile(values, q, method="higher")
            if least == 1e9 and np.quantile(values, q) > 0.5:
                assert its == np.inf
            else:
                assert its == pytest.approx(np.quantile(values, q))
            interval = quantile_test(values, p=q).confidence_interval(0.95)
            ours = found.with_lost_intervals["imu_uwb"][column][statistic]
            if np.isnan([interval.low, interval.high]).any():
                assert ours is None
            else:
                assert ours == tuple(np.inf if end == 1e9 else end for end in (interval.low, interval.high))


def test_nees_and_errors_over_the_floor_are_known_with_and_without_the_lost() -> None:
    rng = np.random.default_rng(11)
    kept = [replace(s, nees=float(rng.gamma(3.0))) for s in random_summaries(1, 12)]
    bad = replace(made_up_summary((0.3, 0.3, 0.3), floor=(0.1, 0.1, 0.1), lost="tumbled"), nees=40.0)
    found = make_tables("paper", {name: [*kept, bad] for name in NAMES})
    assert found.nees["imu_uwb"].value == pytest.approx(stdlib.fmean(s.nees for s in kept))
    assert found.nees_with_lost["imu_uwb"].value == pytest.approx(stdlib.fmean([40.0, *(s.nees for s in kept)]))
    axis = found.efficiency["imu_uwb"]["x"]
    assert axis.all.value == pytest.approx(sum(s.mse["x"] for s in kept) / (12 * 0.01))
    assert axis.all_with_lost.value == pytest.approx((0.3 + sum(s.mse["x"] for s in kept)) / (0.1 + 12 * 0.01))
    assert axis.ticks_with_lost.value == pytest.approx(stdlib.fmean([6.0, *(200.0 * s.mse["x"] for s in kept)]))
    text = table_text(found)
    assert "with the lost up to their losses (3 if consistent)" in text
    assert "| all together, lost ones up to their losses | " in text


def test_touched_furniture_is_counted_but_not_left_out() -> None:
    rows = [made_up_summary((k / 10.0,) * 3, touched=("chair",) * (k % 2)) for k in (1, 2, 3, 4, 6)]
    found = make_tables("paper", dict.fromkeys(NAMES, rows))
    assert found.touched == {"imu_uwb": 2, "imu_uwb_yolo": 2}
    assert found.estimation["imu_uwb"]["x"]["mean"] == pytest.approx(0.32)


@pytest.mark.parametrize("n", [1, 2])
def test_tables_of_flights_that_are_all_lost_have_no_numbers_but_a_text(n: int) -> None:
    found = make_tables("paper", {name: [made_up_summary((1.0,) * 3, lost="tumbled")] * n for name in NAMES})
    assert found.drop_in_x.kept is None
    assert found.estimation["imu_uwb"]["x"] == dict.fromkeys(STATISTICS)
    assert found.with_lost["imu_uwb"]["x"] == dict.fromkeys(QUANTILES, np.inf)
    assert f"{n} of {n} flights lost" in table_text(found)


def test_tables_of_a_path_without_the_authors_error_have_none_there() -> None:
    found = make_tables("tuned", {name: [made_up_summary((0.1,) * 3, path=None)] * 2 for name in NAMES})
    assert found.path["imu_uwb"] == dict.fromkeys(STATISTICS)
    assert "| mean | none | 0.0098 |" in table_text(found)


def test_the_text_shows_ours_beside_the_papers() -> None:
    found = make_tables("tuned", {name: random_summaries(seed) for seed, name in enumerate(NAMES)})
    text = table_text(found)
    for name, axis, statistic in itertools.product(NAMES, "xyz", STATISTICS):
        cell = with_interval(found.estimation[name][axis][statistic], found.intervals[name][axis][statistic])
        assert f" | {cell}" in text
        assert f"| {PAPER.estimation[name][axis][statistic]:.4f} |" in text
    assert "paper 93.35 %" in text


def test_from_enough_flights_on_a_means_interval_holds_the_true_one_in_nine_of_ten() -> None:
    enough, rng = ENOUGH_FOR_A_MEAN, np.random.default_rng(5)

    def coverage(flights: int, ensembles: int = 400) -> float:
        values = rng.lognormal(size=(ensembles, flights))
        drawn = values[np.arange(ensembles)[:, None, None], rng.integers(0, flights, (ensembles, 500, flights))]
        low, high = np.percentile(drawn.mean(axis=2), [2.5, 97.5], axis=1)
        return float(np.mean((low <= np.exp(0.5)) & (np.exp(0.5) <= high)))

    # The share of 400 has a standard deviation of 0.015.
    assert coverage(enough) > 0.90 - 3.0 * 0.015
    assert coverage(enough // 3) < 0.90 - 3.0 * 0.015


def rows_of(text: str, heading: str, title: str) -> list[str]:
    return text.split(heading)[1].split(f"| {title} | ")[1].split("\n\n")[0].splitlines()[2:]


def test_numbers_say_of_how_many_flights_they_are() -> None:
    lost = [made_up_summary((1e9,) * 3, 1e9, lost="hit a wall")] * 7
    summaries = {"imu_uwb": [*random_summaries(0, 13), *lost], "imu_uwb_yolo": random_summaries(1)}
    text = table_text(make_tables("paper", summaries))
    assert text.count("IMU+UWB: of 20 flights, lost 7 of 20 [18, 57 %];") == 2  # tables I and II
    assert text.count("IMU+UWB+YOLO: of 20 flights, none was lost.") == 2


def test_a_scenario_beside_the_papers_has_the_same_rows_and_no_paper_column() -> None:
    two = {name: random_summaries(seed) for seed, name in enumerate(NAMES)}
    rows = [replace(row, arrivals={"uwb": 0.7, "altimeter": 0.9}) for row in random_summaries(7)]
    found = make_tables("tuned", two | {"altimeter": rows})
    assert found.estimation["altimeter"]["z"]["median"] == pytest.approx(stdlib.median(row.mse["z"] for row in rows))
    assert found.arrivals["altimeter"] == pytest.approx({"uwb": 0.7, "altimeter": 0.9})
    text, plain = table_text(found), table_text(make_tables("tuned", two))
    assert "| altimeter | x | y | z |" in text
    assert "| altimeter | path |" in text
    assert "fixes used: uwb 70.0%, altimeter 90.0%" in text
    for heading in ("## Table I:", "## Table II:"):
        of_altimeter = rows_of(text, heading, "altimeter")
        columns = {"## Table I:": 3, "## Table II:": 1}[heading]
        assert all(row.count(" | ") == columns for row in of_altimeter)
        assert rows_of(text, heading, "IMU+UWB") == rows_of(plain, heading, "IMU+UWB")


@pytest.mark.parametrize("name", NAMES)
def test_one_scenario_alone_has_its_own_rows_and_no_drop(name: str) -> None:
    two = {name: random_summaries(seed, 13) for seed, name in enumerate(NAMES)}
    found = make_tables("paper", {name: two[name]})
    both, text = table_text(make_tables("paper", two)), table_text(found)
    title = {"imu_uwb": "IMU+UWB", "imu_uwb_yolo": "IMU+UWB+YOLO"}[name]
    assert found.drop_in_x == Drop(None, None, None, None)
    for heading in ("## Table I:", "## Table II:"):
        assert rows_of(text, heading, title) == rows_of(both, heading, title) != []
    lines = [line for line in both.splitlines() if line.startswith(f"- {title}, ")]
    assert [line for line in text.splitlines() if line.startswith("- IMU+UWB")][:-1] == lines
    assert "The camera" not in text
    assert [*scenarios_of_tables("paper", only=name)] == [name]
    with pytest.raises(InputError, match=r"^only: 'paper_imu_uwb': must be one of imu_uwb, imu_uwb_yolo$"):
        scenarios_of_tables("paper", only="paper_imu_uwb")


@pytest.mark.parametrize(("flights", "known"), [(5, {"mean"}), (6, {"mean", "median"}), (13, set(STATISTICS))])
def test_intervals_are_shown_where_there_are_flights_enough_for_them(flights: int, known: set[str]) -> None:
    text = table_text(make_tables("tuned", {name: random_summaries(seed, flights) for seed, name in enumerate(NAMES)}))
    names = {"mean": "mean", "median": "median", "75 %": "p75", "25 %": "p25"}
    for heading in ("## Table I:", "## Table II:"):
        rows = {row.split(" | ")[0].strip("| "): row for row in rows_of(text, heading, "IMU+UWB")}
        assert set(rows) == set(names)
        for title, row in rows.items():
            assert ("[?]" in row) == (names[title] not in known), row


@pytest.mark.family
@pytest.mark.parametrize("flights", [20, 60])
def test_a_means_interval_that_is_too_narrow_is_marked(flights: int) -> None:
    text = table_text(make_tables("tuned", {name: random_summaries(seed, flights) for seed, name in enumerate(NAMES)}))
    rows = [row for row in text.splitlines() if row.startswith(("| mean |", "| median |", "| tick by tick |"))]
    for row in rows:
        marks = 0 if flights >= 60 or row.startswith("| median |") else row.count(" [")
        assert row.count("] (!) |") == marks, row


def in_short(text: str) -> list[str]:
    """Return the lines of a report's summary, which must come before everything else."""
    title, heading, *rest = (line for line in text.splitlines() if line)
    assert title.startswith("# ")
    assert heading == "## In short"
    return list(itertools.takewhile(lambda line: line.startswith("- "), rest))


@pytest.mark.family
@pytest.mark.parametrize("beside", [0, 3])
def test_the_text_begins_with_five_lines_of_what_it_says(beside: int) -> None:
    rows = {name: random_summaries(seed) for seed, name in enumerate((*NAMES, "a", "b", "c")[: 2 + beside])}
    rows["imu_uwb"] = [*rows["imu_uwb"][1:], made_up_summary((1e9,) * 3, lost="hit a wall")]
    lost, *medians, drop, nees = in_short(table_text(make_tables("tuned", rows)))
    assert lost.startswith("- Flights lost: IMU+UWB 1 of 20 [0.89, 24 %], IMU+UWB+YOLO 0 of 20 [0, 16 %]")
    for name, line in zip(NAMES, medians, strict=True):
        found = make_tables("tuned", rows)
        cells = [
            with_interval(found.with_lost[name][axis]["median"], found.with_lost_intervals[name][axis]["median"])
            for axis in "xyz"
        ]
        assert f": {', '.join(cells)} m² in x, y, z (" in line
    assert "(kept: " in medians[0]
    assert "; paper: 0.0993, 0.0049, 0.0179)" in medians[0]
    assert "(paper: 0.0066, 0.0032, 0.0120)" in medians[1]
    x = [stdlib.median(1e9 if s.lost else s.mse["x"] for s in rows[name]) for name in NAMES]
    assert drop == f"- The camera {'lowers' if x[1] <= x[0] else 'raises'} that in x by {abs(1.0 - x[1] / x[0]):.0%}."
    assert nees.count(" 3.000 [3.000, 3.000]") == 2 + beside


def test_the_summary_says_that_a_camera_made_it_worse() -> None:
    rows = {"imu_uwb": [made_up_summary((0.1,) * 3)] * 2, "imu_uwb_yolo": [made_up_summary((0.15,) * 3)] * 2}
    assert "- The camera raises that in x by 50%." in in_short(table_text(make_tables("tuned", rows)))


def test_the_summary_of_flights_that_are_all_lost_has_no_numbers() -> None:
    found = make_tables("paper", {name: [made_up_summary((1.0,) * 3, lost="tumbled")] * 2 for name in NAMES})
    lost, *medians = in_short(table_text(found))
    assert lost == "- Flights lost: IMU+UWB 2 of 2 [34, 100 %], IMU+UWB+YOLO 2 of 2 [34, 100 %]."
    assert ["lost [?], lost [?], lost [?] m² in x, y, z (kept: none; " in line for line in medians] == [True, True]


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
        assert table.ticks.interval == pytest.approx([2.0 * v for v in mean_interval(values) or []])
        assert table.intervals["mean"] == mean_interval(values)
        for name in NAMES:
            title = {"imu_uwb": "IMU+UWB", "imu_uwb_yolo": "IMU+UWB+YOLO"}[name]
            printed = text.split("Cramer-Rao")[1].split(f"| {title} | x | y | z |")[1].splitlines()[2:9]
            cells = [line.strip("| ").split(" | ")[1 + k] for line in printed]
            expected = [(ratio.value, ratio.interval) for ratio in (table.all, table.ticks)]
            expected += [(getattr(table, statistic), table.intervals[statistic]) for statistic in STATISTICS]
            assert [cell.removesuffix(" (!)") for cell in cells[:6]] == [with_interval(*pair) for pair in expected]
            assert cells[6] == f"{table.floor:.6f}"


def test_efficiency_is_none_where_no_floor_is_known() -> None:
    found = make_tables("tuned", dict.fromkeys(NAMES, [made_up_summary((0.1,) * 3, floor=None)] * 3))
    assert found.efficiency["imu_uwb"]["x"].median is None
    assert found.efficiency["imu_uwb"]["x"].all == Ratio(None, None)
    for row in ("all together", "tick by tick", "median", "mean floor [m²]"):
        assert f"| {row} | none | none | none |" in table_text(found)
