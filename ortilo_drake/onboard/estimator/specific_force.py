"""The accelerometer's rows of y: the specific force of the step just flown.

The imu's message of tick k holds f_B: all forces on the body but gravity, over its mass, in the step [t_{k-1}, t_k),
seen in B as it stands at t_k. Less the hover lift and turned by the yaw it is

    y_a = R_z(psi) (f_B - g e_z) = f / m + b + v_a

with f that step's force less the hover lift, in W to first order in the tilt: lift stands along B's own z axis, so that
no error of roll and pitch enters. f is a state (extra_states.py), and W correlates it with the velocity that it gave.
This correction by y_a equals a prediction by measured acceleration, R f_B - g e_z + b, in the filter's order of a tick.
"""

import numpy as np
from numba import njit

from ortilo_drake.model.signals import PAYLOAD
from ortilo_drake.model.vehicle import GRAVITY


@njit(cache=True)
def with_specific_force(
    y: np.ndarray, delta: np.ndarray, V2: np.ndarray, imu: np.ndarray, j: int, variance: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return y, delta and V2 with the accelerometer's rows after them; they arrive with the imu's angles.

    Args:
        y: values (p).
        delta: arrivals (s).
        V2: covariances, each row by row (q).
        imu: the imu message.
        j: number of the imu among the sensors.
        variance: of v_a per axis [m^2/s^4] (3).
    """
    p, s, q = y.size, delta.size, V2.size
    y_all, delta_all, V2_all = np.zeros(p + 3, y.dtype), np.zeros(s + 1, y.dtype), np.zeros(q + 9, y.dtype)
    y_all[:p], delta_all[:s], V2_all[:q] = y, delta, V2
    if delta[j] != 0.0:
        psi, f = imu[PAYLOAD + 2], imu[PAYLOAD + 6 : PAYLOAD + 9]
        y_all[p] = np.cos(psi) * f[0] - np.sin(psi) * f[1]
        y_all[p + 1] = np.sin(psi) * f[0] + np.cos(psi) * f[1]
        y_all[p + 2] = f[2] - GRAVITY
        delta_all[s] = 1.0
    for i in range(3):
        V2_all[q + 4 * i] = variance[i]
    return y_all, delta_all, V2_all
