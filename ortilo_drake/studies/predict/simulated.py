"""A recording made along the recorded path: same stamps, same anchors, drawn errors.

Ranges and differences come when the recorded ones did, from the same anchors. The IMU says what an ideal one would on
the smoothed truth, as it is mounted, with bias and white noise. An axis of the accelerometer that the recorded flight's
filter gave up says nothing from then on.

Errors of ranges are drawn as world/sensors/fitted_errors.py has them. A difference of the ranges to b and a errs by
e_b - e_a. Its row has the white noise of two ranges, drawn once, and is an outlier where one of them is: with
probability 1 - (1 - q)².
"""

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from ortilo_drake.interop.recorded.range_rows import Ranges
from ortilo_drake.interop.recorded.recording import Imu, Recording
from ortilo_drake.scenario.noise_file import ImuNoise, NoiseFile
from ortilo_drake.scenario.range_errors import UwbNoise, white_scales
from ortilo_drake.studies.fit.imu_errors import BodyPath
from ortilo_drake.studies.recorded.calibrate import Calibration
from ortilo_drake.studies.recorded.truth_path import modelled
from ortilo_drake.world.drawn_truth import AtStart
from ortilo_drake.world.sensors.fitted_errors import Day, growth, outlier_chain, outlier_rows, row_error, share_of_pairs


def low_passed(t: np.ndarray, density: np.ndarray, bandwidth: float, rng: np.random.Generator) -> np.ndarray:
    """Return noise (m, 3) that is white up to a bandwidth [Hz], of densities (3) there."""
    h = float(np.median(np.diff(t)))
    share = 1.0 - np.exp(-2.0 * np.pi * bandwidth * h)
    white = density / np.sqrt(h) * rng.standard_normal((len(t), 3))
    return np.asarray(lfilter([share], [1.0, share - 1.0], white, axis=0))


def simulated_imu(
    imu: Imu, path: BodyPath, mount: Rotation, noise: ImuNoise, failed: tuple[float, float], rng: np.random.Generator
) -> Imu:
    """Return the samples of an IMU on the path, by the stamps of another; arguments as simulated."""
    back = mount.inv()
    rates = back.apply(path.rates(imu.t)) + np.array(noise.rotation_bias) * rng.standard_normal(3)
    rates += low_passed(imu.t, np.array(noise.rotation), noise.bandwidth, rng)
    t = imu.t if imu.accelerometer is None else imu.accelerometer[0]
    force = back.apply(path.force(t)) + np.array(noise.force_bias) * rng.standard_normal(3)
    force += low_passed(t, np.array(noise.force), noise.bandwidth, rng)
    for axis, since in enumerate(failed):
        force[t >= since, axis] = np.nan
    attitude = None if imu.attitude is None else (path.attitude(imu.t) * mount).as_matrix()
    if imu.accelerometer is None:
        return Imu(imu.t, rates, force, attitude)
    held = force[np.clip(np.searchsorted(t, imu.t, side="right") - 1, 0, len(t) - 1)]
    return Imu(imu.t, rates, held, attitude, (t, force))


def numbers_of(rng: np.random.Generator) -> AtStart:
    """Return the standard normal numbers that a generator draws, whatever the name of their stream."""
    return lambda name, n: rng.standard_normal(n)


def lasting_errors(t: np.ndarray, n: int, time: float, sd: float, rng: np.random.Generator) -> np.ndarray:
    """Return Gauss-Markov errors of n anchors at rising stamps (m, n)."""
    g = sd * rng.standard_normal((len(t), n))
    keep = np.exp(-np.diff(t) / time)
    for k, a in enumerate(keep):
        g[k + 1] = a * g[k] + np.sqrt(1.0 - a * a) * g[k + 1]
    return g


def draw_outliers(ranges: Ranges, noise: UwbNoise, rng: np.random.Generator) -> np.ndarray:
    """Draw a mask (m) of the rows that are outliers, by the noise of single ranges."""
    share, found = noise.outliers.share, np.zeros(len(ranges.t), dtype=bool)
    for are, its in ((ranges.other < 0, share), (ranges.other >= 0, share_of_pairs(share))):
        if its == 0.0 or not are.any():
            continue
        anchor = ranges.anchor[are]
        u, before = rng.random(len(anchor)), rng.random(int(anchor.max()) + 1) < its
        found[are] = outlier_rows(anchor, before, u, *outlier_chain(its, noise.outliers.burst))
    return found


def draw_errors(
    ranges: Ranges, place: np.ndarray, floor: float, noise: UwbNoise, day: Day, rng: np.random.Generator
) -> np.ndarray:
    """Return the errors of ranges and differences (m) [m]; the antenna's place (m, 3), the floor's z [m]; any noise."""
    noise, n, rows = noise.of_single_ranges, len(day.constants), np.arange(len(ranges.t))
    own = np.zeros((len(rows), n))
    if noise.lasting is not None:
        own += lasting_errors(ranges.t, n, noise.lasting.time, noise.lasting.sd, rng)
    for i, field in enumerate(day.fields):
        own[:, i] += field.at(place)
    s = np.array([growth(height, noise.near_floor) for height in place[:, 2] - floor])
    far = np.where(draw_outliers(ranges, noise, rng), noise.outliers.sd, 0.0)
    is_difference, a = ranges.other >= 0, np.maximum(ranges.other, 0)
    white = noise.white * np.where(is_difference, np.sqrt(2.0), 1.0)
    constant = day.constants[ranges.anchor] - np.where(is_difference, day.constants[a], 0.0)
    lasts = own[rows, ranges.anchor] - np.where(is_difference, own[rows, a], 0.0)
    v = rng.standard_normal(len(rows))
    if noise.freedom is not None:
        white = white * np.where(far > 0.0, 1.0, rng.choice(white_scales(noise.freedom), len(rows)))
    return np.asarray(row_error(constant, lasts, s, white, far, v))


def simulated(
    recording: Recording,
    by: Calibration,
    path: BodyPath,
    mount: Rotation,
    floor: float,
    noise: NoiseFile,
    day: Day,
    failed: tuple[float, float],
    rng: np.random.Generator,
) -> Recording:
    """Return a simulated recording along a recorded path, without range finder, flow and camera.

    Args:
        recording: whose stamps and pairs it has.
        by: how its truth and sensors go together.
        path: where the body goes.
        mount: the IMU's axes in the truth's body.
        floor: its z [m].
        noise: of the sensors.
        day: what is the same all day.
        failed: since when the accelerometer's x and y are not to be used [s].
        rng: draws the rest.
    """
    ranges = recording.ranges
    place = path.position(ranges.t) + (path.attitude(ranges.t) * mount).apply(by.lever + recording.tags[ranges.tag])
    r = modelled(place, by.anchors, np.zeros(len(by.anchors)), ranges)
    r = r + draw_errors(ranges, place, floor, noise.uwb, day, rng)
    imu = recording.imu
    if imu is not None and noise.imu is not None:
        imu = simulated_imu(imu, path, mount, noise.imu, failed, rng)
    return recording._replace(ranges=ranges._replace(r=r), imu=imu)
