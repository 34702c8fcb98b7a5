"""Figures and pages: files that other programs read, of a plausible size, not blank."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import xarray as xr

from ortilo_drake.flight.flight import fly
from ortilo_drake.flight.metrics import summary
from ortilo_drake.flight.summary import Loss
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import load_scenario
from ortilo_drake.studies.paper_tables.error_figure import error_figure
from ortilo_drake.views.figures import arrival_figure, flight_figure, trajectory_figure
from ortilo_drake.views.page.flight_page import flight_page

SHORT = "planner={kind: waypoints, points: [[0, 0, 1.5], [2.2, 0.9, 1.5]]}"
PROJECTED = "camera.kind=projected"
NAMES = ("imu_uwb", "imu_uwb_yolo")


@pytest.fixture(scope="module")
def flights(flown: Any) -> dict[str, list[xr.Dataset]]:
    """Return flights by names that have colours of their own; they are the nominal ones, which others fly too."""
    return {name: [flown(f"nominal_{name}", (SHORT, PROJECTED), seed) for seed in range(2)] for name in NAMES}


def read_picture(path: Path, width: int, height: int) -> np.ndarray:
    """Return a picture of about that size that shows more than its background."""
    picture = cv2.imread(str(path))
    assert picture is not None
    assert picture.shape == (pytest.approx(height, rel=0.05), pytest.approx(width, rel=0.05), 3)
    drawn = np.mean(np.any(picture != 255, axis=2))
    assert 0.01 < drawn < 0.9
    return picture


def test_trajectories(flights: dict[str, list[xr.Dataset]], tmp_path: Path) -> None:
    path = trajectory_figure(flights, tmp_path / "new" / "trajectories.png")
    picture = read_picture(path, 1430, 572)
    for colour in ((0x00, 0x72, 0xB2), (0xD5, 0x5E, 0x00)):  # each scenario's own
        assert np.any(np.all(np.abs(picture[..., ::-1].astype(int) - colour) < 12, axis=2))
    assert [p.name for p in path.parent.iterdir()] == ["trajectories.png"]


@pytest.mark.long
def test_errors(flights: dict[str, list[xr.Dataset]], tmp_path: Path) -> None:
    summaries = {name: [summary(flight) for flight in rows] for name, rows in flights.items()}
    drawn = read_picture(error_figure(summaries, tmp_path / "errors.png"), 1300, 468)
    beside = summaries | {"flow": summaries["imu_uwb"]}  # a scenario that the paper has not
    assert (read_picture(error_figure(beside, tmp_path / "beside.png"), 1300, 468) != drawn).any()


@pytest.mark.long
@pytest.mark.parametrize("left", [0, 1])
def test_errors_of_lost_flights_are_left_out(flights: dict[str, list[xr.Dataset]], tmp_path: Path, left: int) -> None:
    summaries = {
        name: [*(summary(f) for f in rows[:left]), replace(summary(rows[0]), lost=Loss(1.0, "tumbled"))]
        for name, rows in flights.items()
    }
    read_picture(error_figure(summaries, tmp_path / "errors.png"), 1300, 468)


@pytest.mark.long
def test_errors_of_flights_without_the_authors_path_error(flights: dict[str, list[xr.Dataset]], tmp_path: Path) -> None:
    summaries = {name: [replace(summary(f), path_mse=None) for f in rows] for name, rows in flights.items()}
    read_picture(error_figure(summaries, tmp_path / "errors.png"), 1300, 468)


def test_arrivals(flights: dict[str, list[xr.Dataset]], tmp_path: Path) -> None:
    path = arrival_figure({name: rows[0] for name, rows in flights.items()}, tmp_path / "arrivals.png")
    read_picture(path, 1300, 442)


@pytest.mark.long
@pytest.mark.parametrize("suffix", ["png", "jpg"])
def test_one_flight(flights: dict[str, list[xr.Dataset]], tmp_path: Path, suffix: str) -> None:
    read_picture(flight_figure(flights["imu_uwb"][0], tmp_path / f"flight.{suffix}"), 1430, 1066)


@pytest.mark.long
def test_a_flight_lost_at_once_can_be_drawn(tmp_path: Path) -> None:
    settings = ("planner={kind: hover, point: [8, 1, 1.5]}", "vehicle.inertia=[1.0e-9, 1.0e-9, 1.0e-9]")
    flight = fly(load_scenario("imu_uwb", settings))
    assert flight.sizes["tick"] <= 3
    read_picture(flight_figure(flight, tmp_path / "flight.png"), 1430, 1066)
    assert "<html" in flight_page(flight)


@pytest.mark.long
def test_an_unknown_kind_of_picture_is_refused(flights: dict[str, list[xr.Dataset]], tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"flight\.frog"):
        flight_figure(flights["imu_uwb"][0], tmp_path / "flight.frog")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
def test_a_picture_that_cannot_be_written_is_refused(flights: dict[str, list[xr.Dataset]], tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InputError, match="cannot be written"):
        flight_figure(flights["imu_uwb"][0], tmp_path / "file" / "flight.png")


@pytest.mark.long
def test_the_page_of_a_flight_is_one_self_contained_html_file(flights: dict[str, list[xr.Dataset]]) -> None:
    page = flight_page(flights["imu_uwb_yolo"][0])
    assert page.lstrip().lower().startswith("<!doctype html>")
    assert page.rstrip().endswith("</html>")
    assert 200_000 < len(page) < 20_000_000
    assert 'src="http' not in page
