"""A recorded flight and simulations of it: the same path, stamps, anchors and filter, with errors of a NOISE.yaml.

The simulated IMU measures what an ideal one would on the smoothed truth, as it is mounted, with bias and white noise.
An accelerometer axis that the recorded flight's filter gave up is missing from then on.

Errors of ranges are drawn as in world/sensors/fitted_uwb.py. A difference of the ranges to b and a has the error e_b -
e_a. Its row has the white noise of two ranges, drawn once, and is an outlier if one of them is: with probability 1 - (1
- q)².
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.range_rows import Ranges
from ortilo_drake.interop.recorded.recording import Imu, Recording
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.white_noise import nees_of
from ortilo_drake.scenario.noise_file import ImuNoise, NoiseFile, UwbNoise, as_white, white_scales
from ortilo_drake.studies.fit.sensor_errors import BodyPath, body_path, mount_of
from ortilo_drake.studies.recorded.at_rest import at_rest
from ortilo_drake.studies.recorded.calibrate import Calibration, calibrate
from ortilo_drake.studies.recorded.filtered import Estimate, estimate
from ortilo_drake.studies.recorded.scores import nis_of
from ortilo_drake.studies.recorded.setups import calibrated_setup, judged_part, with_aids
from ortilo_drake.studies.recorded.truth_path import modelled
from ortilo_drake.world.drawn_truth import AtStart
from ortilo_drake.world.sensors.fitted_uwb import (
    Day,
    draw_day,
    growth,
    outlier_chain,
    outlier_rows,
    row_error,
    share_of_pairs,
)

QUERY_RATE = 30.0  # largest rate of the stamps that are judged [Hz]
SHARES = (2.5, 97.5)  # percentiles of the simulations that bound the interval [%]
OF_ERROR, OF_NEES = 0.3, 1.5  # largest differences, relative of the error and absolute of NEES, of a predicted group


@dataclass(frozen=True)
class Figures:
    """Total RMS error [m], NEES (3 if consistent), NIS of the ranges (about 1), and the share of ranges refused."""

    error: float
    nees: float
    nis: float
    rejected: float


@dataclass(frozen=True)
class Predicted:
    """A flight's figures as recorded, from its simulations, and from its simulations with white noise alone."""

    name: str
    real: Figures
    fitted: tuple[Figures, ...]
    white: tuple[Figures, ...]


def interval(runs: Sequence[Figures], of: str) -> tuple[float, float]:
    """Return the interval in which 95 % of the simulations lie."""
    low, high = np.percentile([getattr(run, of) for run in runs], SHARES)
    return float(low), float(high)


def mean_of(runs: Sequence[Figures], of: str) -> float:
    """Return the mean over the simulations; for errors, the root of the mean square."""
    values = np.array([getattr(run, of) for run in runs])
    return float(np.sqrt(np.mean(values**2)) if of == "error" else np.mean(values))


def figures_of(found: Estimate, true: np.ndarray) -> Figures:
    """Return the figures of an estimate against true positions (m, 3)."""
    e = found.p - true
    error = float(np.sqrt(np.mean(np.sum(e**2, axis=1))))
    return Figures(error, float(np.mean(nees_of(e, found.P))), *nis_of(found, found.t[0], found.t[-1]))


def predict(
    recording: Recording, map_: Map, noise: NoiseFile, runs: int, seed: int, say: Callable[[str], None] = lambda _: None
) -> Predicted:
    """Return a flight's figures beside those of simulations along its path, each on a day of its own.

    The seed draws the days, the same for all recordings; `say` gets a line before each flight. InputError if the flight
    has no truth, or too little of it, or if the noise is for another number of anchors.
    """
    truth, imu = recording.truth, recording.imu
    if truth is None:
        raise InputError(f"{recording.name}: truth: the map has none, and a prediction flies along it")
    if imu is not None and noise.imu is None:
        raise InputError("noise.imu: is missing, and the recording has an imu")
    by = calibrate(recording, map_.calibration, lever=imu is not None)
    constants, n = noise.uwb.constants, len(by.anchors)
    if constants is not None and len(constants) != n:
        raise InputError(f"noise.uwb.constants: {len(constants)} of them, but {recording.name} has {n} anchors")
    path = body_path(recording.name, truth, by)
    mount = mount_of(recording, path, by, map_)
    known = with_aids(calibrated_setup(by, recording, map_), recording, map_, False)
    stamps, _, judged = judged_part(recording, by, map_)
    stamps = stamps[judged(stamps)]
    stamps = stamps[:: max(1, round(1.0 / (QUERY_RATE * float(np.median(np.diff(stamps))))))]
    say(f"{recording.name}, as recorded")
    found = estimate(recording.ranges, imu, known, map_.filter, stamps)
    real, failed = figures_of(found, path.position(found.t)), found.failed

    def flown(kind: NoiseFile, run: int) -> Figures:
        of_day = np.random.Generator(np.random.Philox(np.random.SeedSequence([seed, run])))
        of_flight = np.random.Generator(np.random.Philox(np.random.SeedSequence([seed, run, *recording.name.encode()])))
        day = draw_day(kind.uwb, n, numbers_of(of_day))
        if known.biases is not None:  # the simulated anchors have the calibrated constants, too
            day = day._replace(constants=known.biases)
        made = simulated(recording, by, path, mount, map_.floor, kind, day, failed, of_flight)
        told = known._replace(rest=at_rest(made, map_))  # from the simulated imu
        then = estimate(made.ranges, made.imu, told, map_.filter, stamps)
        return figures_of(then, path.position(then.t))

    figures = []
    for name, kind in (("fitted", noise), ("white", as_white(noise))):
        rows = []
        for run in range(runs):
            say(f"{recording.name}, {name}, {run + 1} of {runs}")
            rows.append(flown(kind, run))
        figures.append(tuple(rows))
    return Predicted(recording.name, real, *figures)


@dataclass(frozen=True)
class Group:
    """All flights together: RMS error [m] and NEES as recorded, and those of the fitted and the white simulations."""

    real_error: float
    real_nees: float
    error: float
    nees: float
    white_error: float
    white_nees: float

    @property
    def holds(self) -> bool:
        """Return whether the simulation predicts the group: error within 30 %, NEES within 1.5."""
        return abs(self.error / self.real_error - 1.0) <= OF_ERROR and abs(self.nees - self.real_nees) <= OF_NEES


def group_of(flights: Sequence[Predicted]) -> Group:
    """Return the figures of several flights together, all with the same weight."""

    def both(runs: Sequence[Sequence[Figures]]) -> tuple[float, float]:
        errors, nees = ([mean_of(one, of) for one in runs] for of in ("error", "nees"))
        return float(np.sqrt(np.mean(np.square(errors)))), float(np.mean(nees))

    kinds = ([(one.real,) for one in flights], [one.fitted for one in flights], [one.white for one in flights])
    return Group(*(figure for kind in kinds for figure in both(kind)))


def low_passed(t: np.ndarray, density: np.ndarray, bandwidth: float, rng: np.random.Generator) -> np.ndarray:
    """Return noise (m, 3) that is white up to a bandwidth [Hz], with densities (3) there."""
    h = float(np.median(np.diff(t)))
    share = 1.0 - np.exp(-2.0 * np.pi * bandwidth * h)
    white = density / np.sqrt(h) * rng.standard_normal((len(t), 3))
    return np.asarray(lfilter([share], [1.0, share - 1.0], white, axis=0))


def simulated_imu(
    imu: Imu, path: BodyPath, mount: Rotation, noise: ImuNoise, failed: tuple[float, float], rng: np.random.Generator
) -> Imu:
    """Return the samples of a simulated IMU on the path, at the stamps of `imu`; other arguments as for simulated."""
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
    """Return a function that draws standard normal numbers from a generator, whatever the stream's name."""
    return lambda name, n: rng.standard_normal(n)


def lasting_errors(t: np.ndarray, n: int, time: float, sd: float, rng: np.random.Generator) -> np.ndarray:
    """Return the Gauss-Markov errors of n anchors at ascending stamps (m, n)."""
    g = sd * rng.standard_normal((len(t), n))
    keep = np.exp(-np.diff(t) / time)
    for k, a in enumerate(keep):
        g[k + 1] = a * g[k] + np.sqrt(1.0 - a * a) * g[k + 1]
    return g


def draw_outliers(ranges: Ranges, noise: UwbNoise, rng: np.random.Generator) -> np.ndarray:
    """Draw a mask (m) of the outlier rows; the noise is that of single ranges."""
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
    """Return the errors of ranges and differences (m) [m]; place (m, 3) is the antenna's, floor the floor's z [m]."""
    noise, n, rows = noise.of_single_ranges, len(day.constants), np.arange(len(ranges.t))
    own = np.zeros((len(rows), n))
    if noise.lasting is not None:
        own += lasting_errors(ranges.t, n, noise.lasting.time, noise.lasting.sd, rng)
    if noise.field is not None:
        own += day.fields_at(place)
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

    It has the recording's stamps and pairs. `by` is the calibration between truth and sensors, path the body's path,
    mount the rotation from the IMU's axes to the truth's body, floor the floor's z [m]. noise are the sensors' errors,
    day those that are the same all day. The accelerometer's x and y are missing from `failed` on [s].
    """
    ranges = recording.ranges
    place = path.position(ranges.t) + (path.attitude(ranges.t) * mount).apply(by.lever + recording.tags[ranges.tag])
    r = modelled(place, by.anchors, np.zeros(len(by.anchors)), ranges)
    r = r + draw_errors(ranges, place, floor, noise.uwb, day, rng)
    imu = recording.imu
    if imu is not None and noise.imu is not None:
        imu = simulated_imu(imu, path, mount, noise.imu, failed, rng)
    return recording._replace(ranges=ranges._replace(r=r), imu=imu)
