"""The inertial measurement unit (paper, section III-A)."""

from typing import Any, Final

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.equations import rates_about_axes, rotation_rows
from ortilo_drake.model.placing import fill, put, sample_of
from ortilo_drake.model.signals import ARRIVED, IMU_SIZE, PAYLOAD, STAMP, size_of_samples
from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.scenario import Imu as ImuSettings
from ortilo_drake.world.noise import four_normals, put_normals, stream_id
from ortilo_drake.world.sensors.samples import passed_at, rows_of, sample_time, seed_of_sample


@register_jitable
def put_imu_message(
    message: np.ndarray, v: np.ndarray, x: np.ndarray, v_dot: np.ndarray, bias: np.ndarray, sd: np.ndarray, time: float
) -> None:
    """Write the imu message (11): [rpy, w_WB_B, f_B] + b + sd v, with f_B = R_WB^T (v_dot + g e_z).

    v_dot includes all that accelerates the body: rotors, wind and the floor. At rest f_B is gravity's reaction. v are
    standard normal numbers, bias is b (9 each), v_dot the acceleration of B's origin in W [m/s^2], sd the standard
    deviations of angles, rates and specific force (3), the time t_k [s].
    """
    message[0] = 1.0
    message[1] = time
    put(x[3:6], message, 2)
    put(rates_about_axes(x[3:6], x[9:12]), message, 5)
    R_WB = rotation_rows(x[3:6])
    for i in range(3):
        message[8 + i] = R_WB[0][i] * v_dot[0] + R_WB[1][i] * v_dot[1] + R_WB[2][i] * (v_dot[2] + GRAVITY)
    for i in range(9):
        message[2 + i] += bias[i] + sd[i // 3] * v[i]


def angles_out(
    n: Any, k: int, seed: int, sent: np.ndarray, state: np.ndarray, bias: np.ndarray, out: np.ndarray
) -> None:
    """Output the imu message without rates and specific force in a tick in which it is sent, else zeros."""
    fill(out, 0.0)
    if sent[0] >= 0.0:
        out[ARRIVED], out[STAMP] = 1.0, k * n.h
        v = four_normals(seed, n.stream, k)
        for i in range(3):
            out[PAYLOAD + i] = state[3 + i] + (bias[i] + n.sd[0] * v[i])


def imu_out(
    n: Any,
    k: int,
    seed: int,
    sent: np.ndarray,
    state: np.ndarray,
    acceleration: np.ndarray,
    bias: np.ndarray,
    v: np.ndarray,
    out: np.ndarray,
) -> None:
    """Output the imu message of put_imu_message in a tick in which it is sent, else zeros."""
    fill(out, 0.0)
    if sent[0] >= 0.0:
        put_normals(v, seed, n.stream, k)
        put_imu_message(out, v, state, acceleration, bias, n.sd, k * n.h)


def samples_out(
    n: Any,
    k: int,
    sent: np.ndarray,
    seeds: np.ndarray,
    state: np.ndarray,
    acceleration: np.ndarray,
    passed: np.ndarray,
    rows: np.ndarray,
    bias: np.ndarray,
    v: np.ndarray,
    out: np.ndarray,
) -> None:
    """Output the samples of an imu faster than the tick in a tick in which they are sent, else zeros.

    The oldest comes first. The samples before the last measure what has `passed` inside the last tick, in these rows.
    At t_0 there is only the last sample.
    """
    fill(out, 0.0)
    if sent[0] < 0.0:
        return
    count = rows.size + 1
    out[ARRIVED], out[STAMP] = 1.0, k * n.h
    for i in range(1 if k > 0 else count, count + 1):
        t = sample_time(k, i, count, n.h)
        x, v_dot = (state, acceleration) if i == count else passed_at(passed, rows[i - 1])
        put_normals(v, seed_of_sample(seeds, k, i, count), n.stream, tick_of(t, n.h / count))
        put_imu_message(sample_of(out, i - 1, count), v, x, v_dot, bias, n.sd, t)


ANGLES = Element("imu_angles", out=angles_out)
IMU = Element("imu", out=imu_out)
NO_ROWS: Final = np.zeros(0)
SAMPLES = Element("imu_samples", out=samples_out, allocates=True)


def imu_box(
    settings: ImuSettings, h: float, whole: bool, samples: int = 1, stream: str = "imu", instants: np.ndarray = NO_ROWS
) -> Box:
    """Return the imu, with the noise of a stream.

    It reads `sent` (1), not negative where its message is sent, and the true state (12). If `whole`, it has rates and
    specific force too, and also reads the acceleration of B's origin in W (3) up to this tick. If it is faster than the
    tick, it also reads what was `passed` at these instants inside the tick before, see vehicle/continuous.py.
    """
    sd = np.array(settings.sds(h / samples))
    given = Values({"sd": sd, "stream": stream_id(stream), "h": h}, tables={"bias": np.zeros(9)})
    if not whole:
        return Box("imu", ANGLES, IMU_SIZE, given)
    if samples > 1:
        given = given.updated(Values(tables={"rows": rows_of(samples, instants)}))
        return Box("imu", SAMPLES, size_of_samples(IMU_SIZE, samples), given, {"v": (9,)})
    return Box("imu", IMU, IMU_SIZE, given, {"v": (9,)})
