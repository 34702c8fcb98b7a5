"""Figures and pages: files that other programs read, of a plausible size, not blank."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ortilo_drake.flight.blackouts import in_blackout
from ortilo_drake.flight.flight import fly, scenario_of
from ortilo_drake.flight.metrics import summary
from ortilo_drake.flight.summary import Loss
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import load_scenario
from ortilo_drake.studies.paper_tables.error_figure import error_figure
from ortilo_drake.views.blackout_figures import (
    availability,
    draw_availability,
    draw_blackout_errors,
    draw_errors_along_x,
    shade_blackouts,
    shade_blackouts_along_x,
)
from ortilo_drake.views.figures import arrival_figure, flight_figure, trajectory_figure
from ortilo_drake.views.page.flight_page import flight_page
from ortilo_drake.views.palette import COLOR

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


NAME = "nominal_imu_uwb_yolo"


@pytest.fixture(scope="module")
def flight(flown: Callable[..., xr.Dataset]) -> xr.Dataset:
    return flown(NAME, (SHORT, "camera.kind=projected"), 0)


@pytest.fixture(scope="module")
def blind(flown: Callable[..., xr.Dataset]) -> xr.Dataset:
    return flown("nominal_imu_uwb", (SHORT,), 0)


def labels(axes: Axes) -> list[str]:
    return axes.get_legend_handles_labels()[1]


def test_errors_and_standard_deviations_are_those_of_the_flight(flight: xr.Dataset, blind: xr.Dataset) -> None:
    figure = draw_blackout_errors({"with": flight, "without": blind}, "y")
    for axes, flown, title in zip(figure.axes, (flight, blind), ("with", "without"), strict=True):
        error, sd = axes.get_lines()
        np.testing.assert_array_equal(error.get_xdata(), flown["time"])
        wrong = flown["estimate"].sel(xbar="y").values - flown["truth"].sel(state="y").values
        np.testing.assert_array_equal(error.get_ydata(), np.abs(wrong))
        np.testing.assert_array_equal(sd.get_ydata(), np.sqrt(flown["covariance"].values[:, 1, 1]))
        assert axes.get_title(loc="left") == title
        assert axes.get_ylabel() == "y [m]"
    assert labels(figure.axes[0]) == ["|error in y|", "filter's sd"]
    assert figure.axes[1].get_xlabel().startswith("time [s]")


def test_the_shade_is_where_the_vehicle_was_in_a_blackout(flight: xr.Dataset) -> None:
    axes = Figure().subplots()
    shade_blackouts(axes, flight)
    (shade,) = axes.collections
    reached = np.concatenate([path.vertices[:, 0] for path in shade.get_paths()])
    dark = flight["time"].values[in_blackout(flight["truth"].values, scenario_of(flight))]
    assert len(dark) > 10
    assert (reached.min(), reached.max()) == (dark[0], dark[-1])


def test_the_shade_along_x_is_that_of_the_scenario(flight: xr.Dataset) -> None:
    axes = Figure().subplots()
    shade_blackouts_along_x(axes, scenario_of(flight))
    spans = [(patch.get_x(), patch.get_x() + patch.get_width()) for patch in axes.patches]
    np.testing.assert_allclose(spans, [(1.5, 5.5), (12.9, 14.0), (16.9, 18.8)])


def test_blackouts_in_time_are_not_shaded_along_x() -> None:
    from ortilo_drake.scenario import load_scenario

    axes = Figure().subplots()
    shade_blackouts_along_x(axes, load_scenario("outage"))
    assert list(axes.patches) == []


def test_uwb_is_available_outside_the_blackout_alone(flight: xr.Dataset) -> None:
    share = availability(flight, "uwb", np.array([0.1, 1.4, 1.6, 2.1, 9.0, 10.0]))
    assert share[0] == 1.0
    assert share[2] == 0.0
    assert np.isnan(share[4])  # nobody was there


def test_a_late_camera_fix_counts_for_the_picture_before_it(flight: xr.Dataset) -> None:
    everywhere = np.array([-5.0, 30.0])
    used = int(flight["arrival"].sel(sensor="camera").sum())
    due = int(flight["due"].sel(sensor="camera")[: -scenario_of(flight).camera.latency].sum())
    assert scenario_of(flight).camera.latency == 1
    assert availability(flight, "camera", everywhere) == pytest.approx([used / due])


def test_availability_has_the_fixes_errors_above_and_the_shares_below(flight: xr.Dataset) -> None:
    above, below = draw_availability(flight).axes
    (dots,) = above.get_lines()
    there = flight["arrival"].sel(sensor="camera").values
    fix = flight["measurement"].values[there, 3:6]
    error = np.linalg.norm(fix - flight["truth"].values[there, :3], axis=1)
    np.testing.assert_array_equal(dots.get_xdata(), flight["truth"].values[there, 0])
    np.testing.assert_allclose(dots.get_ydata(), np.maximum(error, 1e-3))
    assert above.get_ylabel() == "error of a fix [m]"
    assert below.get_xlabel().startswith("x (east) [m]")
    assert labels(below) == ["camera", "UWB"]


@pytest.mark.long
def test_availability_of_a_flight_without_camera_has_uwb_alone(blind: xr.Dataset) -> None:
    above, below = draw_availability(blind).axes
    assert above.get_lines() == []
    assert labels(below) == ["UWB"]


@pytest.mark.long
def test_errors_along_x_have_a_colour_by_scenario(flight: xr.Dataset, blind: xr.Dataset) -> None:
    (axes,) = draw_errors_along_x({"blind": blind, "seeing": flight}).axes
    for line, flown, color in zip(axes.get_lines(), (blind, flight), ("imu_uwb", "imu_uwb_yolo"), strict=True):
        e = flown["estimate"].values[:, :3] - flown["truth"].values[:, :3]
        np.testing.assert_allclose(line.get_ydata(), np.maximum(np.linalg.norm(e, axis=1), 1e-3))
        assert line.get_color() == COLOR[color]
    assert labels(axes) == ["blind", "seeing"]
    assert axes.get_ylabel() == "error of the estimate [m]"
