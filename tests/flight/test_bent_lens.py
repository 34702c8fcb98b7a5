"""Flights with a lens that bends: every player flies the same bits, and the boxes still say where the vehicle is."""

import json

import numpy as np
import pytest
from test_players import check_players

from ortilo_drake.flight.metrics import summary
from ortilo_drake.flight.players import fly
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.sensors.camera import drawn
from ortilo_drake.world.drawn_truth import draw_truth
from ortilo_drake.world.sensors.landmark_view import landmark_views, surroundings

HOVER = ("planner={kind: hover, point: [8, 1, 1.5], duration: 2}", "settle=0.0", "camera.kind=projected")
LENSES = {
    "brown_conrady": [-0.2, 0.04, 0.002, -0.001],
    "fisheye": [-0.012, 0.031, -0.034, 0.011],
}


def scenario_of(distortion: str, *settings: str) -> Scenario:
    lens = {"distortion": distortion, "coefficients": LENSES.get(distortion, [])}
    camera = {"width": 1600, "height": 1200, "focal_length": [746.6, 731.2], "center": [810.5, 590.5]} | lens
    return load_scenario("nominal_imu_uwb_yolo", (*HOVER, f"camera.calibration={json.dumps(camera)}", *settings))


@pytest.mark.long
@pytest.mark.parametrize("distortion", LENSES)
def test_all_players_fly_the_same_bits(distortion: str) -> None:
    check_players(scenario_of(distortion), range(1))


@pytest.mark.family
@pytest.mark.parametrize("distortion", LENSES)
def test_fixes_of_bent_boxes_err_no_more_than_those_of_straight_ones(distortion: str) -> None:
    """Read as straight pixels they would be off by what the lens bends: some 20 px of 100, a metre at 5 m."""
    errors = {name: summary(fly(scenario_of(name))).fix_errors["camera"] for name in ("none", distortion)}
    bent, straight = errors[distortion], errors["none"]
    assert np.isfinite([bent.median, straight.median]).all()
    assert bent.median < 2.0 * straight.median + 0.02


@pytest.mark.parametrize("distortion", LENSES)
def test_a_camera_of_another_focal_length_loses_no_landmark(distortion: str) -> None:
    """It leaves out what lies aside of the image: of the image that it takes, not of the one that is believed."""
    scenario = scenario_of(distortion, "truth.camera.focal_factor=0.8")
    room = scenario.load_room()
    true = drawn(scenario, room, draw_truth(scenario.truth, 0, room, {"uwb": 24, "camera": 0, "imu": 9}), {})["camera"]
    believed = room.camera.scaled_to(scenario.image_width).constants
    assert true.numbers["camera_f"] == pytest.approx(0.8 * believed.f)
    limits, generator, seen = np.array([np.inf, 1.0, 1.0]), np.random.default_rng(0), 0
    for _ in range(400):
        x = np.array([*generator.uniform([0.0, -1.0, 1.0], [17.0, 1.0, 2.0]), *generator.normal(0.0, 0.3, 3)])
        views = list[np.ndarray]()
        for reach in (true.tables["camera_lens_reach"], np.full(2, np.inf)):
            camera = believed._replace(f=true.numbers["camera_f"], lens=believed.lens._replace(reach=reach))
            views.append(landmark_views(x, surroundings(room), camera, limits))
        np.testing.assert_array_equal(views[0], views[1])
        seen += len(views[0])
    assert seen > 1000
