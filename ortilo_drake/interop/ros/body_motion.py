"""Pose and motion of the body as ROS has them: quaternions, and velocities in the body's own axes.

REP 103 and 105: the map frame is W (east, north, up), base_link is B (forward, left, up).
"""

import numpy as np
from numba import njit

from ortilo_drake.model.equations import body_rates, euler_rate_matrix, rotation_matrix
from ortilo_drake.onboard.estimator.tight.inertial import quaternion_of


@njit(cache=True)
def quaternion(rpy: np.ndarray) -> np.ndarray:
    """Return q_WB = q_z(psi) q_y(theta) q_x(phi) as (x, y, z, w)."""
    return np.roll(quaternion_of(rpy), -1)


@njit(cache=True)
def pose_and_twist(x: np.ndarray) -> np.ndarray:
    """Return p_WB (3), q_WB as (x, y, z, w) (4), v_WB in B (3), w_WB_B (3) from a state's first twelve entries."""
    v_B = rotation_matrix(x[3:6]).T @ np.ascontiguousarray(x[6:9])
    return np.concatenate((x[0:3], quaternion(x[3:6]), v_B, body_rates(x[3:6], x[9:12])))


@njit(cache=True)
def twist_covariance(x: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Return the covariance of (v_WB in B, w_WB_B) as T P_v T' with T = diag(R_BW, E(rpy)) (6, 6).

    P_v is P's block of velocity and Euler rates. What the attitude's own error adds by turning the axes is left out:
    it is the product of an angle's error and a speed.

    Args:
        x: the estimate (at least 12).
        P: its covariance (at least 12, 12).
    """
    T = np.zeros((6, 6))
    T[0:3, 0:3] = rotation_matrix(x[3:6]).T
    T[3:6, 3:6] = euler_rate_matrix(x[3:6])
    return T @ np.ascontiguousarray(P[6:12, 6:12]) @ T.T
