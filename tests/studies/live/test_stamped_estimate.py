"""The live filter's state as the paper's: angles as SciPy's, and the covariance of errors that are drawn."""

import numpy as np
from scipy.spatial.transform import Rotation

from ortilo_drake.studies.live.stamped_estimate import estimate_at
from ortilo_drake.studies.recorded.filter_types import State

RPY = np.array([0.2, -0.4, 2.0])


def a_state(C):
    x = np.zeros(len(C) + 1)
    x[0:3], x[3:6] = (1.0, 2.0, 3.0), (0.1, 0.2, 0.3)
    x[6:10] = Rotation.from_euler("ZYX", RPY[::-1]).as_quat(scalar_first=True)
    x[10:13] = 0.01, -0.02, 0.03
    held = np.array([0.3, -0.2, 0.1, 0.0, 0.0, 9.81])
    return State(1.0, x, C, held, np.zeros(7))


def test_the_angles_and_their_rates_are_the_attitude_s() -> None:
    state = a_state(np.eye(18))
    one = estimate_at(5.0, state, True)
    np.testing.assert_allclose(one.estimate[3:6], RPY, atol=1e-12)
    np.testing.assert_allclose(one.estimate[0:3], state.x[0:3])
    np.testing.assert_allclose(one.estimate[6:9], state.x[3:6])
    h = 1e-6
    turned = Rotation.from_quat(state.x[6:10], scalar_first=True) * Rotation.from_rotvec(
        h * np.array([0.29, -0.18, 0.07])
    )
    rates = (turned.as_euler("ZYX")[::-1] - RPY) / h
    np.testing.assert_allclose(one.estimate[9:12], rates, atol=1e-5)
    assert one.t == 5.0


def test_the_covariance_is_that_of_drawn_errors() -> None:
    rng = np.random.default_rng(0)
    M = 1e-3 * rng.normal(size=(18, 18))
    C = M @ M.T
    state = a_state(C)
    errors = rng.multivariate_normal(np.zeros(18), C, 20_000)
    drawn = np.empty((len(errors), 6))
    q = Rotation.from_quat(state.x[6:10], scalar_first=True) * Rotation.from_rotvec(errors[:, 6:9])
    drawn[:, 3:6] = q.as_euler("ZYX")[:, ::-1]
    drawn[:, 0:3] = state.x[0:3] + errors[:, 0:3]
    one = estimate_at(5.0, state, True)
    P = one.covariance[:6, :6]
    scale = np.sqrt(np.outer(np.diag(P), np.diag(P)))
    assert np.abs((np.cov(drawn.T) - P) / scale).max() < 0.05
    assert one.deviation == np.sqrt(np.trace(C[:3, :3]))


def test_without_an_imu_the_attitude_is_not_claimed() -> None:
    one = estimate_at(5.0, a_state(1e-4 * np.eye(18)), False)
    assert (one.estimate[3:6] == 0.0).all()
    assert np.diag(one.covariance)[3:6].min() > 1.0
    assert np.diag(one.covariance)[0] == 1e-4
