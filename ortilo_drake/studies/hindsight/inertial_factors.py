"""The imu in the graph: its samples of each tick preintegrated by GTSAM, and its angles.

A sample stamped s covers the step (s', s], with s' the stamp before. GTSAM turns the specific force by the attitude at
the step's beginning. The tight filter (onboard/estimator/tight/inertial.py) uses the attitude half way, to which the
sample belongs. So each specific force is first turned by half its step, f' = exp([w dt / 2]x) f.

Preintegration: Forster, Carlone, Dellaert and Scaramuzza, "On-manifold preintegration for real-time visual-inertial
odometry", IEEE Trans. Robotics 33, 2017.
"""

from typing import NamedTuple

import gtsam
import numpy as np
from scipy.spatial.transform import Rotation

from ortilo_drake.flight.signals import Signals
from ortilo_drake.model.signals import ARRIVED, PAYLOAD, STAMP, samples_in
from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.onboard.estimator.tight.attitude_rows import inverse_rate_matrix
from ortilo_drake.scenario.tight import InertialNoise

INTEGRATION_SD = 1e-5  # extra standard deviation of a tick's position [m]: with one sample it would have none
_CLOSE = 1e-9  # two stamps are equal within this time [s]


class Sample(NamedTuple):
    """A sample of the imu."""

    stamp: float
    """end of the sample's step [s]."""
    rpy: np.ndarray
    """the imu's roll, pitch and yaw (3) [rad]."""
    w: np.ndarray
    """body rates, the mean of this sample and the one before (3) [rad/s]."""
    f: np.ndarray
    """specific force (3) [m/s^2]."""


class InertialTick(NamedTuple):
    """The imu's samples of the step that ends at a tick."""

    motion: gtsam.PreintegratedImuMeasurements
    """the preintegrated samples."""
    rpy: np.ndarray | None
    """mean of the samples' angles, each carried to the tick by the body rates (3) [rad]; None without samples."""
    samples: int
    """number of samples in this mean."""
    w: np.ndarray
    """body rates (3) [rad/s]."""


def samples_of(messages: tuple[Signals, ...], imu: str, n: int) -> list[Sample]:
    """Return the samples of all messages of the imu `imu`, in the order of their stamps; n: samples in a message."""
    rows: dict[float, np.ndarray] = {}
    for its in messages:
        if imu in its:
            found = samples_in(its[imu], n) if n > 1 else its[imu][np.newaxis]
            rows |= {float(row[STAMP]): row for row in found if row[ARRIVED] == 1.0 and np.isfinite(row).all()}
    samples, before = [], np.zeros(3)
    for stamp in sorted(rows):
        rpy, w, f = rows[stamp][PAYLOAD:].reshape(3, 3)
        samples.append(Sample(stamp, rpy, 0.5 * (before + w), f))
        before = w
    return samples


def _parameters(sds: np.ndarray, dt: float, h: float) -> gtsam.PreintegrationParams:
    """Return GTSAM's parameters for samples dt [s] apart with deviations sds (rates [rad/s], force [m/s^2])."""
    parameters = gtsam.PreintegrationParams.MakeSharedU(GRAVITY)
    parameters.setGyroscopeCovariance(sds[0] ** 2 * dt * np.eye(3))
    parameters.setAccelerometerCovariance(sds[1] ** 2 * dt * np.eye(3))
    parameters.setIntegrationCovariance(INTEGRATION_SD**2 / h * np.eye(3))
    return parameters


def _integrate(motion: gtsam.PreintegratedImuMeasurements, w: np.ndarray, f: np.ndarray, dt: float) -> None:
    motion.integrateMeasurement(Rotation.from_rotvec(0.5 * dt * w).apply(f), w, dt)


def inertial_ticks(
    samples: list[Sample], n: int, h: float, per_tick: int, sds: tuple[float, float], settings: InertialNoise
) -> list[InertialTick | None]:
    """Return the imu's measurement of each step that ends at ticks 1 to n - 1; None for tick 0.

    If no sample reaches a step's end, the last sample holds, with noise coasting_sd, as in the tight filter. The
    samples, `per_tick` in a tick of h [s], come in the order of their stamps; sds: standard deviations of a sample's
    body rates [rad/s] and specific force [m/s^2].
    """
    known = _parameters(np.array(sds), h / per_tick, h)
    coasting = _parameters(np.array(settings.coasting_sd), h, h)
    no_bias = gtsam.imuBias.ConstantBias()
    ticks: list[InertialTick | None] = [None]
    w, f = np.zeros(3), np.array([0.0, 0.0, GRAVITY])
    at = 0
    for k in range(1, n):
        begin, end = (k - 1) * h, k * h
        while at < len(samples) and samples[at].stamp <= begin + _CLOSE:
            at += 1
        first = at
        while at < len(samples) and samples[at].stamp <= end + _CLOSE:
            at += 1
        its = samples[first:at]
        whole = bool(its) and its[-1].stamp > end - _CLOSE
        motion = gtsam.PreintegratedImuMeasurements(known if whole else coasting, no_bias)
        t = begin
        for sample in its:
            w, f = sample.w, sample.f
            _integrate(motion, w, f, sample.stamp - t)
            t = sample.stamp
        if not whole:
            _integrate(motion, w, f, end - t)
        ticks.append(InertialTick(motion, _mean_angles(its, end), len(its), w))
    return ticks


def _mean_angles(samples: list[Sample], end: float) -> np.ndarray | None:
    """Return the mean of the samples' angles (3) [rad], each carried to the tick's end by the rates after it."""
    if not samples:
        return None
    turned, after, t = [], np.zeros(3), end
    for sample, later in zip(reversed(samples), [None, *reversed(samples[1:])], strict=True):
        rates = sample.w if later is None else later.w
        after = after + (t - sample.stamp) * rates
        t = sample.stamp
        turned.append(sample.rpy + inverse_rate_matrix(sample.rpy) @ after)
    angles = np.unwrap(np.array(turned), axis=0)
    return np.asarray(angles.mean(axis=0))
