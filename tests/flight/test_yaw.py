"""Flights that hold another heading than 0: as good as those along x, for the models are linear about it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ortilo_drake.flight.flight import fly
from ortilo_drake.flight.metrics import position_nees
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import M100
from ortilo_drake.onboard.servo.lq_gain import servo_gain
from ortilo_drake.scenario import load_scenario
from ortilo_drake.scenario.onboard import ServoWeights

WAY = ("planner={kind: waypoints, points: [[0, 0, 1.5], [1, -0.5, 1.5]], speed: 0.7}", "uwb.link.blackouts=[]")


@pytest.mark.family("1.57-nominal_imu_uwb")
@pytest.mark.parametrize("name", ["imu_uwb", "nominal_imu_uwb"])
@pytest.mark.parametrize("yaw", [1.57, np.pi, -2.2])
def test_a_flight_holds_the_heading_that_it_is_told(name: str, yaw: float) -> None:
    """With the model of yaw 0 it tumbled within 7 s."""
    flight = fly(load_scenario(name, (*WAY, f"servo.yaw={yaw}")))
    truth = flight["truth"].values
    assert flight.attrs["lost"] == "null"
    assert np.abs(truth[:, 5] - yaw).max() < 0.05
    assert np.linalg.norm(truth[:, :3] - flight["reference"].values, axis=1).max() < 0.25
    assert position_nees(flight)[1:].mean() < 8.0  # 3 if consistent; 20 of the model of yaw 0


@pytest.mark.parametrize("yaw", [0.4, np.pi, -2.0])
def test_the_gain_turns_with_the_heading(yaw: float) -> None:
    """Where x and y, roll and pitch weigh and weigh in alike, the problem is the same in axes that turn with it."""
    alike = M100.model_copy(update={"inertia": (0.16, 0.16, 0.2)})
    turn, L = Rotation.from_euler("z", yaw).as_matrix(), servo_gain(alike, ServoWeights(), 1.0 / 30.0)
    whole = np.eye(15)
    for at in (0, 6, 12):  # position, velocity and integral in W; angles and rates are about the body's axes
        whole[at : at + 3, at : at + 3] = turn
    np.testing.assert_allclose(servo_gain(alike, ServoWeights(), 1.0 / 30.0, yaw), L @ whole.T, atol=1e-8)


@pytest.mark.parametrize("settings", [("servo.form=paper",), ("world.kinematics=linear",)])
def test_what_knows_no_heading_refuses_one(settings: tuple[str, ...]) -> None:
    with pytest.raises(InputError, match=r"servo\.yaw: 1\.0: must be 0 with"):
        load_scenario("imu_uwb", (*settings, "servo.yaw=1.0"))
