"""Errors that belong to places, fitted beside those that last: a Gaussian process over places and times.

The error of an anchor i at place p and time t of a flight is

    e_i = c_i + f_i(p) + g_i(t),   f_i Matérn 3/2 in space, the same in all recordings;   g_i Gauss-Markov in time

Flying a place twice separates errors of places from errors that last. The exact likelihood of a sample of the rows is
maximised; rows that are probably outliers are left out.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_solve, cholesky

from ortilo_drake.studies.fit.greatest import Interval, deviations, greatest, log_interval
from ortilo_drake.studies.fit.lasting import PRIOR
from ortilo_drake.studies.fit.sensor_errors import RangeErrors

ROWS = 800  # of the exact likelihood
SIZES = (0.4, 0.1)  # of the searches, in logarithms
LIMITS = ((0.05, 20.0), (1e-3, 5.0), (0.02, 60.0), (1e-3, 5.0), (1e-3, 5.0))


class Fields(NamedTuple):
    """The field's length and deviation [m], the lasting error's time constant [s] and deviation, the white one [m]."""

    length: Interval
    sd: Interval
    time: Interval
    lasting_sd: Interval
    white: Interval


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
) -> Fields:
    """Return the fit of the errors of each recording, of n anchors.

    By recording, `outlier` has each row's probability to be one. The start has the time constant [s] and deviation of
    what lasts, and the white deviation [m], without a field. The fit goes by so many rows.
    """
    flight = np.concatenate([np.full(len(one.t), k) for k, one in enumerate(errors)])
    t, anchor, other, e, place = (np.concatenate(part) for part in zip(*errors, strict=True))
    good = np.flatnonzero(np.concatenate(list(outlier)) < 0.5)
    if len(good) > rows:
        good = np.sort(np.random.Generator(np.random.Philox(0)).choice(good, rows, replace=False))
    flight, t, anchor, other, e, place = (part[good] for part in (flight, t, anchor, other, e, place))
    B = np.eye(n)[anchor] - np.where((other >= 0)[:, None], np.eye(n)[np.maximum(other, 0)], 0.0)
    same = B @ B.T  # how two rows share their anchors: what is of one anchor enters by it
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
    return Fields(*(log_interval(at, sd) for at, sd in zip(logs, deviations(likelihood, logs), strict=True)))
