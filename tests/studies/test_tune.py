"""Tuning from files: what is written flies, what is bad is refused in one line, lost flights are cut."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from command_line import run
from scipy import stats

from ortilo_drake.flight.flight import fly
from ortilo_drake.flight.metrics import estimation_mse, position_nees, summary
from ortilo_drake.flight.saved_flight import save_flight
from ortilo_drake.model.as_data import as_data
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import load_scenario, with_seed
from ortilo_drake.studies.consistency.consistency_figures import nees_figure
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
from ortilo_drake.studies.tuning.tune import (
    Check,
    FlownFigures,
    Tuning,
    find_flights,
    overlay_text,
    tune,
    tuning_summary,
)

SHORT = "planner={kind: waypoints, points: [[0, 0, 1.5], [2.2, 0.9, 1.5]]}"
DETUNED = ("estimator.V.imu=[2.5e-3, 2.5e-3, 2.5e-3]", "multilateration.noise.fraction=0.03", "uwb.link.blackouts=[]")


@pytest.fixture(scope="module")
def flights() -> list[xr.Dataset]:
    return [fly(load_scenario("nominal_imu_uwb", (SHORT, *DETUNED), seed)) for seed in range(2)]


@pytest.fixture(scope="module")
def folder(flights: list[xr.Dataset], tmp_path_factory: pytest.TempPathFactory) -> Path:
    where = tmp_path_factory.mktemp("flights")
    for seed, flight in enumerate(flights):
        save_flight(flight, where / f"odd\nname_{seed}.nc")
    return where


@pytest.fixture(scope="module")
def tuning(folder: Path) -> Tuning:
    return tune(find_flights([folder]))


@pytest.mark.long
def test_the_sensors_noise_is_found(tuning: Tuning) -> None:
    assert tuning.numbers["multilateration.noise.fraction"].after == pytest.approx(0.0075, rel=0.15)
    for i in range(3):
        assert tuning.numbers[f"estimator.V.imu.{i}"].after == pytest.approx(1e-4, rel=0.25)


@pytest.mark.long
def test_before_is_what_flew(tuning: Tuning, flights: list[xr.Dataset]) -> None:
    expected = np.mean([np.mean(position_nees(flight)) for flight in flights])
    assert tuning.before.nees["all"].mean == pytest.approx(expected, rel=1e-6)
    assert tuning.before.nis["camera"] is None


def test_the_overlay_loads_as_the_tuned_scenario(tuning: Tuning, tmp_path: Path) -> None:
    path = tmp_path / "overlay.yaml"
    path.write_text(overlay_text(tuning))
    loaded = load_scenario(path)
    assert loaded == tuning.fitted
    assert loaded.name == "nominal_imu_uwb_tuned"
    assert loaded.planner == load_scenario("nominal_imu_uwb", (SHORT,)).planner


def test_the_data_is_plain(tuning: Tuning) -> None:
    data = json.loads(json.dumps(as_data(tuning), allow_nan=False))
    assert data["counted"] == ["uwb", "imu"]
    assert len(data["flights"]) == 2


@pytest.mark.long
def test_a_lost_flight_is_used_up_to_its_loss_or_left_out(flights: list[xr.Dataset], tmp_path: Path) -> None:
    ticks = flights[0].sizes["tick"]
    for k, cut in enumerate((ticks - 30, 60)):
        lost = flights[k].isel(tick=slice(0, cut)).copy()
        lost.attrs["lost"] = json.dumps({"time": cut / 30.0, "cause": "hit a wall"})
        save_flight(lost, tmp_path / f"{k}.nc")
    found = tune(find_flights([tmp_path]))
    assert [Path(flight.file).name for flight in found.flights] == ["0.nc"]
    assert "used for its first" in found.notes[0]
    assert "left out" in found.notes[1]


@pytest.mark.long
def test_bad_input_is_refused(flights: list[xr.Dataset], tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no flights"):
        find_flights([tmp_path])
    with pytest.raises(InputError, match="No such file"):
        tune(find_flights([tmp_path / "missing.nc"]))
    other = flights[0].copy()
    other.attrs["scenario"] = load_scenario("nominal_imu_uwb").model_dump_json()
    save_flight(flights[0], tmp_path / "a.nc")
    save_flight(other, tmp_path / "b.nc")
    with pytest.raises(InputError, match=r"a\.nc and .*b\.nc: fly different scenarios"):
        tune(find_flights([tmp_path]))


@pytest.mark.long
def test_the_legend_of_nees_is_below_what_it_would_cover(flights: list[xr.Dataset], drawn_figures: list[Any]) -> None:
    nees_figure({"nominal_imu_uwb": flights}, Path())
    (figure,) = drawn_figures
    figure.draw_without_rendering()
    (legend,) = figure.legends
    assert legend.get_window_extent().y1 <= figure.axes[0].bbox.y0


def test_the_summary_names_what_changed_most_and_what_that_bought(tuning: Tuning, flights: list[xr.Dataset]) -> None:
    lost, flown = FlownFigures(2, None, None), FlownFigures(0, [0.01, 0.02, 0.03], None)
    numbers, nees, mse, check = tuning_summary(tuning, Check([5, 6], lost, flown, "engine"))
    fitted = {key: number for key, number in tuning.numbers.items() if not number.stays}
    assert numbers.startswith(f"{len(fitted)} of {len(tuning.numbers)} numbers were fitted")
    name = numbers.split("changed most: ")[1].split(",")[0]
    change = {key: number.after / number.before for key, number in fitted.items()}
    assert max(change[name], 1.0 / change[name]) == max(max(ratio, 1.0 / ratio) for ratio in change.values())
    assert f"to {change[name]:.3g} times what it was" in numbers
    before = np.mean([np.mean(position_nees(flight)) for flight in flights])
    assert f": {before:.2f} -> " in nees
    assert f": {np.mean([sum(estimation_mse(flight).values()) for flight in flights]):.6f} -> " in mse
    assert check == "on 2 new seeds: 2 -> 0 lost"  # nothing to compare: every seed was lost before
    assert len(tuning_summary(tuning, None)) == 3
    twice = FlownFigures(0, [0.02, 0.04, 0.06], None)
    assert tuning_summary(tuning, Check([5], twice, flown, "engine"))[3].endswith("0.120000 -> 0.060000 m² (-50%)")


@pytest.mark.long
def test_the_command_writes_what_it_is_asked_for(
    folder: Path, tuning: Tuning, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    overlay, data, figure = (tmp_path / name for name in ("tuned.yaml", "tuned.json", "tuned.png"))
    words = ["--out", str(overlay), "--json", str(data), "--figure", str(figure), "--check", "1"]
    assert run("tune", str(folder), *words) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    assert "nominal_imu_uwb_tuned, fitted to 2 flights" in printed.out
    assert "new flights, seeds 2 to 2, by engine:" in printed.out
    assert printed.out.index("numbers were fitted") < printed.out.index("log-likelihood")
    assert load_scenario(overlay) == tuning.fitted
    found = json.loads(data.read_text())
    assert found["numbers"] == json.loads(json.dumps(as_data(tuning)))["numbers"]
    again = estimation_mse(fly(load_scenario(overlay, seed=2)))
    assert found["check"]["after"]["mse"] == pytest.approx(list(again.values()), rel=1e-12)
    assert figure.stat().st_size > 10_000
    assert run("tune", str(folder), "--json", str(data), "--check", "1", "--player", "drake") == 0
    assert json.loads(data.read_text())["check"] == found["check"] | {"flown_by": "drake"}


@pytest.mark.family("words3---check")
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["missing.nc"], "missing.nc: cannot be read: No such file"),
        (["--out", "tuned.txt"], "--out tuned.txt: must end in .yaml"),
        (["--figure", "tuned.frog"], "tuned.frog: unknown kind of picture '.frog'"),
        (["--check", "-1"], "--check"),
    ],
)
def test_the_command_refuses_bad_input(
    words: list[str],
    said: str,
    folder: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run("tune", *(words if words[0][0] != "-" else [str(folder), *words])) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert said in printed.err


def test_a_folder_without_flights_says_how_a_log_is_tuned(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no flights \(`ortilo fly --out FLIGHT.nc`\).*; a log or a recording needs"):
        find_flights([tmp_path])
    (tmp_path / "map.yaml").write_text("")
    with pytest.raises(InputError, match=r"; --map .*map\.yaml reads this log"):
        find_flights([tmp_path])


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
    (figures,), _ = figures_of_points([scenario], tmp_path, 3, 2, 1)
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
