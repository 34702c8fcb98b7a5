"""Factors of the graph beside the imu's: ranges, boxes, angles, rows of other sensors, and slow errors as variables.

Residuals are predicted less measured values, by the tight filter's equations (onboard/estimator/tight). A pose's
tangent is GTSAM's, [theta, t] in B: R_WB exp([theta]x), p_WB + R_WB t.
"""

from collections.abc import Iterator
from itertools import count
from typing import NamedTuple

import gtsam
import numpy as np

from ortilo_drake.model.pinhole import Camera, box_center
from ortilo_drake.onboard.estimator.tight.attitude_rows import inverse_rate_matrix
from ortilo_drake.onboard.estimator.tight.ranges import range_row

LEAST_SD = 1e-6  # replaces a standard deviation of 0, by which no factor can be weighted [m, rad, s, ...]


def weighted(sds: np.ndarray, huber: float) -> gtsam.noiseModel.Base:
    """Return noise of these standard deviations, with Huber's loss beyond `huber` of them; inf: squares alone."""
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.maximum(np.asarray(sds, dtype=float), LEAST_SD))
    if np.isinf(huber):
        return noise
    return gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Huber.Create(huber), noise)


def rpy_of(R: np.ndarray) -> np.ndarray:
    """Return roll, pitch and yaw (phi, theta, psi) [rad] of R = R_z(psi) R_y(theta) R_x(phi)."""
    sine = min(1.0, max(-1.0, -R[2, 0]))
    return np.array([np.arctan2(R[2, 1], R[2, 2]), np.arcsin(sine), np.arctan2(R[1, 0], R[0, 0])])


class Reach(NamedTuple):
    """A range in a sum of ranges: its sign, anchor a in W (3), and the keys of its error variables (1 each) [m]."""

    sign: float
    anchor: np.ndarray
    errors: tuple[int, ...]


def ranges_factor(
    pose: int,
    velocity: int | None,
    clock: int | None,
    ranges: tuple[Reach, ...],
    measured: float,
    age: float,
    lever: np.ndarray,
    noise: gtsam.noiseModel.Base,
) -> gtsam.CustomFactor:
    """Return the factor of a range or of a difference of two ranges, see onboard/estimator/tight/ranges.py.

    pose, velocity: keys of the pose and of v_WB at the message's stamp (velocity None if nothing is older than the
    stamp); clock: key of the time by which the message is older than its stamp, None if that is known; measured: the
    measured sum of `ranges` [m]; age: of the packet at the message's stamp [s]; lever: of the antenna, in B (3).
    """

    def error(_: gtsam.CustomFactor, values: gtsam.Values, H: list[np.ndarray] | None) -> np.ndarray:
        X, v = values.atPose3(pose), np.zeros(3) if velocity is None else values.atVector(velocity)
        R, older = X.rotation().matrix(), age + (0.0 if clock is None else values.atVector(clock)[0])
        row, total, e = np.empty(6), np.zeros(6), -measured
        for its in ranges:
            r = range_row(X.translation() - older * v, R, lever, its.anchor, row)
            e += its.sign * (r + sum(values.atVector(key)[0] for key in its.errors))
            total += its.sign * row
        if H is not None:
            found = [np.concatenate((total[3:], total[:3] @ R))[np.newaxis]]
            found += [np.array([[its.sign]]) for its in ranges for _ in its.errors]
            found += [] if velocity is None else [-older * total[np.newaxis, :3]]
            found += [] if clock is None else [np.array([[-total[:3] @ v]])]
            for i, block in enumerate(found):
                H[i] = block
        return np.array([e])

    errors = [key for its in ranges for key in its.errors]
    return gtsam.CustomFactor(noise, [pose, *errors, *(key for key in (velocity, clock) if key is not None)], error)


class Moving(NamedTuple):
    """The variables through which the error of the camera's clock changes a box's prediction."""

    velocity: int
    """key of v_WB."""
    clock: int
    """key of the time by which the message is older than its stamp."""
    w: np.ndarray
    """body rates (3) [rad/s]."""


def box_factor(
    pose: int,
    survey: int | None,
    slow: tuple[int, np.ndarray] | None,
    moving: Moving | None,
    center: np.ndarray,
    position: np.ndarray,
    outline: np.ndarray,
    camera: Camera,
    noise: gtsam.noiseModel.Base,
) -> gtsam.CustomFactor:
    """Return the factor of one box's centre, see onboard/estimator/tight/pixels.py.

    The residual is 0 at a pose from which the landmark has no projection. The effect of the camera's clock on the
    prediction is taken to first order: its derivative by the pose is left out.

    Args:
        pose: key of the pose at the box's stamp.
        survey: key of the landmark's offset from its surveyed position (3), None without one.
        slow: key of the lasting error (2) and its scale (2) [px], None without one.
        moving: keys of the camera's clock error, None without one.
        center: of the box (2) [px].
        position: of the landmark as it was surveyed, in W (3).
        outline: of the landmark, see model/pinhole.py.
        camera: the camera.
        noise: white noise of the box's centre.
    """

    def error(_: gtsam.CustomFactor, values: gtsam.Values, H: list[np.ndarray] | None) -> np.ndarray:
        X, z, J = values.atPose3(pose), np.empty(2), np.empty((2, 6))
        R = X.rotation().matrix()
        rpy, stands = rpy_of(R), position if survey is None else position + values.atVector(survey)
        seen = box_center(stands, outline, X.translation(), rpy, R, camera, z, J)
        if not seen:
            z, J = center.copy(), np.zeros((2, 6))
        J_theta = J[:, 3:] @ inverse_rate_matrix(rpy)
        found = [np.hstack([J_theta, J[:, :3] @ R])]
        if survey is not None:
            found.append(-J[:, :3])
        if slow is not None:
            scale = np.diag(slow[1]) * seen
            z += scale @ values.atVector(slow[0])
            found.append(scale)
        if moving is not None:
            moved = J[:, :3] @ values.atVector(moving.velocity) + J_theta @ moving.w
            tau = values.atVector(moving.clock)[0]
            z -= moved * tau
            found += [-tau * J[:, :3], -moved[:, np.newaxis]]
        if H is not None:
            for i, block in enumerate(found):
                H[i] = block
        return z - center

    others = [survey] if survey is not None else []
    others += [slow[0]] if slow is not None else []
    keys = [pose, *others, *((moving.velocity, moving.clock) if moving else ())]
    return gtsam.CustomFactor(noise, keys, error)


def angles_factor(pose: int, errors: int | None, rpy: np.ndarray, noise: gtsam.noiseModel.Base) -> gtsam.CustomFactor:
    """Return the factor of the imu's roll, pitch and yaw (3) [rad]; errors: key of the angles' errors (3), or None."""

    def error(_: gtsam.CustomFactor, values: gtsam.Values, H: list[np.ndarray] | None) -> np.ndarray:
        own = rpy_of(values.atPose3(pose).rotation().matrix())
        e = (own - rpy + np.pi) % (2.0 * np.pi) - np.pi
        if H is not None:
            H[0] = np.hstack([inverse_rate_matrix(own), np.zeros((3, 3))])
        if errors is not None:
            e = e + values.atVector(errors)
            if H is not None:
                H[1] = np.eye(3)
        return e

    return gtsam.CustomFactor(noise, [pose] if errors is None else [pose, errors], error)


def rows_factor(
    pose: int, velocity: int, bias: int, w: np.ndarray, y: np.ndarray, C: np.ndarray, V: np.ndarray, huber: float
) -> gtsam.CustomFactor:
    """Return the factor of values y = C x + v (m) of the paper's twelve states x.

    pose, velocity, bias: keys of the pose, of v_WB and of the imu's biases; w: measured body rates (3) [rad/s]; C: rows
    (m, 12); V: covariance of v (m, m); huber as in `weighted`.
    """
    whiten = np.linalg.inv(np.linalg.cholesky(V))
    rows, value = whiten @ C, whiten @ y

    def error(_: gtsam.CustomFactor, values: gtsam.Values, H: list[np.ndarray] | None) -> np.ndarray:
        X, v = values.atPose3(pose), values.atVector(velocity)
        R = X.rotation().matrix()
        rpy, rates = rpy_of(R), w - values.atConstantBias(bias).gyroscope()
        E = inverse_rate_matrix(rpy)
        if H is not None:
            by_rpy = rows[:, 3:6] + rows[:, 9:12] @ _euler_rates_by_rpy(rpy, rates)
            H[0] = np.hstack([by_rpy @ E, rows[:, :3] @ R])
            H[1] = rows[:, 6:9].copy()
            H[2] = np.hstack([np.zeros((len(y), 3)), -rows[:, 9:12] @ E])
        return np.asarray(rows @ np.concatenate((X.translation(), rpy, v, E @ rates)) - value)

    return gtsam.CustomFactor(weighted(np.ones(len(y)), huber), [pose, velocity, bias], error)


def _euler_rates_by_rpy(rpy: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Return d(E(rpy)^-1 w) / d rpy (3, 3)."""
    s, c, t, k = np.sin(rpy[0]), np.cos(rpy[0]), np.tan(rpy[1]), 1.0 / np.cos(rpy[1])
    a, b = s * w[1] + c * w[2], c * w[1] - s * w[2]
    return np.array([[t * b, a * k * k, 0.0], [-a, 0.0, 0.0], [k * b, a * k * t, 0.0]])


class Process:
    """A slow quantity: a variable at each time at which it is used, and factors between successive variables.

    A Gauss-Markov process of standard deviation sd and correlation time T, and a random walk, follow

        e(t) = e(s) exp(-(t - s) / T) + w,  w ~ N(0, sd^2 (1 - exp(-2 (t - s) / T)))
        e(t) = e(s) + w,                    w ~ N(0, rate^2 (t - s))

    A constant is one variable for all times.

    Args:
        graph: the factors are added to it.
        values: the variables are added to them, at 0.
        keys: gives unused keys, see numbered.
        sd: standard deviation at first (m).
        rate: standard deviation of the random walk after 1 s.
        time: correlation time T [s]; None for a random walk or a constant.
    """

    def __init__(
        self,
        graph: gtsam.NonlinearFactorGraph,
        values: gtsam.Values,
        keys: Iterator[int],
        sd: np.ndarray,
        rate: float = 0.0,
        time: float | None = None,
    ):
        self._graph, self._values, self._keys = graph, values, keys
        self._sd, self._rate, self._time = np.maximum(sd, LEAST_SD), rate, time
        self._last: tuple[int, float] | None = None

    def at(self, t: float) -> int:
        """Return the key of the variable at a time t [s], which must not decrease from call to call."""
        m = len(self._sd)
        if self._last is None:
            key = self._add()
            noise = gtsam.noiseModel.Diagonal.Sigmas(self._sd)
            self._graph.add(gtsam.PriorFactorVector(key, np.zeros(m), noise))
            self._last = key, t
            return key
        last, s = self._last
        constant = self._time is None and self._rate == 0.0
        if constant or t <= s:
            return last
        keep = 1.0 if self._time is None else float(np.exp((s - t) / self._time))
        sd = np.full(m, self._rate * np.sqrt(t - s)) if self._time is None else self._sd * np.sqrt(1.0 - keep**2)
        key = self._add()
        noise = gtsam.noiseModel.Diagonal.Sigmas(np.maximum(sd, LEAST_SD))
        linear = gtsam.JacobianFactor(last, -keep * np.eye(m), key, np.eye(m), np.zeros(m), noise)
        about = gtsam.Values()
        about.insert(last, np.zeros(m))
        about.insert(key, np.zeros(m))
        self._graph.add(gtsam.LinearContainerFactor(linear, about))
        self._last = key, t
        return key

    def _add(self) -> int:
        key = next(self._keys)
        self._values.insert(key, np.zeros(len(self._sd)))
        return key


def numbered() -> Iterator[int]:
    """Return an iterator over keys for the variables of Processes, each key once."""
    return (int(gtsam.symbol("e", i)) for i in count(1))
