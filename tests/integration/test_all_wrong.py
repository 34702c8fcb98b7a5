"""The filter that flies by default in a world where all that it does not know is wrong at once."""

import numpy as np
import pytest

from ortilo_drake.flight.flight import AXES, FlightSimulator
from ortilo_drake.flight.metrics import summary
from ortilo_drake.scenario import load_scenario
from ortilo_drake.studies.paper_tables.tables import PAPER

WRONG = (
    "truth.vehicle.mass_factor=1.1",
    "truth.vehicle.center_of_gravity=[0.007, -0.007]",  # a centimetre
    "truth.force.mean=[0.0, 0.5, 0.0]",
    "truth.imu.level=[0.0087, 0.0087]",  # half a degree
    "truth.imu.yaw=0.035",  # two degrees
    "truth.survey.anchors_sd=0.05",
    "truth.survey.landmarks_sd=0.05",
    "landmark_fix.shapes=boxes",
)


@pytest.mark.long
def test_with_the_camera_it_flies_as_well_as_the_paper_did() -> None:
    simulator = FlightSimulator(load_scenario("imu_uwb_yolo", ("camera.kind=projected", *WRONG)))
    flown = [summary(simulator.fly(seed)) for seed in range(3)]
    assert [s.lost for s in flown] == [None] * 3
    paper = PAPER.estimation["imu_uwb_yolo"]
    for axis in AXES:
        assert np.median([s.mse[axis] for s in flown]) < paper[axis]["median"], axis


@pytest.mark.long
def test_the_papers_filter_is_lost_there() -> None:
    flight = FlightSimulator(load_scenario("nominal_imu_uwb_yolo", ("camera.kind=projected", *WRONG))).fly(0)
    assert summary(flight).lost is not None
