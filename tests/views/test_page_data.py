"""What the page of a flight is told: blackouts, their zones, and pictures of the camera."""

import base64
import re
from typing import Any

import cv2
import numpy as np
import pytest

from ortilo_drake.scenario import load_scenario
from ortilo_drake.views.page.flight_data import blackout_zones, intervals
from ortilo_drake.views.page.flight_page import onboard_pictures
from ortilo_drake.views.page.svg import round_up, time_ticks


def test_zones_are_where_a_link_is_blacked_out_and_within_the_room() -> None:
    blackouts = (
        "uwb.link.blackouts=[{kind: position, axis: x, start: 2, end: 5},"
        " {kind: position, axis: y, start: -99, end: 0.5},"
        " {kind: position, axis: z, start: 1, end: 2}, {kind: time, start: 1, end: 2}]"
    )
    scenario = load_scenario("imu_uwb", (blackouts,))
    room = scenario.load_room()
    (west, south), (east, north) = room.interior.min[:2], room.interior.max[:2]
    first, second = blackout_zones(scenario, room)
    assert (first.low, first.high) == ((2, south), (5, north))
    assert (second.low, second.high) == ((west, south), (east, 0.5))


@pytest.mark.parametrize(
    ("mask", "found"),
    [
        ([0, 0, 0, 0], []),
        ([1, 1, 0, 0], [(0.0, 2.0)]),
        ([0, 1, 0, 1], [(1.0, 2.0), (3.0, 3.0)]),
        ([1, 1, 1, 1], [(0.0, 3.0)]),
    ],
)
def test_intervals_of_a_mask(mask: list[int], found: list[tuple[float, float]]) -> None:
    assert intervals(np.arange(4.0), np.array(mask, dtype=bool)) == found


def test_axes_have_round_numbers() -> None:
    limits = {0.031: 0.035, 0.068: 0.07, 0.1: 0.1, 0.101: 0.15, 7.6: 8.0, 20.0: 20.0}
    assert {limit: round_up(limit) for limit in limits} == pytest.approx(limits)
    ticks = time_ticks({"time": [0.0, 74.27]})
    assert re.findall(r">(\S+?)<", ticks) == ["0", "10", "20", "30", "40", "50", "60", "70"]
    assert re.findall(r"left:([\d.]+)%", ticks)[1] == f"{100 * 10 / 74.27:.2f}"


@pytest.mark.egl
@pytest.mark.long
def test_pictures_of_a_rendered_camera_are_taken_twice_a_second(flown: Any) -> None:
    flight = flown("imu_uwb_yolo", ("planner={kind: waypoints, points: [[0, 0, 1.5], [1, 0.4, 1.5]]}",), 0)
    pictures = onboard_pictures(flight)
    np.testing.assert_allclose(pictures["time"], np.arange(len(pictures["time"])) * 0.5, atol=1e-3)
    assert pictures["time"][-1] + 0.5 > flight["time"].values[-1]
    for jpeg in pictures["jpeg"]:
        picture = cv2.imdecode(np.frombuffer(base64.b64decode(jpeg), np.uint8), cv2.IMREAD_COLOR)
        assert picture.shape == (240, 320, 3)
        assert picture.std() > 20  # shows something


@pytest.mark.long
def test_there_are_no_pictures_of_a_projected_camera(flown: Any) -> None:
    settings = ("planner={kind: waypoints, points: [[0, 0, 1.5], [2.2, 0.9, 1.5]]}", "camera.kind=projected")
    found = onboard_pictures(flown("imu_uwb_yolo", settings, 0))
    assert found == {"time": [], "jpeg": [], "none": "this flight has no rendered camera"}
