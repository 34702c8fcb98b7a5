"""A live filter's estimate as the paper's state and covariance, and the uncertainty beyond which it is not sent.

MAVLink's ODOMETRY has a `quality` for this, but EKF2 ignores it unless EKF2_EV_QMIN is set. Every autopilot handles a
missing estimate: it goes on by its own sensors, and then does what it is set to do.
"""

from typing import Final, NamedTuple

import numpy as np

from ortilo_drake.model.signals import N_X, N_XBAR
from ortilo_drake.onboard.estimator.tight.attitude_rows import inverse_rate_matrix
from ortilo_drake.onboard.estimator.tight.inertial import angles_of
from ortilo_drake.onboard.estimator.tight.layout import ADDITIVE, GYRO, THETA, P, Q, V
from ortilo_drake.studies.recorded.filter_types import State

MOST_YAW: Final = 0.5  # largest standard deviation of a heading that is sent [rad]
AGAIN: Final = 0.8  # estimates are sent again below this share of a limit, so that noise does not switch them
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


class Limits(NamedTuple):
    """The largest standard deviations: of the position, the three axes together [m], and of the heading [rad]."""

    deviation: float
    yaw: float

    def why_not(self, stamped: StampedEstimate, share: float = 1.0) -> str:
        """Return which limit times `share` an estimate exceeds, in words; empty if none. NaN exceeds all limits."""
        if not stamped.deviation <= share * self.deviation:
            return f"its standard deviation is above {self.deviation:g} m"
        if not stamped.yaw_deviation <= share * self.yaw:
            return f"the standard deviation of its heading is above {self.yaw:g} rad"
        return ""


ALL: Final = Limits(np.inf, np.inf)  # lets every estimate through that is not NaN


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
