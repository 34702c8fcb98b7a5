"""A search by flights: what it weighs, what it finds where the answer is known, what it refuses."""

from pathlib import Path

import numpy as np
import pytest
from command_line import run
from scipy import stats

from ortilo_drake.flight.flight import fly
from ortilo_drake.flight.metrics import summary
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import load_scenario, with_seed
from ortilo_drake.studies.maps.chunks import columns_of
from ortilo_drake.studies.maps.map_flights import figures_of_points
from ortilo_drake.studies.maps.sweep import load_over
from ortilo_drake.studies.tuning.search import (
    LOST,
    Search,
    compare_costs,
    costs_of,
    found_text,
    place_of,
    search_by_flights,
    search_lines,
    settings_at,
)

HOVER = {"planner": {"kind": "hover", "duration": 3.0}, "settle": 0.0}
WEAK = {"servo.weights.position": [0.02, 0.02, 0.02], "world.disturbance.force_density": 0.183}
AXES = {
    "servo.weights.position": {"start": 1.0, "stop": 1000.0, "scale": "log"},
    "servo.weights.velocity": {"start": 0.1, "stop": 10.0, "scale": "log"},
}
SEARCH = Search.model_validate(
    {
        "scenario": "nominal_imu_uwb",
        "settings": HOVER | WEAK,
        "axes": AXES,
        "flights": 6,
        "judge": 40,
        "evaluations": 18,
    }
)
FILE = """
scenario: nominal_imu_uwb
settings: {planner: {kind: hover, duration: 1.0}, settle: 0.0}
axes:
  servo.weights.position: {start: 0.5, stop: 2.0, scale: log}
  estimator.W.force_density: {start: 0.1, stop: 1.0, scale: log}
flights: 2
judge: 4
evaluations: 6
"""


def test_a_cost_is_that_of_drakes_flight(tmp_path: Path) -> None:
    scenario = load_scenario("nominal_imu_uwb", tuple(HOVER.items()))
    (figures,) = figures_of_points([scenario], tmp_path, 3, 2, 1)
    expected = [summary(fly(with_seed(scenario, seed))).path_distance_mse for seed in (3, 4)]
    np.testing.assert_allclose(costs_of(figures, columns_of(scenario)), np.sqrt(expected), rtol=1e-9)


def test_a_lost_flight_costs_more_than_any_other() -> None:
    columns = ("ticks", "cause", "path_distance_mse")
    figures = np.array([[9.0, -1.0, 4.0], [3.0, 2.0, 1e-6], [3.0, 0.0, np.nan], [9.0, -1.0, 1e6]])
    assert costs_of(figures, columns).tolist() == [2.0, LOST, LOST, LOST]


@pytest.mark.long
def test_weights_that_are_far_too_small_are_found_to_be(tmp_path: Path) -> None:
    found = search_by_flights(SEARCH, "search", tmp_path / "one", 1)
    assert len(found.history) >= SEARCH.evaluations
    assert found.best.cost == min(one.cost for one in found.history) < found.start.cost
    assert found.judged.high < 0.0  # on seeds that were not searched on
    assert all(weight > 0.2 for weight in found.best.settings["servo.weights.position"])
    again = search_by_flights(SEARCH, "search", tmp_path / "one", 1)  # nothing is flown
    assert again == found
    assert "better" in "".join(search_lines(found))


@pytest.mark.long
def test_what_was_found_flies(tmp_path: Path) -> None:
    found = search_by_flights(SEARCH.model_copy(update={"evaluations": 1}), "search", tmp_path, 1)
    file = tmp_path / "found.yaml"
    file.write_text(found_text(found, SEARCH.scenario))
    scenario = load_scenario(file)
    expected = found.best.settings["servo.weights.velocity"]
    np.testing.assert_allclose(scenario.servo.weights.velocity, expected, rtol=1e-5)
    assert scenario.world.disturbance.force_density == 0.183


def test_the_interval_of_a_difference_is_about_students() -> None:
    start = np.random.default_rng(1).normal(0.3, 0.05, 300)
    found = start + np.random.default_rng(2).normal(-0.004, 0.02, 300)
    judged = compare_costs(start, found)
    low, high = stats.ttest_rel(found, start).confidence_interval(0.95)
    assert (judged.low, judged.high) == pytest.approx((low, high), abs=2e-4)
    assert judged.difference == pytest.approx(np.mean(found) - np.mean(start))
    same = compare_costs(start, start)
    assert (same.low, same.difference, same.high) == (0.0, 0.0, 0.0)


def test_it_begins_at_the_scenarios_own_settings() -> None:
    search = Search.model_validate(
        {"axes": AXES | {"servo.yaw": {"start": -0.1, "stop": 0.1}, "uwb.link.rate": {"start": 1.0, "stop": 5.0}}}
    )
    place = place_of(search)
    assert place[:3] == pytest.approx([0.0, 0.5, 0.5])
    values = tuple(axis.at(np.array([share]))[0] for axis, share in zip(search.axes.values(), place, strict=True))
    assert settings_at(search, values, "search")["servo.weights.velocity"] == pytest.approx([1.0, 1.0, 1.0])


@pytest.mark.long
def test_the_command_searches_judges_and_goes_on_where_it_stopped(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out, kept = tmp_path / "search.yaml", tmp_path / "found.yaml", tmp_path / "kept"
    file.write_text(FILE)
    command = ("tune", str(file), "--fly", "--out", str(out), "--kept", str(kept), "--workers", "1")
    assert run(*command) == 0
    first, text = capsys.readouterr().out, out.read_text()
    assert "on 4 other seeds" in first
    files = {path: path.stat().st_mtime_ns for path in kept.rglob("*.parquet")}
    assert run(*command) == 0
    assert capsys.readouterr().out == first
    assert out.read_text() == text
    assert files == {path: path.stat().st_mtime_ns for path in kept.rglob("*.parquet")}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("servo.weights.position", "servo.wheels"), "axes.servo.wheels|servo.wheels"),
        (("servo.weights.position", "servo.form"), r"axes.servo.form: is 'error'"),
        (("start: 0.5", "start: 5.0"), "must be above the start"),
        (("flights: 2", "flights: 0"), "flights: 0"),
        (("stop: 1.0, scale: log}", "stop: 1.0, whole: true}"), "whole"),
        (("start: 0.1, stop: 1.0, scale: log", "start: -1.0, stop: 1.0"), "force_density"),
    ],
)
def test_what_cannot_be_searched_is_refused_in_a_line(tmp_path: Path, change: tuple[str, str], said: str) -> None:
    file = tmp_path / "search.yaml"
    file.write_text(FILE.replace(*change))
    with pytest.raises(InputError, match=said):
        search_by_flights(load_over(Search, file), str(file), tmp_path / "kept", 1)
    assert not (tmp_path / "kept").exists()
