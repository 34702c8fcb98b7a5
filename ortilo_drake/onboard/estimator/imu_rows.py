"""The accelerometer's and the gyroscope's rows of y, made from the imu's message.

The message of tick k holds the specific force f_B: all forces but gravity over the mass, in the step [t_{k-1}, t_k), in
the axes of B at t_k. Turned by the yaw, and less the hover lift, it is

    y_a = R_z(psi) (f_B - g e_z) = f / m + b + v_a

with f the force of that step less the hover lift, in W to first order in the tilt. The lift acts along z_B, so no error
of roll and pitch enters. f is a state (extra_states.py); W correlates f with the velocity that f caused. In the
filter's order of a tick, the update with y_a equals a prediction with the measured acceleration R f_B - g e_z + b.

The message also holds the body rates w at t_k. With the roll and pitch of the same message, the Euler-angle rates are

    y_g = E(rpy)^-1 w = [phi_dot, theta_dot, psi_dot] + c + v_g

with c the gyroscope's bias; this holds to first order in the tilt.
"""

from types import SimpleNamespace
from typing import Any

import numpy as np

from ortilo_drake.loop.element import Box, Element, Values, parts_of
from ortilo_drake.model.elementary import sin_cos
from ortilo_drake.model.equations import euler_rates
from ortilo_drake.model.measurement import Measurement
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.signals import PAYLOAD
from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.model.white_noise import white_variances
from ortilo_drake.scenario import Belief


def imu_variances(scenario: Belief) -> np.ndarray | None:
    """Return the variances of v_a [m^2/s^4] (3), followed by those of v_g [rad^2/s^2] if the filter uses rates (6).

    The result is None if the scenario's filter uses neither. If the imu is faster than the tick, the filter gets the
    mean of the samples of a tick.
    """
    settings = scenario.linear_filter
    if settings is None or settings.force != "measured":
        return None
    rates = settings.V.rates if settings.rates == "measured" else ()
    return white_variances((*settings.V.specific_force, *rates), scenario.h)


def imu_rows_out(
    n: Any,
    y: np.ndarray,
    delta: np.ndarray,
    V2: np.ndarray,
    stamps: np.ndarray,
    imu: np.ndarray,
    variances: np.ndarray,
    out: np.ndarray,
) -> None:
    """Output [y, delta, V2, stamps], with the accelerometer's rows appended, and with six variances the gyroscope's.

    Each of the two adds 3, 1, 9 and 1 numbers to y (p), delta (s), V2 (q) and stamps (s); n.number is the imu's index
    among the sensors. Their rows arrive with the imu's angles and have the stamp of the imu's message. The variances (3
    or 6) are of v_a per axis [m^2/s^4], then of v_g per angle [rad^2/s^2].
    """
    p, s, q, m = y.size, delta.size, V2.size, variances.size // 3
    at_delta = p + 3 * m
    at_V2 = at_delta + s + m
    at_stamps = at_V2 + q + 9 * m
    fill(out[:at_stamps], 0.0)
    put(y, out)
    put(delta, out, at_delta)
    put(V2, out, at_V2)
    fill(out[at_stamps:], stamps[n.number])
    put(stamps, out, at_stamps)
    if delta[n.number] != 0.0:
        psi, f = imu[PAYLOAD + 2], imu[PAYLOAD + 6 : PAYLOAD + 9]
        s_psi, c_psi = sin_cos(psi)
        out[p] = c_psi * f[0] - s_psi * f[1]
        out[p + 1] = s_psi * f[0] + c_psi * f[1]
        out[p + 2] = f[2] - GRAVITY
        if m > 1:
            put(euler_rates(imu[PAYLOAD : PAYLOAD + 3], imu[PAYLOAD + 3 : PAYLOAD + 6]), out, p + 3)
        for i in range(m):
            out[at_delta + s + i] = 1.0
    for i in range(3 * m):
        out[at_V2 + q + 9 * (i // 3) + 4 * (i % 3)] = variances[i]


def with_imu_rows(
    y: np.ndarray, delta: np.ndarray, V2: np.ndarray, imu: np.ndarray, j: int, variances: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return y, delta and V2 with the imu's rows, as imu_rows_out does; j is the imu's index among the sensors."""
    m, s = len(variances) // 3, len(delta)
    ends = np.cumsum([len(y) + 3 * m, s + m, len(V2) + 9 * m])
    out = np.zeros(ends[-1] + s + m)
    imu_rows_out(SimpleNamespace(number=j), y, delta, V2, np.zeros(s), imu, variances, out)
    y_all, delta_all, V2_all, _ = np.split(out, ends)
    return y_all, delta_all, V2_all


def imu_rows_box(measurement: Measurement, variances: np.ndarray) -> Box:
    """Return the box that appends the imu's rows; it reads the arrived imu message, y, delta, V2 and stamps.

    `measurement` is the one without these rows; `variances` comes from imu_variances.
    """
    m, (p, s, q) = len(variances) // 3, measurement.sizes.values()
    p, s, q = p + 3 * m, s + m, q + 9 * m
    parts = parts_of({"y": p, "delta": s, "V2": q, "stamps": s})
    given = Values({"number": measurement.inertial}, tables={"variances": variances})
    return Box("imu_rows", Element("imu_rows", out=imu_rows_out), p + 2 * s + q, given, parts=parts)
