"""The fit of all sensor errors to recordings with a truth, in the form of NOISE.yaml.

Errors that belong to places are fitted together with lasting errors, as a Gaussian process over places and times. The
error of an anchor i at place p and time t of a flight is

    e_i = c_i + f_i(p) + g_i(t),   f_i Matérn 3/2 in space, the same in all recordings;   g_i Gauss-Markov in time

Flying a place twice separates errors of places from errors that last. The exact likelihood of a sample of the rows is
maximised; rows that are probably outliers are left out.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.linalg import cho_solve, cholesky

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.recording import Recording
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario.noise_file import FieldNoise, ImuNoise, LastingNoise, NoiseFile, Outliers, UwbNoise
from ortilo_drake.studies.fit.greatest import TIMES, Interval, deviations, greatest, half_width, log_interval
from ortilo_drake.studies.fit.lasting import PRIOR, Lasting, fit_lasting
from ortilo_drake.studies.fit.sensor_errors import (
    ImuErrors,
    RangeErrors,
    body_path,
    calibration_of,
    imu_errors,
    mount_of,
    range_errors,
)

ROWS = 800  # rows in the exact likelihood
SIZES = (0.4, 0.1)  # step sizes of the searches, in logarithms
LIMITS = ((0.05, 20.0), (1e-3, 5.0), (0.02, 60.0), (1e-3, 5.0), (1e-3, 5.0))


Figures = dict[str, Interval]


def matern(d: np.ndarray, length: float) -> np.ndarray:
    """Return Matérn's correlation of smoothness 3/2 at distances d [m]."""
    scaled = np.sqrt(3.0) / length * d
    return np.asarray((1.0 + scaled) * np.exp(-scaled))


def fit_fields(
    errors: Sequence[RangeErrors],
    outlier: Sequence[np.ndarray],
    n: int,
    start: tuple[float, float, float],
    rows: int = ROWS,
) -> Figures:
    """Return the fit to the errors of all recordings, for n anchors, by place in NOISE.yaml.

    It has the field's length and deviation [m], the lasting error's time constant [s] and deviation [m], and the white
    deviation [m].

    `outlier` has for each recording the rows' probabilities of being outliers. `start` is a fit without a field: time
    constant [s] and deviation of the lasting error, and the white deviation [m]. The fit uses at most `rows` rows.
    """
    flight = np.concatenate([np.full(len(one.t), k) for k, one in enumerate(errors)])
    t, anchor, other, e, place = (np.concatenate(part) for part in zip(*errors, strict=True))
    good = np.flatnonzero(np.concatenate(list(outlier)) < 0.5)
    if len(good) > rows:
        good = np.sort(np.random.Generator(np.random.Philox(0)).choice(good, rows, replace=False))
    flight, t, anchor, other, e, place = (part[good] for part in (flight, t, anchor, other, e, place))
    B = np.eye(n)[anchor] - np.where((other >= 0)[:, None], np.eye(n)[np.maximum(other, 0)], 0.0)
    same = B @ B.T  # anchors that two rows share, which correlate the rows
    d = np.linalg.norm(place[:, None] - place[None], axis=2)
    h = np.where(flight[:, None] == flight[None], np.abs(t[:, None] - t[None]), np.inf)

    def likelihood(logs: np.ndarray) -> float:
        length, sd, time, lasting_sd, white = np.exp(logs)
        K = same * (PRIOR**2 + sd**2 * matern(d, length) + lasting_sd**2 * np.exp(-h / time))
        K[np.diag_indices(len(e))] += white**2
        L = cholesky(K, lower=True, overwrite_a=True, check_finite=False)
        return float(-0.5 * e @ cho_solve((L, True), e, check_finite=False) - np.sum(np.log(np.diag(L))))

    time, lasting, white = start
    first = np.log([1.0, 0.7 * lasting, time, 0.7 * lasting, white])
    logs = greatest(likelihood, first, LIMITS, SIZES)
    names = "uwb.field.length", "uwb.field.sd", "uwb.lasting.time", "uwb.lasting.sd", "uwb.white"
    ends = zip(logs, deviations(likelihood, logs), strict=True)
    return {name: log_interval(at, sd) for name, (at, sd) in zip(names, ends, strict=True)}


DIGITS = 3


def fit_recordings(
    recordings: Sequence[Recording], map_: Map, places: bool, say: Callable[[str], None] = lambda _: None
) -> NoiseFile:
    """Fit the sensors' errors to recordings, in the form that a simulation takes.

    With `places`, errors that belong to places are separated from lasting errors. `say` gets the name of each step.
    InputError if a recording has no truth, too few ranges, or other anchors than the first.
    """
    for one in recordings:
        if np.ndim(one.anchors) == 0 or not np.array_equal(one.anchors, recordings[0].anchors):
            raise InputError(f"{one.name}: anchors: must be surveyed, and the same as those of {recordings[0].name}")
    errors, notes = [], []
    imus: list[tuple[str, ImuErrors]] = []
    for one in recordings:
        say(one.name)
        by = calibration_of(one, map_)
        errors.append(range_errors(one, map_, by))
        if one.imu is not None and one.truth is not None and one.truth.R is not None:
            path = body_path(one.name, one.truth, by)
            of_imu = imu_errors(one, path, mount_of(one, path, by, map_), by, map_)
            imus += [] if of_imu is None else [(one.name, of_imu)]
        elif one.imu is not None:
            notes.append(f"{one.name}: the truth has no attitude: errors of the imu are not fitted")
    n = len(np.asarray(recordings[0].anchors))
    say("errors that last")
    lasting = fit_lasting(errors, n, tail=not places)
    figures: Figures = {"uwb.white": lasting.white, "uwb.lasting.time": lasting.time, "uwb.lasting.sd": lasting.sd}
    if lasting.freedom is not None:
        figures["uwb.freedom"] = lasting.freedom
    if places:
        say("errors of places")
        start = lasting.time.value, lasting.sd.value, lasting.white.value
        figures |= fit_fields(errors, lasting.outlier, n, start)
    at = {name: _short(figure.value) for name, figure in figures.items()}
    known = [None if c is None else c.value for c in lasting.constants]
    figures |= {f"uwb.constants.{i}": c for i, c in enumerate(lasting.constants) if c is not None}
    rate, missing = _rate([one.ranges.t for one in recordings])
    uwb = UwbNoise(
        white=at["uwb.white"],
        freedom=at.get("uwb.freedom"),
        lasting=LastingNoise(time=at["uwb.lasting.time"], sd=at["uwb.lasting.sd"]),
        field=FieldNoise(length=at["uwb.field.length"], sd=at["uwb.field.sd"]) if places else None,
        outliers=_outliers(errors, lasting, figures),
        constants_sd=_short(float(np.sqrt(np.mean([c**2 for c in known if c is not None])))),
        constants=None if None in known else tuple(_short(c) for c in known if c is not None),
        differences=all((one.ranges.other >= 0).all() for one in recordings),
        rate=rate,
        missing=missing,
    )
    imu = _imu(imus, recordings, notes, figures)
    intervals = {name: (_short(figure.low), _short(figure.high)) for name, figure in figures.items()}
    names = tuple(one.name for one in recordings)
    return NoiseFile(uwb=uwb, imu=imu, intervals=intervals, recordings=names, notes=tuple(notes))


def _short(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def _rate(stamps: Sequence[np.ndarray]) -> tuple[float, float]:
    """Return the rate [1/s], and the share of measurements that are missing if the median interval is the usual one."""
    time = sum(float(t[-1] - t[0]) for t in stamps)
    steps = np.concatenate([np.diff(t)[np.diff(t) > 0.0] for t in stamps])
    came = sum(len(np.unique(t)) for t in stamps)
    missing = min(0.5, max(0.0, 1.0 - came * float(np.median(steps)) / time))
    return _short(sum(len(t) for t in stamps) / time), _short(missing)


def _outliers(errors: Sequence[RangeErrors], lasting: Lasting, figures: Figures) -> Outliers:
    """Return the outliers with the mean number of an anchor's outliers in a row; add their intervals to figures."""
    bursts = odds = 0
    for one, p in zip(errors, lasting.outlier, strict=True):
        for i in np.unique(one.anchor):
            odd = p[one.anchor == i] > 0.5
            odds += int(odd.sum())
            bursts += int(odd[0]) + int((odd[1:] & ~odd[:-1]).sum())
    figures |= {"uwb.outliers.share": lasting.outliers, "uwb.outliers.sd": lasting.outlier_sd}
    burst = odds / bursts if bursts else 1.0
    return Outliers(share=_short(lasting.outliers.value), sd=_short(lasting.outlier_sd.value), burst=_short(burst))


def _of_recordings(values: np.ndarray, sds: np.ndarray) -> Interval:
    """Return a density's interval about the median of the recordings (k); sds (k) are those of the values' logarithms.

    It is Student's over the recordings, but no narrower than sds make it.
    """
    if values.min() == 0.0:  # samples that never change
        return Interval(float(np.median(values)), 0.0, float(values.max()))
    logs, k = np.log(values), len(values)
    half = TIMES * np.sqrt(np.mean(sds**2) / k)
    if k > 1:
        half = max(half, float(half_width(logs)))
    low, high = np.exp(logs.mean() + np.array([-half, half]))
    return Interval(float(np.median(values)), float(low), float(high))


def _imu(
    named: Sequence[tuple[str, ImuErrors]], recordings: Sequence[Recording], notes: list[str], figures: Figures
) -> ImuNoise | None:
    """Return the IMU's noise: the median of the recordings, by axis; None without an IMU. It adds notes and figures."""
    if not named:
        return None
    found = [one for _, one in named]
    faulty = np.isnan([one.force for one in found])
    for (name, _), axes in zip(named, faulty, strict=True):
        called = " and ".join("xyz"[i] for i in np.flatnonzero(axes))
        notes.extend([f"{name}: the accelerometer's {called} is faulty, and not counted"] * bool(called))
    numbers: dict[str, Any] = {}
    for name in ("rotation", "force", "rotation_rest", "force_rest"):
        each = np.array([getattr(one, name) for one in found])
        if np.isnan(each).all():
            continue
        none = np.isnan(each).all(axis=0)
        middle = np.where(none, np.nanmedian(each), np.nanmedian(np.where(none, 0.0, each), axis=0))
        numbers[name] = tuple(_short(v) for v in middle)
        sds = np.array([one.sd_rest if name.endswith("_rest") else one.sd for one in found])
        for i in np.flatnonzero(~none):
            its = ~np.isnan(each[:, i])
            figures[f"imu.{name}.{'xyz'[i]}"] = _of_recordings(each[its, i], sds[its])
    if "force" not in numbers:
        notes.append("imu: all axes of all accelerometers are faulty: errors of the imu are not fitted")
        return None
    for name in ("rotation_bias", "force_bias"):
        squares = np.array([getattr(one, name) for one in found]) ** 2
        none = np.isnan(squares).all(axis=0)
        spread = np.sqrt(np.where(none, np.nanmean(squares), np.nanmean(np.where(none, 0.0, squares), axis=0)))
        numbers[name] = tuple(_short(v) for v in spread)
    rate, missing = _rate([one.imu.t for one in recordings if one.imu is not None])
    return ImuNoise(**numbers, rate=rate, missing=missing)
