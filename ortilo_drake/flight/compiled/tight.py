"""The tight filter in a compiled flight."""

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.flight.compiled.constants import CameraConstants, OtherConstants, UwbConstants
from ortilo_drake.flight.compiled.constants_onboard import TightConstants
from ortilo_drake.flight.compiled.kept import Sensed, SensorMemory
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.signals import ARRIVED, IMU_SIZE, N_X, N_XBAR, PAYLOAD
from ortilo_drake.model.triples import Triple
from ortilo_drake.onboard.estimator.tight.sense import NOT_TAKEN, clone_of, take_messages
from ortilo_drake.onboard.estimator.tight.tick import keep_pose, one_ahead


class TightMemory(NamedTuple):
    """What the estimator keeps from tick to tick, changed in place; see onboard/estimator/tight/system.py.

    Attributes:
        x: nominal state.
        C: covariance (n, n).
        kept: of imu and control.
        ahead: the prediction for this tick (156).
        watched: what the watch keeps.
        i: integral of the position error (3).
        known: the belief of [x; i] (240).
        handed: [y, delta, V2].
    """

    x: np.ndarray
    C: np.ndarray
    kept: np.ndarray
    ahead: np.ndarray
    watched: np.ndarray
    i: np.ndarray
    known: np.ndarray
    handed: np.ndarray


@register_jitable
def first_tight_memory(estimator: TightConstants) -> TightMemory:
    """Return what is kept at first."""
    first, block = estimator.handled.first, estimator.handled.block
    return TightMemory(
        estimator.x_0.copy(),
        estimator.C_0.copy(),
        estimator.kept_0.copy(),
        estimator.ahead_0.copy(),
        np.zeros(estimator.watched),
        np.zeros(3),
        np.zeros(N_XBAR + N_XBAR * N_XBAR),
        np.zeros(first[-1] + first.size - 1 + block[-1]),
    )


@register_jitable(forceinline=True, error_model="numpy")
def tight_known_of(estimator: TightConstants, memory: TightMemory) -> np.ndarray:
    """Return the belief of [x; i] (240) that was predicted for this tick; i is known."""
    known = memory.known
    put(memory.ahead[:N_X], known)
    put(memory.i, known, N_X)
    for row in range(N_X):
        put(memory.ahead[N_X * (row + 1) : N_X * (row + 2)], known, N_XBAR * (row + 1))
    return known


@register_jitable(forceinline=True, error_model="numpy")
def tight_force_of(estimator: TightConstants, memory: TightMemory) -> Triple:
    """Return zeros: the force is not estimated."""
    return 0.0, 0.0, 0.0


@register_jitable
def samples_of(imu: np.ndarray, n: int) -> np.ndarray:
    """Return the samples in the imu's message (n, 11), n of them where it is faster than the tick."""
    if n == 1:
        return imu.reshape((1, IMU_SIZE))
    return imu[PAYLOAD:].reshape((n, IMU_SIZE))


@register_jitable(forceinline=True, error_model="numpy")
def tight_handed_of(
    estimator: TightConstants,
    memory: TightMemory,
    uwb: UwbConstants,
    camera: CameraConstants | None,
    sensed: Sensed,
    known: np.ndarray,
    k: int,
    h: float,
    others: tuple[OtherConstants, ...],
    kept: tuple[SensorMemory, ...],
) -> np.ndarray:
    """Return [y, delta, V2] of tick k: what can be used, y NaN of ranges and boxes. Arguments as handed_of's."""
    first, block = estimator.handled.first, estimator.handled.block
    p, s = first[-1], first.size - 1
    handed, imu = memory.handed, sensed.imu.message
    fill(handed, 0.0)
    for j, message in ((estimator.numbers[0], sensed.uwb.message), (estimator.numbers[2], sensed.camera.message)):
        if j >= 0 and clone_of(message, k * h, h, estimator.layout.clones) != NOT_TAKEN:
            handed[first[j] : first[j + 1]] = np.nan
            handed[p + j] = 1.0
    j = estimator.numbers[1]
    if j >= 0:
        newest = samples_of(imu, estimator.samples)[-1]
        if imu[ARRIVED] != 0.0:
            handed[first[j] : first[j + 1]] = newest[PAYLOAD : PAYLOAD + 3]
            handed[p + j] = 1.0
        m = first[j + 1] - first[j]
        for i in range(m):
            handed[p + s + block[j] + i * (m + 1)] = estimator.aids.angle_sd**2
    return handed


@register_jitable
def add_error(integral: np.ndarray, r: np.ndarray, xhat: np.ndarray) -> None:
    """Add r - xhat to the integral (3) of the position error.

    By itself: of this loop written out in tight_take, which numba inlines into the flight, nothing came.
    """
    for j in range(3):
        integral[j] += r[j] - xhat[j]


@register_jitable(forceinline=True, error_model="numpy")
def tight_take(
    estimator: TightConstants,
    memory: TightMemory,
    handed: np.ndarray,
    sensed: Sensed,
    k: int,
    h: float,
    u: np.ndarray,
    hover: float,
    r: np.ndarray,
) -> None:
    """Go on to the belief of the next tick; arguments as take's."""
    layout, motion = estimator.layout, estimator.motion
    add_error(memory.i, r, memory.ahead)
    samples, ranges = samples_of(sensed.imu.message, estimator.samples), sensed.uwb.message
    x, C, kept, boxes = memory.x, memory.C, memory.kept, sensed.camera.message
    take_messages(x, C, kept, memory.watched, samples, ranges, boxes, k * h, layout, motion, estimator.aids)
    one_ahead(x, C, kept, u, motion, memory.ahead)
    keep_pose(x, C, layout)
