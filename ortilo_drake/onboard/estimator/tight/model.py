"""The tight filter's model, made from the scenario: states, noise and initial covariance."""

from collections.abc import Container
from typing import NamedTuple

import numpy as np

from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import N_X
from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.model.white_noise import white_sd
from ortilo_drake.onboard.estimator.at_rest import Rest, zero_accelerometer, zero_gyroscope
from ortilo_drake.onboard.estimator.tight.inertial import quaternion_of
from ortilo_drake.onboard.estimator.tight.layout import (
    ACCEL,
    GROUPS,
    GYRO,
    N_INERTIAL,
    THETA,
    Layout,
    P,
    Q,
    V,
    make_layout,
    nominal_size,
)
from ortilo_drake.onboard.estimator.tight.tick import FORCE, N_AHEAD, N_KEPT, THRUST, Motion
from ortilo_drake.onboard.estimator.tight.watch import Watch
from ortilo_drake.onboard.gate import squared_gate
from ortilo_drake.onboard.landmarks.box_fix import BoxBelief, box_belief
from ortilo_drake.scenario import Belief
from ortilo_drake.scenario.tight import DATASHEETS
from ortilo_drake.scenario.tight import TightFilter as Settings


def layout_of(settings: Settings, room: Room, measured: Container[str | None], h: float) -> Layout:
    """Return the layout of the states whose error is not 0; `measured` names what the sensors use (model/parts.py)."""
    imu, ranges, pixels = settings.imu, settings.ranges, settings.pixels
    anchors = len(room.anchors) if "anchors" in measured else 0
    landmarks = len(room.landmarks) if "landmarks" in measured else 0
    clocks = (ranges.clock_sd > 0.0 and anchors > 0) or (pixels.clock_sd > 0.0 and landmarks > 0)
    sizes = {
        "angles": 3 * (imu.level_sd > 0.0 or imu.yaw_sd > 0.0),
        "clock": 2 * clocks,
        "range_bias": anchors * (ranges.bias_sd > 0.0),
        "range_slow": anchors * (ranges.slow_sd > 0.0),
        "range_offset": 1 * (anchors > 0 and settings.watch is not None),
        "survey": 3 * landmarks * (pixels.survey_sd > 0.0),
        "pixel_slow": 2 * landmarks * (pixels.slow_share > 0.0),
    }
    return make_layout(sizes, round(settings.horizon / h))


def sample_sds(settings: Settings, samples: int, h: float) -> tuple[float, float]:
    """Return the noise sds of one sample of the body rates [rad/s] and of the specific force [m/s^2]."""
    imu = settings.imu
    its = imu if imu.datasheet == "none" else DATASHEETS[imu.datasheet]
    return white_sd(its.rate_density, h / samples), white_sd(its.specific_force_density, h / samples)


def motion_of(settings: Settings, layout: Layout, scenario: Belief) -> Motion:
    """Return the filter's model of imu and vehicle."""
    imu, ranges, pixels, h = settings.imu, settings.ranges, settings.pixels, scenario.h
    rate_sd, force_sd = sample_sds(settings, scenario.imu_samples, h)
    keeps, steps = np.ones(layout.core - GYRO), np.zeros(layout.core - GYRO)
    steps[:3], steps[3:6] = h * imu.gyroscope_rate**2, h * imu.accelerometer_rate**2

    def set_group(at: int, size: int, step: float, keep: float = 1.0) -> None:
        if at >= 0:
            keeps[at - GYRO : at - GYRO + size], steps[at - GYRO : at - GYRO + size] = keep, step

    anchors, landmarks = _counts(layout)
    set_group(layout.angles, 3, h * imu.angles_rate**2)
    set_group(layout.range_bias, anchors, h * ranges.bias_rate**2)
    keep = np.exp(-h / ranges.slow_time)
    set_group(layout.range_slow, anchors, (1.0 - keep**2) * ranges.slow_sd**2, keep)
    keep = np.exp(-h / pixels.slow_time)
    set_group(layout.pixel_slow, 2 * landmarks, 1.0 - keep**2, keep)
    coasting = np.square(imu.coasting_sd)
    inertia = np.array(scenario.vehicle.inertia, dtype=float)
    variances, silent = np.array([rate_sd**2, force_sd**2]), np.square(imu.silent_rate)
    watches = settings.watch is not None
    return Motion(variances, coasting, keeps, steps, scenario.vehicle.mass, inertia, h, silent, watches, scenario.yaw)


class Aids(NamedTuple):
    """The filter's model of the sensors beside the imu, in arrays for compiled functions."""

    anchors: np.ndarray
    """positions a_i of the anchors in W (n, 3) [m]."""
    lever: np.ndarray
    """position of the uwb antenna in B (3) [m]."""
    range_noise: np.ndarray
    """s_0 [m] and s_1 [1] of the noise sd s_0 + s_1 r of a range r (2)."""
    differences: bool
    """whether all ranges of a message share an unknown clock offset, so that only their differences count."""
    in_pairs: bool
    """whether the uwb's messages hold differences of ranges."""
    boxes: BoxBelief
    """landmarks, camera and settings of the association of boxes to landmarks; the errors and the gate are not read."""
    pixel_noise: np.ndarray
    """sd of a small box's centre [px], growth of this sd [1/px], share of the variance that lasts [1] (3)."""
    angle_sd: float
    """noise sd of a sample of the imu's angles [rad]; 0 leaves the angles out."""
    gates: np.ndarray
    """largest squared distance of a scalar, of a box's centre, and of a box in the association to a landmark (3)."""
    huber: float
    """constant c of Huber's weight, see update.py."""
    watch: Watch
    """settings of the watch; read only if Motion.watches."""


def watch_of(settings: Settings, h: float) -> Watch:
    """Return the settings of the watch; zeros without one."""
    watch = settings.watch
    if watch is None:
        return Watch(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    attitude = watch.gyroscope_sd * watch.time  # attitude error until the watch notices a step of the gyroscope's bias
    opened = watch.gyroscope_sd**2, attitude**2, watch.offset_sd**2
    return Watch(1.0 - np.exp(-h / watch.time), watch.leans, watch.sided, *opened)


def aids_of(settings: Settings, room: Room, scenario: Belief) -> Aids:
    """Return the filter's model of the sensors beside the imu."""
    ranges, pixels, fix = settings.ranges, settings.pixels, scenario.landmark_fix
    known = room.model_copy(update={"landmark_outline": {}}) if fix.shapes == "boxes" else room
    gates = (settings.gate, 1), (settings.gate, 2), (fix.gate, 2)
    return Aids(
        np.ascontiguousarray(room.anchor_positions, dtype=float),
        np.array(ranges.lever),
        np.array(ranges.noise.sds),
        ranges.differences,
        scenario.uwb.kind == "differences",
        box_belief(fix, known, scenario.image_width),
        np.array([pixels.sd, pixels.growth, pixels.slow_share]),
        white_sd(settings.imu.angle_density or 0.0, scenario.imu_period),
        np.array([squared_gate(*of) for of in gates]),
        settings.huber,
        watch_of(settings, scenario.h),
    )


def _counts(layout: Layout) -> tuple[int, int]:
    """Return the numbers of anchors and landmarks that have states in the layout."""
    starts = [at for at in (*layout[: len(GROUPS)], layout.core) if at >= 0]

    def size(at: int) -> int:
        return min(s for s in starts if s > at) - at if at >= 0 else 0

    anchors = max(size(layout.range_bias), size(layout.range_slow))
    return anchors, max(size(layout.survey) // 3, size(layout.pixel_slow) // 2)


def initial_covariance(
    settings: Settings, layout: Layout, rest: Rest | None = None, noise: tuple[float, float] = (0.0, 0.0)
) -> np.ndarray:
    """Return the initial covariance (n, n); all clones equal the first pose.

    With a rest before take-off, the covariance of the imu's biases follows from the rest and from `noise`, the sds of
    one sample of the body rates [rad/s] and of the specific force [m/s^2].
    """
    imu, ranges, pixels = settings.imu, settings.ranges, settings.pixels
    sd = np.zeros(layout.core)
    sd[P : P + 3], sd[THETA : THETA + 3], sd[V : V + 3] = settings.initial_sd
    sd[GYRO : GYRO + 3], sd[ACCEL:N_INERTIAL] = imu.gyroscope_sd, imu.accelerometer_sd
    anchors, landmarks = _counts(layout)
    for at, sds in (
        (layout.angles, [imu.level_sd, imu.level_sd, imu.yaw_sd]),
        (layout.clock, [ranges.clock_sd, pixels.clock_sd]),
        (layout.range_bias, [ranges.bias_sd] * anchors),
        (layout.range_slow, [ranges.slow_sd] * anchors),
        (layout.survey, [pixels.survey_sd] * 3 * landmarks),
        (layout.pixel_slow, [1.0] * 2 * landmarks),
    ):
        if at >= 0:
            sd[at : at + len(sds)] = sds
    C_0 = np.diag(sd**2)
    if rest is not None:
        beta = [layout.angles + i if layout.angles >= 0 else -1 for i in range(3)]
        zero_gyroscope(C_0, GYRO, rest.variance(noise[0] ** 2, imu.gyroscope_rate))
        variance = rest.variance(noise[1] ** 2, imu.accelerometer_rate)
        angle_sd = white_sd(imu.angle_density or 0.0, rest.period)
        zero_accelerometer(C_0, ACCEL, beta, variance, rest.variance(angle_sd**2, imu.angles_rate))
    pose = [P, P + 1, P + 2, THETA, THETA + 1, THETA + 2]
    from_ = np.concatenate((np.arange(layout.core), *([pose] * layout.clones))).astype(int)
    return C_0[np.ix_(from_, from_)]


def first_states(
    layout: Layout, motion: Motion, C_0: np.ndarray, xbar_0: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the initial nominal state, the initial `kept` of imu and control (tick.py), and the prediction for t_0.

    C_0 is the initial covariance (n, n), xbar_0 the initial estimate of the paper's states, at rest in hover (15).
    """
    x, kept, ahead = np.zeros(nominal_size(layout)), np.zeros(N_KEPT), np.zeros(N_AHEAD)
    x[P : P + 3], x[V : V + 3], x[Q : Q + 4] = xbar_0[0:3], xbar_0[6:9], quaternion_of(xbar_0[3:6])
    for c in range(layout.clones):
        at = layout.core + 1 + 7 * c
        x[at : at + 3], x[at + 3 : at + 7] = x[P : P + 3], x[Q : Q + 4]
    kept[FORCE + 2], kept[THRUST] = GRAVITY, motion.mass * GRAVITY
    ahead[:N_X] = xbar_0[:N_X]
    T = np.zeros((N_X, layout.n))
    T[0:3, 0:3], T[3:6, 6:9], T[6:9, 3:6], T[9:12, 9:12] = (np.eye(3),) * 4
    ahead[N_X:] = (T @ C_0 @ T.T).ravel()
    return x, kept, ahead
