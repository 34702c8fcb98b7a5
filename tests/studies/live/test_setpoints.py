"""What holds a place, and when the failsafe lets no setpoint through."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.scenario import load_scenario
from ortilo_drake.studies.live.setpoints import FLOWN_BY, Holding
from ortilo_drake.studies.live.stamped_estimate import StampedEstimate


def at(t, p, sd=0.01, yaw_sd=0.01, yaw=0.0):
    estimate, covariance = np.zeros(15), sd**2 / 3.0 * np.eye(15)
    estimate[:3], estimate[5], covariance[5, 5] = p, yaw, yaw_sd**2
    return StampedEstimate(t, estimate, covariance)


def holding(yaw=None):
    return Holding(load_scenario("nominal_imu_uwb"), (1.0, 2.0, 1.5), yaw)


def test_at_the_place_it_hovers() -> None:
    one = holding().setpoint(at(1.0, (1.0, 2.0, 1.5)), 1.0)
    np.testing.assert_allclose(one.rpy, 0.0, atol=1e-12)
    assert one.thrust == pytest.approx(GRAVITY)
    assert one.refused == ""


def test_beside_it_it_leans_back_and_below_it_it_climbs() -> None:
    one = holding().setpoint(at(1.0, (1.3, 1.8, 1.4)), 1.0)
    roll, pitch, _ = one.rpy
    assert pitch < 0.0  # thrust to -x
    assert roll < 0.0  # and to +y
    assert one.thrust > GRAVITY


def test_an_error_that_lasts_is_leant_against_more_and_more() -> None:
    hold = holding()
    pitches = [hold.setpoint(at(0.1 * k, (1.1, 2.0, 1.5)), 0.1 * k).rpy[1] for k in range(20)]
    assert (np.diff(pitches) < 0.0).all()


@pytest.mark.parametrize(
    ("stamped", "why"),
    [
        (at(0.7, (1.0, 2.0, 1.5)), "older than 0.2 s"),
        (at(1.0, (1.0, 2.0, 1.5), 1.01 * FLOWN_BY.deviation), "deviation"),
        (at(1.0, (1.0, 2.0, 1.5), np.nan), "deviation"),
        (at(1.0, (1.0, 2.0, 1.5), yaw_sd=np.radians(23.0)), "heading"),  # of a body at rest, whose heading is guessed
    ],
)
def test_the_failsafe_refuses_what_is_old_or_uncertain(stamped: StampedEstimate, why: str) -> None:
    assert why in holding().setpoint(stamped, 1.0).refused


def test_without_a_yaw_the_present_one_is_held() -> None:
    hold = holding()
    asked = [hold.setpoint(at(0.1 * k, (1.0, 2.0, 1.5), yaw=0.4 + 0.02 * k), 0.1 * k).rpy[2] for k in range(5)]
    np.testing.assert_allclose(asked, 0.4)
    assert hold.aim == "(1, 2, 1.5) m, yaw 0.40 rad"


def test_a_yaw_is_turned_to_slowly_and_the_short_way() -> None:
    """From 3 rad to -3 rad by 0.283 rad through pi, at 0.3 rad/s."""
    hold = holding(-3.0)
    asked = np.array([hold.setpoint(at(0.1 * k, (1.0, 2.0, 1.5), yaw=3.0), 0.1 * k).rpy[2] for k in range(15)])
    np.testing.assert_allclose(asked[:9], 3.0 + 0.03 * np.arange(9))
    np.testing.assert_allclose(asked[10:], 2.0 * np.pi - 3.0)


def test_the_thrust_points_to_the_place_whatever_the_yaw() -> None:
    """Body axes by SciPy's rotations: north of the place it leans south."""
    for yaw in (0.0, 1.0, -2.5):
        rpy = holding().setpoint(at(1.0, (1.0, 2.3, 1.5), yaw=yaw), 1.0).rpy
        thrust = Rotation.from_euler("ZYX", rpy[::-1]).apply([0.0, 0.0, 1.0])
        assert thrust[0] == pytest.approx(0.0, abs=1e-9)
        assert thrust[1] < -0.01


def test_setpoints_begin_near_the_place_and_stop_far_from_it() -> None:
    hold = holding()

    def refused(t, off):
        return hold.setpoint(at(t, (1.0 + off, 2.0, 1.5)), t).refused

    assert refused(0.0, 0.6) == "the position to hold is too far: setpoints begin within 0.5 m and stop beyond 2 m"
    assert refused(0.1, 0.4) == refused(0.2, 1.9) == ""  # a gust
    assert "the position to hold is too far" in refused(0.3, 2.1)
    assert "the position to hold is too far" in refused(0.4, 1.9)


def test_a_place_far_outside_the_anchors_is_refused() -> None:
    anchors = np.array([(0.0, 0.0, 0.0), (4.0, 0.0, 2.0), (4.0, 3.0, 0.0), (0.0, 3.0, 2.0)])
    holding().check_within(anchors)
    holding().check_within(anchors * [1.0, 1.0, 0.0] + [0.0, 0.0, 5.0])  # all at the ceiling
    with pytest.raises(InputError, match=r"--hold: \(1, 2, 1.5\): must be within 2 m of the anchors"):
        holding().check_within(anchors + [9.0, 0.0, 0.0])
