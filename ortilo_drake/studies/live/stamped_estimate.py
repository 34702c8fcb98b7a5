"""A live filter's estimate in the form of the rest of the package: the paper's state and its covariance."""

from typing import NamedTuple

import numpy as np

from ortilo_drake.model.signals import N_X, N_XBAR
from ortilo_drake.onboard.estimator.tight.attitude_rows import inverse_rate_matrix
from ortilo_drake.onboard.estimator.tight.inertial import angles_of
from ortilo_drake.onboard.estimator.tight.layout import ADDITIVE, GYRO, THETA, P, Q, V
from ortilo_drake.studies.recorded.filter_types import State

NOT_ESTIMATED = np.pi**2, 100.0  # variances of the angles and of their rates without an imu [rad²], [rad²/s²]


class StampedEstimate(NamedTuple):
    """Stamp by the sensors' clock [s], estimate [p, rpy, v, rpy rates, 0] (15), covariance (15, 15)."""

    t: float
    estimate: np.ndarray
    covariance: np.ndarray

    @property
    def deviation(self) -> float:
        """The standard deviation of the position, the three axes together [m]."""
        return float(np.sqrt(np.trace(self.covariance[:3, :3])))

    @property
    def yaw_deviation(self) -> float:
        """The standard deviation of the yaw [rad]."""
        return float(np.sqrt(self.covariance[5, 5]))


def estimate_at(t: float, state: State, imu: bool) -> StampedEstimate:
    """Return the pose and velocities, with covariances, of a filter state at a stamp [s].

    A small turn theta of the body changes the angles by d rpy = E^-1 theta. The error of the rates is the gyro bias's;
    their covariance leaves out the noise of the latest sample. Without an imu, attitude and rates are not estimated: 0.
    """
    x, estimate, J = state.x, np.zeros(N_XBAR), np.zeros((N_X, GYRO + 3))
    estimate[0:3], estimate[6:9] = x[P : P + 3], x[V : V + 3]
    J[0:3, P : P + 3], J[6:9, V : V + 3] = np.eye(3), np.eye(3)
    C = np.zeros((N_XBAR, N_XBAR))
    if imu:
        rpy = angles_of(x[Q : Q + 4])
        E = inverse_rate_matrix(rpy)
        estimate[3:6], estimate[9:12] = rpy, E @ (state.held[:3] - x[ADDITIVE : ADDITIVE + 3])
        J[3:6, THETA : THETA + 3], J[9:12, GYRO : GYRO + 3] = E, -E
    C[:N_X, :N_X] = J @ state.C[: GYRO + 3, : GYRO + 3] @ J.T
    if not imu:
        C[3:6, 3:6], C[9:12, 9:12] = (variance * np.eye(3) for variance in NOT_ESTIMATED)
    return StampedEstimate(t, estimate, C)
