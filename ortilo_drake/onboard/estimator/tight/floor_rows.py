"""Measurement rows of two sensors that look down, along -z of the body: a range finder and an optical flow sensor.

    r   = (p_z + (R l)_z - floor) / R_33
    y_0 = -K (1 + s) (v_B,y R_33 / h + w_x),   y_1 = -K (1 + s) (v_B,x R_33 / h - w_y),   h = p_z - floor

with the finder at l in B, K the pixels per rad/s, s the relative error of K, and w the body rates less their bias.

Source of the flow rows: Greiff, "Modelling and control of the Crazyflie quadrotor", Lund, 2017, section 5.3; the axes
are those of the source and of the sensor's driver.
"""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.onboard.estimator.tight.layout import GYRO, THETA, P, V


@register_jitable
def finder_row(
    p: np.ndarray, R: np.ndarray, lever: np.ndarray, floor: float, where: np.ndarray, row: np.ndarray
) -> float:
    """Return the predicted distance [m] and write its gradient by (dp_z, theta) to the first four of where and row.

    p is p_WB, R is R_WB with R_33 > 0, `lever` is l (3) [m], `floor` is the floor's z [m].
    """
    down = R[2]
    height = p[2] - floor + down[0] * lever[0] + down[1] * lever[1] + down[2] * lever[2]
    r = height / down[2]
    where[0], row[0] = P + 2, 1.0 / down[2]
    for i in range(3):  # (R (theta x l))_z = theta . (l x down), and R_33 changes by down_0 theta_y - down_1 theta_x
        j, k = (i + 1) % 3, (i + 2) % 3
        where[1 + i], row[1 + i] = THETA + i, (lever[j] * down[k] - lever[k] * down[j]) / down[2]
    row[1] += r * down[1] / down[2]
    row[2] -= r * down[0] / down[2]
    return r


@register_jitable
def flow_row(
    axis: int,
    p: np.ndarray,
    v: np.ndarray,
    R: np.ndarray,
    w: np.ndarray,
    floor: float,
    pixels: float,
    scale: float,
    scale_at: int,
    where: np.ndarray,
    row: np.ndarray,
) -> float:
    """Return the predicted flow y_axis [px] and write its gradient to the first nine of where and row.

    p is p_WB, v is v_WB, R is R_WB, w are the body rates less their bias (3), `floor` is the floor's z [m], `pixels` is
    K and `scale` is s, which has index scale_at in the error state.
    """
    i, h, gain = 1 - axis, p[2] - floor, -pixels * (1.0 + scale)  # y_0 depends on v_B,y, y_1 on v_B,x
    down = R[2]
    v_B = np.array([R[0, k] * v[0] + R[1, k] * v[1] + R[2, k] * v[2] for k in range(3)])
    turns = w[0] if axis == 0 else -w[1]
    sees = v_B[i] * down[2] / h + turns
    where[0], row[0] = P + 2, -gain * v_B[i] * down[2] / h**2
    for k in range(3):
        where[1 + k], row[1 + k] = V + k, gain * R[k, i] * down[2] / h
        where[4 + k], row[4 + k] = THETA + k, 0.0
    j, k = (i + 1) % 3, (i + 2) % 3  # row i of [v_B]x
    row[4 + j] -= gain * v_B[k] * down[2] / h
    row[4 + k] += gain * v_B[j] * down[2] / h
    row[4] -= gain * v_B[i] * down[1] / h
    row[5] += gain * v_B[i] * down[0] / h
    where[7], row[7] = GYRO + axis, -gain if axis == 0 else gain
    where[8], row[8] = scale_at, -pixels * sees
    return gain * sees
