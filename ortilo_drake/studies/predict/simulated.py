"""A recording made along the recorded path: same stamps, same anchors, drawn errors.

Ranges and differences come when the recorded ones did, from the same anchors. The IMU says what an ideal one would on
the smoothed truth, as it is mounted, with bias and white noise. An axis of the accelerometer that the recorded flight's
filter gave up says nothing from then on.
"""

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from ortilo_drake.interop.recorded.recording import Imu, Recording
from ortilo_drake.scenario.noise_file import ImuNoise, NoiseFile
from ortilo_drake.studies.fit.body_path import BodyPath
from ortilo_drake.studies.predict.range_noise import draw_errors
from ortilo_drake.studies.recorded.calibrate import Calibration
from ortilo_drake.studies.recorded.modelled import modelled
from ortilo_drake.world.sensors.fitted_errors import Day


def low_passed(t: np.ndarray, density: np.ndarray, bandwidth: float, rng: np.random.Generator) -> np.ndarray:
    """Return noise (m, 3) that is white up to a bandwidth [Hz], of densities (3) there."""
    h = float(np.median(np.diff(t)))
    share = 1.0 - np.exp(-2.0 * np.pi * bandwidth * h)
    white = density / np.sqrt(h) * rng.standard_normal((len(t), 3))
    return np.asarray(lfilter([share], [1.0, share - 1.0], white, axis=0))


def simulated_imu(
    imu: Imu, path: BodyPath, mount: Rotation, noise: ImuNoise, failed: tuple[float, float], rng: np.random.Generator
) -> Imu:
    """Return the samples of an IMU on the path.

    Args:
        imu: whose stamps they have.
        path: where the body goes.
        mount: the IMU's axes in the truth's body.
        noise: of the IMU.
        failed: since when the accelerometer's x and y are not to be used [s].
        rng: draws noise and biases.
    """
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
