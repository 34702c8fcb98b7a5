"""What holds a place, and when the failsafe lets no setpoint through."""

import numpy as np
import pytest

from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.scenario import load_scenario
from ortilo_drake.studies.live.setpoints import FLOWN_BY, Holding
from ortilo_drake.studies.live.stamped_estimate import StampedEstimate


def at(t, p, sd=0.01, yaw_sd=0.01):
    estimate, covariance = np.zeros(15), sd**2 / 3.0 * np.eye(15)
    estimate[:3], covariance[5, 5] = p, yaw_sd**2
    return StampedEstimate(t, estimate, covariance)


def holding():
    return Holding(load_scenario("nominal_imu_uwb"), (1.0, 2.0, 1.5))


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


def test_a_place_far_outside_the_anchors_is_refused() -> None:
    anchors = np.array([(0.0, 0.0, 0.0), (4.0, 0.0, 2.0), (4.0, 3.0, 0.0), (0.0, 3.0, 2.0)])
    holding().check_within(anchors)
    holding().check_within(anchors * [1.0, 1.0, 0.0] + [0.0, 0.0, 5.0])  # all at the ceiling
    with pytest.raises(InputError, match=r"--hold: \(1, 2, 1.5\): must be within 2 m of the anchors"):
        holding().check_within(anchors + [9.0, 0.0, 0.0])
