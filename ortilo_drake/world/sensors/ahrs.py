"""The error of an attitude filter that takes the specific force for gravity while the vehicle accelerates.

Roll and pitch of a complementary filter follow the integrated body rates at high frequency, and the angles of the
specific force f_B at low frequency, with the time constant T (R. Mahony, T. Hamel and J.-M. Pflimlin, "Nonlinear
complementary filters on the special orthogonal group", IEEE Transactions on Automatic Control 53(5), 2008, k_P = 1 /
T). f_B = R_WB^T (v_dot + g e_z) has the angles

    phi_f = atan2(f_y, f_z),   theta_f = atan2(-f_x, sqrt(f_y^2 + f_z^2)),

which are the body's only while v_dot = 0. So the error e = [roll, pitch, yaw] obeys

    e_{k+1} = a e_k + (1 - a) (angles of f - true angles),   a = exp(-h / T),

for roll and pitch, as far as the body turns about its own axes by the true rates. Under a lasting acceleration c the
pitch error is atan(c / g) (1 - exp(-t / T)). Nothing corrects the yaw: its error grows by h r in every tick.
"""

from typing import Any

import numpy as np

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.equations import rotation_rows
from ortilo_drake.model.placing import put, sample_of
from ortilo_drake.model.signals import ARRIVED, PAYLOAD
from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.scenario.sensors import Ahrs

STREAM = "imu/ahrs drift"


def ahrs_out(n: Any, message: np.ndarray, e: np.ndarray, out: np.ndarray) -> None:
    """Output an imu message with the attitude filter's angles, for each of its samples."""
    put(message, out)
    for i in range(n.samples):
        sample = sample_of(out, i, n.samples)
        if sample[ARRIVED] != 0.0:
            for j in range(3):
                sample[PAYLOAD + j] += e[j]


def ahrs_step(n: Any, state: np.ndarray, acceleration: np.ndarray, e: np.ndarray) -> None:
    """Advance the error to the next tick."""
    R_WB = rotation_rows(state[3:6])
    g_x, g_y, g_z = acceleration[0], acceleration[1], acceleration[2] + GRAVITY
    f_x = R_WB[0][0] * g_x + R_WB[1][0] * g_y + R_WB[2][0] * g_z
    f_y = R_WB[0][1] * g_x + R_WB[1][1] * g_y + R_WB[2][1] * g_z
    f_z = R_WB[0][2] * g_x + R_WB[1][2] * g_y + R_WB[2][2] * g_z
    e[0] = n.a * e[0] + (1.0 - n.a) * (np.arctan2(f_y, f_z) - state[3])
    e[1] = n.a * e[1] + (1.0 - n.a) * (np.arctan2(-f_x, np.sqrt(f_y * f_y + f_z * f_z)) - state[4])
    e[2] = e[2] + n.h * n.drift


AHRS = Element("ahrs", out=ahrs_out, step=ahrs_step, allocates=True)


def ahrs_box(settings: Ahrs, message: Box, samples: int, h: float) -> Box:
    """Return the attitude filter of an imu whose messages the box outputs; its yaw drifts only if a drift is drawn.

    It reads the true state (12) and the acceleration of B's origin in W (3).
    """
    numbers = {"samples": samples, "a": np.exp(-h / settings.time), "drift": 0.0, "h": h}
    given = Values(numbers, start={"e": np.zeros(3)})
    return Box("imu_ahrs", AHRS, message.size, given, reads={"message": message.name})
