"""Maps: figures by engine and Drake, chunks that are kept, points that fly until enough is known."""

import dataclasses
import io
import logging
import math
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from ortilo_drake.flight.flight import fly
from ortilo_drake.flight.intervals import middle_of, share_interval
from ortilo_drake.flight.metrics import summary
from ortilo_drake.model.typed_yaml import InputError, validate
from ortilo_drake.scenario import load_scenario, with_seed
from ortilo_drake.studies.maps import map_flights
from ortilo_drake.studies.maps.chunks import (
    CHUNK,
    chunk_file,
    chunks_of,
    columns_of,
    fly_figures,
    read_chunk,
    write_chunk,
)
from ortilo_drake.studies.maps.map_figure import map_figure
from ortilo_drake.studies.maps.map_flights import Map, MapPoint, fly_map, is_enough
from ortilo_drake.studies.maps.map_report import indices_of, map_csv, map_text
from ortilo_drake.studies.maps.sweep import Sweep, points_of

SHORT = {"planner": {"kind": "waypoints", "points": [[0.0, 0.0, 1.5], [1.2, 0.6, 1.5]]}, "settle": 1.0}


def sweep(**fields: object) -> Sweep:
    base = {"scenario": "nominal_imu_uwb", "settings": SHORT, "axes": {"uwb.link.loss": [0.0, 0.9]}, "flights": 3}
    return validate(Sweep, base | fields, "sweep")


def test_the_figures_of_a_flight_are_those_of_its_summary() -> None:
    scenario = load_scenario("nominal_imu_uwb", tuple(SHORT.items()))
    figures = fly_figures(scenario.model_dump_json(), range(1, 2), "")
    named = dict(zip(columns_of(scenario), figures[0], strict=True))
    found = summary(fly(with_seed(scenario, 1)))
    for axis, value in found.mse.items():
        assert math.isclose(named[f"mse_{axis}"], value, rel_tol=1e-6)
    assert math.isclose(named["max_path_distance"], found.max_path_distance, rel_tol=1e-6)
    assert math.isclose(named["nees"], found.nees, rel_tol=1e-6)
    assert named["cause"] == -1
    assert math.isclose(named["arrived_uwb"] / named["due_uwb"], found.arrivals["uwb"], rel_tol=1e-12)


def test_chunks_cover_the_seeds_once() -> None:
    chunks = chunks_of(7, 2 * CHUNK + 1)
    assert [seed for chunk in chunks for seed in chunk] == list(range(7, 7 + 2 * CHUNK + 1))


def test_a_damaged_chunk_is_not_read_and_says_so(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    columns, figures = ("a", "b"), np.arange(6.0).reshape(3, 2)
    assert read_chunk(tmp_path, range(3), columns) is None
    write_chunk(tmp_path, range(3), columns, figures)
    np.testing.assert_array_equal(read_chunk(tmp_path, range(3), columns), figures)
    file = chunk_file(tmp_path, range(3))
    whole = file.read_bytes()
    for spoiled in (whole[:-20], b"", b"no parquet"):
        file.write_bytes(spoiled)
        with caplog.at_level(logging.WARNING):
            assert read_chunk(tmp_path, range(3), columns) is None
        assert "flown again" in caplog.text
    write_chunk(tmp_path, range(3), columns, figures, "somebody")
    assert read_chunk(tmp_path, range(3), columns) is None
    write_chunk(tmp_path, range(1, 4), columns, figures)
    chunk_file(tmp_path, range(1, 4)).rename(file)
    assert read_chunk(tmp_path, range(3), columns) is None  # another chunk's


def test_flights_go_on_until_the_interval_is_narrow_or_there_are_enough() -> None:
    until = sweep(flights={"half_width": 0.05, "at_most": 1000})
    assert not is_enough(until, 0, 20)
    assert is_enough(until, 0, 40)  # Wilson's interval of 0 of n is z^2 / (n + z^2) wide: 0.088
    assert not is_enough(until, 100, 200)
    assert is_enough(until, 500, 1000)
    assert is_enough(sweep(), 0, 3)


@pytest.mark.long
def test_a_map_is_resumed_and_the_same_on_any_number_of_workers(tmp_path: Path) -> None:
    flown: list[int] = []
    one = fly_map(sweep(), "sweep", tmp_path / "one", 1, flown.append)
    assert sum(flown) == 6
    two = fly_map(sweep(), "sweep", tmp_path / "two", 2)
    assert map_csv(one) == map_csv(two)
    files = sorted((tmp_path / "one").rglob("*.parquet"))
    assert len(files) == 2
    assert [f.read_bytes() for f in files] == [f.read_bytes() for f in sorted((tmp_path / "two").rglob("*.parquet"))]
    before = [f.stat().st_mtime_ns for f in files]
    files[0].unlink()
    assert map_csv(fly_map(sweep(), "sweep", tmp_path / "one", 1)) == map_csv(one)
    assert files[1].stat().st_mtime_ns == before[1]  # not flown again


def test_points_that_are_known_fly_no_more(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Half of the flights of one point are lost, none of the other's: made up, so that many fly at once."""
    monkeypatch.setattr(map_flights, "run_all", _made_up)
    found = fly_map(sweep(flights={"half_width": 0.03, "at_most": 1000}), "sweep", tmp_path, 1)
    assert [row.flights for row in found.rows] == [CHUNK, 1000]
    assert [row.lost for row in found.rows] == [0, 500]


def _made_up(function: object, jobs: list, workers: int, take: object) -> None:
    for number, (text, seeds, *_) in enumerate(jobs):
        figures = np.ones((len(seeds), 14))
        bad = '"probability":0.9' in text.replace(" ", "") or '"loss":0.9' in text.replace(" ", "")
        figures[:, 1] = np.where(np.arange(len(seeds)) % 2 * bad, 0.0, -1.0)
        take(number, figures[:, : len(figures[0]) - 14 + len(_COLUMNS)])


_COLUMNS = columns_of(load_scenario("nominal_imu_uwb"))


def test_whole_flights_are_kept_on_request(tmp_path: Path) -> None:
    fly_map(sweep(axes={"uwb.link.loss": [0.5]}, flights=2, whole=1), "sweep", tmp_path, 1)
    assert [f.name for f in (tmp_path / "whole").rglob("*.nc")] == ["seed_000000.nc"]


def test_a_folder_that_cannot_be_written_ends_it_with_a_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file"):
        fly_map(sweep(axes={"uwb.link.loss": [0.5]}, flights=1), "sweep", tmp_path / "file", 1)


def row_of(point: dict, value: float, lost: int, flights: int = 10) -> MapPoint:
    """Return a row whose flights that were kept all have one error."""
    middle = middle_of([value] * (flights - lost), lost)
    share = share_interval(lost, flights)
    of_value = middle.median, middle.interval, middle.kept, middle.kept_interval, value, value
    return MapPoint(point, flights, lost, *share, *of_value, 1.0, None, 3.0, (2.9, 3.1), {"uwb": 0.5})


def made_map(values: np.ndarray, of: Sweep) -> Map:
    rows = []
    for point, value in zip(points_of(of), values.tolist(), strict=True):
        rows.append(row_of(point, value, lost=0))
    return Map(of, rows, "engine")


@pytest.mark.long
def test_sobols_indices_are_those_of_ishigamis_function() -> None:
    """Of sin x1 + 7 sin^2 x2 + 0.1 x3^4 sin x1: 0.314, 0.442, 0 alone, 0.558, 0.442, 0.244 in all (closed form)."""
    axes = {f"uwb.x{i}": {"start": -math.pi, "stop": math.pi} for i in range(3)}
    of = sweep(axes=axes, design={"kind": "sensitivity", "points": 4096})
    x = np.array([list(point.values()) for point in points_of(of)])
    y = np.sin(x[:, 0]) + 7.0 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])
    found = indices_of(made_map(np.exp(y), of))
    np.testing.assert_allclose([i.first for i in found], [0.314, 0.442, 0.0], atol=0.03)
    np.testing.assert_allclose([i.total for i in found], [0.558, 0.442, 0.244], atol=0.03)
    assert "with the others" in map_text(made_map(np.exp(y), of))


def test_a_row_says_what_was_lost_and_counts_it_as_worst() -> None:
    of = sweep(axes={"uwb.link.loss": [0.0, 0.5, 0.9]})
    rows = [row_of(point, 0.2, lost) for point, lost in zip(points_of(of), (0, 2, 7), strict=True)]
    found = Map(of, rows, "engine")
    text = map_text(found)
    assert "| 0 | 0 of 10 [0, 28 %] | 0.2000 [0.2000, 0.2000] | 0.2000 to 0.2000 | 1.0 [?] | 3.0 [2.9, 3.1] |" in text
    assert "| 0.5 | 2 of 10 [5.7, 51 %] | 0.2000 [0.2000, lost]; kept 0.2000 [0.2000, 0.2000] |" in text
    assert "| 0.9 | 7 of 10 [40, 89 %] | lost [0.20, lost]; kept 0.20 [?] |" in text
    table = pd.read_csv(io.StringIO(map_csv(found)))
    assert list(table["rms"]) == [0.2, 0.2, np.inf]
    assert list(table["kept_rms"]) == [0.2, 0.2, 0.2]
    assert list(table["rms_interval_high"]) == [0.2, np.inf, np.inf]


@pytest.mark.family
@pytest.mark.parametrize(
    "axes", [{"uwb.link.loss": [0.0, 0.5, 0.9]}, {"uwb.link.rate": [1.0, 2.0], "room": ["a", "b"]}]
)
def test_one_and_two_axes_are_drawn_and_others_are_not(axes: dict, tmp_path: Path) -> None:
    of = sweep(axes=axes)
    found = made_map(np.linspace(0.1, 0.4, of.count), of)
    file = map_figure(found, tmp_path / "map.png")
    assert file is not None
    assert file.stat().st_size > 10_000
    three = sweep(axes=axes | {"uwb.link.delay": [0], "imu.link.loss": [0.0, 0.1]})
    assert map_figure(made_map(np.ones(three.count), three), tmp_path / "none.png") is None


def test_a_curve_has_the_tables_intervals_and_its_names(drawn_figures: list[Any]) -> None:
    of = sweep(axes={"uwb.link.loss": [0.0, 0.5, 0.9]})
    rows = [row_of(point, 0.2, lost) for point, lost in zip(points_of(of), (0, 2, 3), strict=True)]
    rows = [dataclasses.replace(row, kept_interval=(0.1, 0.4)) for row in rows]
    map_figure(Map(of, rows, "engine"), Path())
    (figure,) = drawn_figures
    lost, errors = figure.axes
    assert [axes.get_xlabel() for axes in figure.axes] == ["share of UWB messages lost [-]"] * 2
    assert (lost.get_ylabel(), errors.get_ylabel()) == ("flights lost [%]", "RMS error [m]")
    assert figure.get_suptitle() == "nominal_imu_uwb: 10 flights at each point"
    (bars,) = errors.containers
    np.testing.assert_allclose([bar[:, 1] for bar in bars.lines[2][0].get_segments()], [[0.1, 0.4]] * 3)
    figure.draw_without_rendering()
    for axes in figure.axes:  # the legend is above what is drawn
        assert axes.get_legend().get_window_extent().y0 >= axes.bbox.y1
    kept = [dataclasses.replace(row, lost=0) for row in rows]
    map_figure(Map(of, kept, "engine"), Path())
    none_lost = drawn_figures[1]
    (only,) = none_lost.axes
    assert only.get_ylabel() == "RMS error [m]"
    assert none_lost.get_supxlabel().startswith("None of the 30 flights was lost")


@pytest.mark.processes
def test_a_map_whose_command_is_killed_goes_on_to_the_same_table(tmp_path: Path) -> None:
    file, table = tmp_path / "sweep.yaml", "map.csv"
    file.write_text(
        "scenario: nominal_imu_uwb\nsettings: {planner: {kind: hover, duration: 2.0}}\n"
        f"axes: {{uwb.link.loss: {{start: 0.0, stop: 0.9, count: 6}}}}\nflights: {2 * CHUNK}\n"
    )
    command = [sys.executable, "-m", "ortilo_drake.cli", "map", str(file), "--workers", "2", "--out"]
    subprocess.run([*command, str(tmp_path / "whole")], check=True, capture_output=True, timeout=600)
    broken = subprocess.Popen(
        [*command, str(tmp_path / "broken")], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    while broken.poll() is None and not list((tmp_path / "broken").rglob("*.parquet")):
        pass
    os.kill(broken.pid, signal.SIGKILL)
    broken.wait()
    assert not (tmp_path / "broken" / table).exists()
    subprocess.run([*command, str(tmp_path / "broken")], check=True, capture_output=True, timeout=600)
    assert (tmp_path / "broken" / table).read_bytes() == (tmp_path / "whole" / table).read_bytes()
