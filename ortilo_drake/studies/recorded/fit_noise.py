"""The filter's noise fitted to the first parts of recorded motions: one set for all of them.

By innovations alone: the maximum of their likelihood, Σ -1/2 (log S + min(e²/S, gate²)), each range counted at most as
if it lay on the gate. With truth: the maximum of the errors' likelihood, Σ -1/2 (log |P| + e' P^-1 e), at the truth's
stamps.
The logarithms of the numbers are searched by Nelder and Mead's simplex, begun anew where it stopped until that gains
nothing.
"""

from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

import numpy as np
from scipy.optimize import minimize

from ortilo_drake.interop.recorded.map_file import FilterSettings, Map
from ortilo_drake.interop.recorded.recording import Recording, between
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.recorded.calibrate import calibrate
from ortilo_drake.studies.recorded.filtered import Begin, FilterSetup, estimate, innovation_score, noise_of
from ortilo_drake.studies.recorded.scores import nees_of
from ortilo_drake.studies.recorded.setups import calibrated_setup, given_level
from ortilo_drake.studies.recorded.truth_path import truth_path

FITTED = ("acceleration", "range_white", "range_correlated", "correlation_time")
LIMITS = {  # beyond these a number is no such noise; it also keeps the search from degenerate corners
    "acceleration": (0.01, 10.0),
    "range_white": (0.005, 1.0),
    "range_correlated": (0.002, 1.0),
    "correlation_time": (0.1, 30.0),
}
STEP = 0.4  # of the simplex that each search begins with, in the numbers' logarithms
MOST = 800  # likelihoods; a fit takes some 100 to 500
GAINED = 1.0  # a search that raises the log-likelihood by less is the last
SETTLED = 3.0  # the first seconds are left out: they judge the start, not the noise [s]
MOST = 800  # likelihoods computed
By = Literal["innovations", "truth"]


class Fitted(NamedTuple):
    """The settings found, the log-likelihood before and after, its number of evaluations, and the criterion."""

    settings: FilterSettings
    before: float
    after: float
    computed: int
    by: str
    motions: tuple[str, ...]


def _likelihood_of(recording: Recording, map_: Map, by: By) -> Callable[[FilterSettings, bool], float]:
    """Return the log-likelihood of a recording's first part as a function of the settings.

    Its second argument says whether to search anew where the filter begins, which takes nine tenths of the time.
    """
    truth, imu, anchors, level = recording.truth, recording.imu, np.asarray(recording.anchors), given_level(map_)
    known = FilterSetup(anchors, None, np.zeros(3), None, level, tags=recording.tags)
    calibration, end, queries = None, map_.calibration.share * recording.ranges.t[-1], np.zeros(0)
    if truth is not None:
        calibration = calibrate(recording, map_.calibration, lever=imu is not None, level=level)
        known, end = calibrated_setup(calibration, recording, map_), calibration.end - calibration.offset
        if by == "truth":
            queries = truth.t - calibration.offset
            queries = queries[(queries >= SETTLED) & (queries <= end)]
    ranges = recording.ranges.only(recording.ranges.t <= end)
    imu = None if imu is None else between(imu, -np.inf, ranges.t[-1])

    begin: Begin | None = None

    def likelihood(settings: FilterSettings, anew: bool) -> float:
        nonlocal begin
        found = estimate(ranges, imu, known, settings, queries, begin=None if anew else begin)
        begin = found.begin
        if truth is None or calibration is None or by == "innovations":
            settled = found.range_stamps >= SETTLED
            run = found.run._replace(innovation=found.run.innovation[settled], variance=found.run.variance[settled])
            return innovation_score(run, noise_of(settings, imu is not None).gate)
        e = found.p - calibration.position(truth_path(truth).at(found.t + calibration.offset)[0])
        return float(-0.5 * np.sum(np.linalg.slogdet(found.P)[1] + nees_of(e, found.P)))

    return likelihood


def fit_noise(
    recordings: Sequence[Recording], map_: Map, by: By, count: Callable[[int], None], most: int = MOST
) -> Fitted:
    """Return the noise that fits the first parts of all motions best, starting from the map's.

    `count` is called with how many likelihoods were computed, of which there are at most so many.

    Raises:
        InputError: if there is no IMU, or no truth to fit by.
    """
    if any(recording.imu is None for recording in recordings):
        raise InputError("imu: the map has none; the noise of the constant-velocity filter is not fitted")
    if by == "truth" and any(recording.truth is None for recording in recordings):
        raise InputError("truth: the map has none; fit by innovations")
    if map_.calibration.share == 0.0:
        raise InputError("calibration.share: 0: the noise is fitted to the first part: give its share")
    if any(isinstance(recording.anchors, int) and recording.truth is None for recording in recordings):
        raise InputError("anchors: unknown")
    likelihoods = [_likelihood_of(recording, map_, by) for recording in recordings]
    computed = 0

    def settings_at(x: np.ndarray) -> FilterSettings:
        numbers = {name: float(np.exp(v)) for name, v in zip(FITTED, x, strict=True)}
        return map_.filter.model_copy(update=numbers)

    def cost(x: np.ndarray, anew: bool = False) -> float:
        nonlocal computed
        computed += 1
        count(computed)
        if np.any((x < np.log(least)) | (x > np.log(largest))):
            return 1e12
        return -sum(likelihood(settings_at(x), anew) for likelihood in likelihoods)

    before = sum(likelihood(map_.filter, True) for likelihood in likelihoods)
    least, largest = np.array([LIMITS[name] for name in FITTED]).T
    x = np.log(np.clip([getattr(map_.filter, name) for name in FITTED], least, largest))
    best = cost(x)
    while computed < most:  # the gate makes the cost jump, on which one simplex may get stuck
        simplex = np.vstack([x, x + STEP * np.eye(len(x))])
        options = {"maxfev": most - computed, "xatol": 0.01, "fatol": 0.2, "initial_simplex": simplex, "adaptive": True}
        found = minimize(cost, x, method="Nelder-Mead", options=options)
        if found.fun < best:
            x = found.x
        last, best = best, cost(x, anew=True)
        if last - best < GAINED:
            break
    rounded = {name: float(f"{v:.3g}") for name, v in zip(FITTED, np.exp(x), strict=True)}
    settings = map_.filter.model_copy(update=rounded)
    names = tuple(recording.name for recording in recordings)
    return Fitted(settings, before, -best, computed, by, names)
