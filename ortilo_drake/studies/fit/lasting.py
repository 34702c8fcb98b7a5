"""Lasting and white errors, outliers and constants of the anchors, fitted to recorded range errors.

Each anchor i has a constant c_i [m], the same in all recordings, and an error g_i [m] that lasts: a first-order
Gauss-Markov process of its own. An error of a range to b, or of a difference of the ranges to b and a, is

    e = c_b + g_b (- c_a - g_a) + white,   an outlier with probability q, whose error has a further deviation o

The white part may have a heavy tail: it is Student's t by six normals (scenario/noise_file.py). A row's density is the
mixture of all. The estimate after a row has the mixture's mean and covariance (Bar-Shalom, Li and Kirubarajan,
Estimation with Applications, 2001, section 11.6.4: the first generalised pseudo-Bayesian estimator).

The likelihood is maximised. The intervals come from fits to blocks of time: their spread holds also where the errors
are not quite of this kind. Where several recordings differ by more than their blocks, Student's t over the recordings
counts. The intervals of the constants are no narrower than the filter's covariance makes them.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.scenario.noise_file import white_scales
from ortilo_drake.studies.fit.greatest import TIMES, Interval, greatest, half_width, log_interval, normal_interval
from ortilo_drake.studies.fit.sensor_errors import RangeErrors

PRIOR = 1.0  # deviation of a constant [m]
START = (0.5, 0.1, 0.1, 0.03, 1.0, 3.0)  # time [s], deviations [m], share, deviation [m], degrees of freedom
LIMITS = ((0.02, 60.0), (1e-3, 5.0), (1e-3, 5.0), (1e-5, 0.4), (0.05, 30.0), (0.5, 100.0))
BLOCKS, NEAR = 10, (0.3,)  # blocks of time, and the step of the search in each, in logarithms


@cached_njit
def lasting_filter(
    t: np.ndarray,
    anchor: np.ndarray,
    other: np.ndarray,
    e: np.ndarray,
    x: np.ndarray,
    C: np.ndarray,
    numbers: np.ndarray,
    scales: np.ndarray,
    outlier: np.ndarray,
) -> float:
    """Return the log-likelihood of a recording's errors; x and C become the constants' estimate after it.

    Args:
        t: stamps [s] (m).
        anchor: b (m).
        other: a, or -1 (m).
        e: errors [m] (m).
        x: the constants' means (n); changed.
        C: the constants' covariance (n, n); changed.
        numbers: time constant [s], deviation of the lasting error, of the white one [m], q, and o [m].
        scales: equally likely factors of the white deviation (k).
        outlier: receives each row's probability of being an outlier (m).
    """
    n, (tau, sd, white, share, far) = len(x), numbers
    z, S = np.zeros(2 * n), np.zeros((2 * n, 2 * n))
    z[:n], S[:n, :n] = x, C
    for i in range(n, 2 * n):
        S[i, i] = sd * sd
    column, total, m = np.empty(2 * n), 0.0, len(scales)
    variance, density, prior = np.empty(m + 1), np.empty(m + 1), np.full(m + 1, np.log((1.0 - share) / m))
    prior[m] = np.log(share)
    for k in range(len(t)):
        h = t[k] - t[k - 1] if k > 0 else 0.0
        if h > 0.0:
            keep = np.exp(-h / tau)
            for i in range(n, 2 * n):
                z[i] *= keep
                for j in range(n):
                    S[i, j] *= keep
                    S[j, i] = S[i, j]
                for j in range(n, 2 * n):
                    S[i, j] *= keep * keep
                S[i, i] += (1.0 - keep * keep) * sd * sd
        b, a = anchor[k], other[k]
        for i in range(2 * n):
            column[i] = S[i, b] + S[i, n + b]
            if a >= 0:
                column[i] -= S[i, a] + S[i, n + a]
        y, V = e[k] - z[b] - z[n + b], column[b] + column[n + b]
        if a >= 0:
            y += z[a] + z[n + a]
            V -= column[a] + column[n + a]
        variance[:m] = V + white * white * scales * scales
        variance[m] = V + white * white + far * far
        density[:] = prior - 0.5 * (np.log(2.0 * np.pi * variance) + y * y / variance)
        most = density.max()
        both = most + np.log(np.sum(np.exp(density - most)))
        total += both
        p = np.exp(density - both)
        outlier[k] = p[m]
        inverse = np.sum(p / variance)
        moves = y * inverse
        known = inverse - np.sum(p * (y / variance) ** 2) + moves * moves
        for i in range(2 * n):
            z[i] += column[i] * moves
            for j in range(2 * n):
                S[i, j] -= column[i] * column[j] * known
    x[:], C[:] = z[:n], S[:n, :n]
    return total


class Lasting(NamedTuple):
    """The fitted errors.

    time [s] and sd [m] are of the lasting error, white [m] is the deviation of the white one, outliers and outlier_sd
    [m] are the outliers' share and deviation. freedom is the white error's degrees of freedom, None if it is normal.
    constants [m] are by anchor, None for an anchor that was not heard. outlier has for each recording the rows'
    probabilities of being outliers.
    """

    time: Interval
    sd: Interval
    white: Interval
    outliers: Interval
    outlier_sd: Interval
    freedom: Interval | None
    constants: tuple[Interval | None, ...]
    outlier: list[np.ndarray]


def _run(
    errors: Sequence[RangeErrors], n: int, logs: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray, list[np.ndarray]]:
    x, C, total, outlier = np.zeros(n), PRIOR**2 * np.eye(n), 0.0, []
    numbers = np.exp(logs)
    scales = white_scales(float(numbers[5]) if len(numbers) > 5 else None)
    for one in errors:
        odd = np.empty(len(one.t))
        total += lasting_filter(one.t, one.anchor, one.other, one.e, x, C, numbers[:5], scales, odd)
        outlier.append(odd)
    return total, x, C, outlier


def fit_lasting(errors: Sequence[RangeErrors], n: int, tail: bool = True) -> Lasting:
    """Return the fit to the errors of all recordings, for n anchors; without `tail`, the white error is normal."""
    start, limits = (START, LIMITS) if tail else (START[:-1], LIMITS[:-1])
    logs = greatest(lambda at: _run(errors, n, at)[0], np.log(start), limits)
    _, x, C, outlier = _run(errors, n, logs)

    def of_block(block: RangeErrors) -> np.ndarray:
        return greatest(lambda at: _run([block], n, at)[0], logs, limits, NEAR)

    parts = _blocks(errors)
    halves = widest([np.array([of_block(block) for block in blocks]) for blocks in parts])
    found = [log_interval(at, half / TIMES) for at, half in zip(logs, halves, strict=True)]
    time, sd, white, share, far = found[:5]
    freedom = found[5] if tail else None
    each = [np.array([_constants([block], *_run([block], n, logs)[1:3])[0] for block in blocks]) for blocks in parts]
    values, sds = _constants(errors, x, C)
    sds = np.fmax(sds, widest(each) / TIMES)  # NaN for an anchor that a block has not heard; fmax skips it
    constants = tuple(None if np.isnan(c) else normal_interval(c, s) for c, s in zip(values, sds, strict=True))
    return Lasting(time, sd, white, share, far, freedom, constants, outlier)


def widest(each: Sequence[np.ndarray]) -> np.ndarray:
    """Return half the widths of the intervals of numbers fitted to blocks of each recording (blocks, k).

    The larger half width counts: that over the blocks, or that over the recordings if there are several.
    """
    halves = [half_width(np.concatenate(each))]
    if len(each) > 1:
        halves.append(half_width(np.array([of_blocks.mean(axis=0) for of_blocks in each])))
    return np.asarray(np.max(halves, axis=0))


def _blocks(errors: Sequence[RangeErrors]) -> list[list[RangeErrors]]:
    """Return each recording cut into blocks of time with about as many rows each."""
    rows, found = sum(len(one.t) for one in errors), []
    for one in errors:
        count = max(2, round(BLOCKS * len(one.t) / rows))
        found.append([one.only(part) for part in np.array_split(np.arange(len(one.t)), count)])
    return found


def _constants(errors: Sequence[RangeErrors], x: np.ndarray, C: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the constants, NaN for an anchor that was not heard, and their deviations (n each).

    If all rows are differences, the constants' mean, which differences do not determine, is subtracted.
    """
    n = len(x)
    heard = np.zeros(n, dtype=bool)
    for one in errors:
        heard[one.anchor] = True
        heard[one.other[one.other >= 0]] = True
    M = np.eye(n)
    if all((one.other >= 0).all() for one in errors):
        M -= np.outer(np.ones(n), heard / heard.sum())
    return np.where(heard, M @ x, np.nan), np.sqrt(np.diag(M @ C @ M.T))
