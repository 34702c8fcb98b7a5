"""Flights with a lens that bends: every player flies the same bits, and the boxes still say where the vehicle is."""

import json

import numpy as np
import pytest
from test_players import check_players

from ortilo_drake.flight.metrics import summary
from ortilo_drake.flight.players import fly
from ortilo_drake.scenario import Scenario, load_scenario

HOVER = ("planner={kind: hover, point: [8, 1, 1.5], duration: 2}", "settle=0.0", "camera.kind=projected")
LENSES = {
    "brown_conrady": [-0.2, 0.04, 0.002, -0.001],
    "fisheye": [-0.012, 0.031, -0.034, 0.011],
}


def scenario_of(distortion: str, *settings: str) -> Scenario:
    lens = {"distortion": distortion, "coefficients": LENSES.get(distortion, [])}
    camera = {"width": 1600, "height": 1200, "focal_length": [746.6, 731.2], "center": [810.5, 590.5]} | lens
    return load_scenario("imu_uwb_yolo", (*HOVER, f"camera.calibration={json.dumps(camera)}", *settings))


@pytest.mark.parametrize("distortion", LENSES)
def test_all_players_fly_the_same_bits(distortion: str) -> None:
    check_players(scenario_of(distortion), range(1))


@pytest.mark.parametrize("distortion", LENSES)
def test_fixes_of_bent_boxes_err_no_more_than_those_of_straight_ones(distortion: str) -> None:
    """Read as straight pixels they would be off by what the lens bends: some 20 px of 100, a metre at 5 m."""
    errors = {name: summary(fly(scenario_of(name))).fix_errors["camera"] for name in ("none", distortion)}
    bent, straight = errors[distortion], errors["none"]
    assert np.isfinite([bent.median, straight.median]).all()
    assert bent.median < 2.0 * straight.median + 0.02
