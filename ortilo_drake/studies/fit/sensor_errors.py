"""Errors of recorded ranges while airborne, and of an IMU's samples in flight and at rest, relative to the truth.

The truth is a smooth path with an ideal IMU on it: positions and quaternions are resampled evenly, passed forwards and
backwards through a Butterworth filter, and joined by cubic splines. The second derivative of a truth that is rounded to
a millimetre would otherwise be noise alone.
"""

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt
from scipy.spatial.transform import Rotation

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.recording import GRAVITY, Recording, Truth
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.recorded.calibrate import Calibration, calibrate
from ortilo_drake.studies.recorded.setups import airborne
from ortilo_drake.studies.recorded.truth_path import antennas, covered_ranges, interpolated, modelled, truth_path

RATE, CUT = 200.0, 8.0  # rate of the even stamps, and cut-off of the filter [Hz]
TURNS = 1e-3  # body rates are differences over this time to either side [s]
OVER, REST_OVER, TURNS_OVER = 0.25, 0.05, 0.1  # means over this time in flight, at rest, and for the mount [s]
FULL = 0.6  # a block counts if it has this share of the fullest block's samples
FAULTY, BEYOND = 0.05, 3.0  # an axis with more than this share of samples off by more than this [m/s²] is faulty
LEAVES = 0.05  # the vehicle rests until a second before it is this far above its first height [m]
LEAST = 8  # least number of blocks for a spread
SPREAD = 1.3605  # variance of the logarithm of the median absolute deviation of n normal numbers, times n
FEWEST = 200  # ranges that a fit needs


class BodyPath(NamedTuple):
    """The body's position and quaternion over the sensors' clock; before first and after last [s] it stands still."""

    p: CubicSpline
    q: CubicSpline
    first: float
    last: float

    def within(self, t: np.ndarray) -> np.ndarray:
        """Return the stamps, clipped to the path's times."""
        return np.clip(t, self.first + TURNS, self.last - TURNS)

    def position(self, t: np.ndarray) -> np.ndarray:
        """Return p_WB (m, 3)."""
        return np.asarray(self.p(self.within(t)))

    def attitude(self, t: np.ndarray) -> Rotation:
        """Return R_WB."""
        return Rotation.from_quat(self.q(self.within(t)))

    def rates(self, t: np.ndarray) -> np.ndarray:
        """Return the body rates (m, 3) [rad/s]."""
        moves, t = self._moves(t), self.within(t)
        before, behind = Rotation.from_quat(self.q(t - TURNS)), Rotation.from_quat(self.q(t + TURNS))
        return np.asarray(moves * (before.inv() * behind).as_rotvec() / (2.0 * TURNS))

    def force(self, t: np.ndarray) -> np.ndarray:
        """Return the specific force in B (m, 3) [m/s²]."""
        moves, t = self._moves(t), self.within(t)
        return np.asarray(self.attitude(t).inv().apply(moves * self.p(t, 2) + [0.0, 0.0, GRAVITY]))

    def _moves(self, t: np.ndarray) -> np.ndarray:
        """Return a mask (m, 1) of the stamps that are not beyond the ends."""
        return ((t >= self.first) & (t <= self.last))[:, None]


def body_path(name: str, truth: Truth, by: Calibration) -> BodyPath:
    """Return the truth's path in the anchors' frame, with the truth's own B; InputError if it has no attitude."""
    if truth.R is None:
        raise InputError(f"{name}: truth.rotation: the map has none, and an IMU is flown along an attitude")
    t = np.arange(truth.t[0], truth.t[-1], 1.0 / RATE)
    q = (Rotation.from_matrix(by.F) * Rotation.from_matrix(truth.R)).as_quat()
    turned = np.sum(q[1:] * q[:-1], axis=1) < 0.0
    q[1:] *= np.where(np.cumsum(turned) % 2 == 1, -1.0, 1.0)[:, None]
    even = interpolated(t, truth.t, np.hstack([by.position(truth.p), q]))
    smooth = sosfiltfilt(butter(2, CUT, fs=RATE, output="sos"), even, axis=0)
    t = t - by.offset
    return BodyPath(CubicSpline(t, smooth[:, :3]), CubicSpline(t, smooth[:, 3:]), float(t[0]), float(t[-1]))


class ImuErrors(NamedTuple):
    """An IMU's errors by axis (3 each): densities in flight, at rest (NaN if unknown), biases; NaN for a faulty axis.

    sd and sd_rest are the deviations of the densities' logarithms, in flight and at rest, if the noise is white.
    """

    rotation: np.ndarray
    force: np.ndarray
    rotation_rest: np.ndarray
    force_rest: np.ndarray
    rotation_bias: np.ndarray
    force_bias: np.ndarray
    sd: float
    sd_rest: float


def block_means(t: np.ndarray, values: np.ndarray, over: float) -> np.ndarray:
    """Return the means of values (m, k) over blocks of time that have most of their samples."""
    if not len(t):
        return np.zeros((0, values.shape[1]))
    block = ((t - t[0]) / over).astype(int)
    counts = np.bincount(block)
    full = counts >= FULL * counts.max()
    sums = np.column_stack([np.bincount(block, axis) for axis in values.T])
    return np.asarray(sums[full] / counts[full, None])


def _density(t: np.ndarray, e: np.ndarray, over: float) -> tuple[np.ndarray, float]:
    """Return robust densities by axis (3) and the standard deviation of their logarithms; NaN if there are few samples.

    A density is the spread of means over `over` [s], times the root of `over`.
    """
    means = block_means(t, e, over)
    if len(means) < LEAST:
        return np.full(3, np.nan), np.nan
    spread = 1.4826 * np.median(np.abs(means - np.median(means, axis=0)), axis=0)
    return np.asarray(spread * np.sqrt(over)), float(np.sqrt(SPREAD / len(means)))


def mount_of(recording: Recording, path: BodyPath, by: Calibration, map_: Map) -> Rotation:
    """Return the rotation from the IMU's axes to the truth's body that fits the body rates best (Kabsch)."""
    imu = recording.imu
    if imu is None:
        return Rotation.identity()
    if by.mount is not None:
        return Rotation.from_matrix(by.mount)
    up = airborne(recording.truth, by, map_)(imu.t)
    t, rates = imu.t[up], imu.rates[up]
    found, _ = Rotation.align_vectors(block_means(t, path.rates(t), TURNS_OVER), block_means(t, rates, TURNS_OVER))
    return found


def imu_errors(recording: Recording, path: BodyPath, mount: Rotation, by: Calibration, map_: Map) -> ImuErrors | None:
    """Return the IMU's errors; None without an IMU or a truth."""
    imu, truth = recording.imu, recording.truth
    if imu is None or truth is None:
        return None
    t_force, force = imu.accelerometer or (imu.t, imu.force)
    judged = airborne(truth, by, map_)
    up, up_force = judged(imu.t), judged(t_force)
    back = mount.inv()
    e = imu.rates[up] - back.apply(path.rates(imu.t[up]))
    f = force[up_force] - back.apply(path.force(t_force[up_force]))
    faulty = (np.abs(f) > BEYOND).mean(axis=0) > FAULTY
    z = by.position(truth.p)[:, 2]
    leaves = truth.t[np.argmax(z > z[0] + LEAVES)] - by.offset - 1.0
    rest, rest_force = imu.t < leaves, t_force < leaves
    rotation, sd = _density(imu.t[up], e, OVER)
    rotation_rest, sd_rest = _density(imu.t[rest], imu.rates[rest], REST_OVER)
    in_flight, _ = _density(t_force[up_force], f, OVER)
    at_rest, _ = _density(t_force[rest_force], force[rest_force] - [0.0, 0.0, GRAVITY], REST_OVER)
    of_force, of_force_rest = np.where(faulty, np.nan, in_flight), np.where(faulty, np.nan, at_rest)
    force_bias = np.where(faulty, np.nan, np.median(f, axis=0))
    return ImuErrors(rotation, of_force, rotation_rest, of_force_rest, e.mean(axis=0), force_bias, sd, sd_rest)


class RangeErrors(NamedTuple):
    """Errors of ranges in the order of their stamps (n each).

    Stamp [s], anchor b, the other anchor a of a difference or -1, error [m], and the antenna's place (n, 3) [m].
    """

    t: np.ndarray
    anchor: np.ndarray
    other: np.ndarray
    e: np.ndarray
    place: np.ndarray

    def only(self, which: np.ndarray) -> "RangeErrors":
        """Return the errors that a mask or indices select."""
        return RangeErrors(*(part[which] for part in self))


def calibration_of(recording: Recording, map_: Map) -> Calibration:
    """Return the calibration between truth and sensors, which leaves the anchors' constants in the errors.

    InputError if the recording has no truth.
    """
    if recording.truth is None:
        raise InputError(f"{recording.name}: truth: the map has none, and errors are counted from it")
    given = map_.calibration.share == 0.0
    found = calibrate(recording, map_.calibration, lever=given or recording.imu is not None)
    return found._replace(biases=np.zeros_like(found.biases))


def range_errors(recording: Recording, map_: Map, by: Calibration) -> RangeErrors:
    """Return the errors of a recording's ranges while it is airborne.

    InputError if fewer than 200 ranges fall within that time.
    """
    truth, ranges = recording.truth, recording.ranges
    assert truth is not None
    path = truth_path(truth)
    ranges = ranges.only(covered_ranges(ranges, by.offset, path))
    ranges = ranges.only(airborne(truth, by, map_)(ranges.t))
    if len(ranges.t) < FEWEST:
        raise InputError(f"{recording.name}: {len(ranges.t)} ranges within the truth's time, {FEWEST} are needed")
    p, R = path.at(ranges.t + by.offset)
    mount = np.eye(3) if by.mount is None else by.mount
    place = by.position(antennas(p, R, mount @ by.lever, recording.tags @ mount.T, ranges.tag))
    e = ranges.r - modelled(place, by.anchors, np.zeros(len(by.anchors)), ranges)
    return RangeErrors(ranges.t, ranges.anchor, ranges.other, e, place)
