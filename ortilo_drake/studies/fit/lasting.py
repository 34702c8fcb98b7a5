"""Lasting and white errors, outliers and constants of the anchors, fitted to recorded range errors.

The likelihood of lasting_filter.py is maximised. The intervals come from fits to blocks of time: their spread holds
also where the errors are not quite of this kind. Those of the constants come from the filter's covariance at the end.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import t as student

from ortilo_drake.studies.fit.greatest import greatest
from ortilo_drake.studies.fit.interval import TIMES, Interval, log_interval, normal_interval
from ortilo_drake.studies.fit.lasting_filter import PRIOR, lasting_filter
from ortilo_drake.studies.fit.range_errors import RangeErrors

START = (0.5, 0.1, 0.1, 0.03, 1.0)  # time [s], deviations [m], share, deviation [m]
LIMITS = ((0.02, 60.0), (1e-3, 5.0), (1e-3, 5.0), (1e-5, 0.4), (0.05, 30.0))
BLOCKS, NEAR = 10, (0.3,)  # of time, and the size of the search in each, in logarithms


class Lasting(NamedTuple):
    """The fitted lasting error.

    Time constant [s] and deviation of the lasting error [m], deviation of the white one [m], share of outliers and
    their deviation [m]; constants by anchor [m], None of one that was not heard; and of each recording's rows the
    probability to be outliers.
    """

    time: Interval
    sd: Interval
    white: Interval
    outliers: Interval
    outlier_sd: Interval
    constants: tuple[Interval | None, ...]
    outlier: list[np.ndarray]


def _run(
    errors: Sequence[RangeErrors], n: int, logs: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray, list[np.ndarray]]:
    x, C, total, outlier = np.zeros(n), PRIOR**2 * np.eye(n), 0.0, []
    for one in errors:
        odd = np.empty(len(one.t))
        total += lasting_filter(one.t, one.anchor, one.other, one.e, x, C, np.exp(logs), odd)
        outlier.append(odd)
    return total, x, C, outlier


def fit_lasting(errors: Sequence[RangeErrors], n: int, count: Callable[[int], None] = lambda _: None) -> Lasting:
    """Return the fit.

    Args:
        errors: of each recording.
        n: number of anchors.
        count: called with how many likelihoods were computed.
    """
    computed = 0

    def likelihood(logs: np.ndarray) -> float:
        nonlocal computed
        computed += 1
        count(computed)
        return _run(errors, n, logs)[0]

    logs = greatest(likelihood, np.log(START), LIMITS)
    _, x, C, outlier = _run(errors, n, logs)

    def of_block(block: RangeErrors) -> np.ndarray:
        return greatest(lambda at: _run([block], n, at)[0], logs, LIMITS, NEAR)

    each = np.array([of_block(block) for block in _blocks(errors)])
    sds = each.std(axis=0, ddof=1) / np.sqrt(len(each)) * student.ppf(0.975, len(each) - 1) / TIMES
    time, sd, white, share, far = (log_interval(at, sd) for at, sd in zip(logs, sds, strict=True))
    return Lasting(time, sd, white, share, far, _constants(errors, n, x, C), outlier)


def _blocks(errors: Sequence[RangeErrors]) -> list[RangeErrors]:
    """Return the recordings cut into blocks of time, about alike in rows."""
    rows, blocks = sum(len(one.t) for one in errors), []
    for one in errors:
        count = max(2, round(BLOCKS * len(one.t) / rows))
        blocks += [one.only(part) for part in np.array_split(np.arange(len(one.t)), count)]
    return blocks


def _constants(errors: Sequence[RangeErrors], n: int, x: np.ndarray, C: np.ndarray) -> tuple[Interval | None, ...]:
    """Return the constants; where there are differences alone, less their mean, which these do not tell."""
    heard = np.zeros(n, dtype=bool)
    for one in errors:
        heard[one.anchor] = True
        heard[one.other[one.other >= 0]] = True
    M = np.eye(n)
    if all((one.other >= 0).all() for one in errors):
        M -= np.outer(np.ones(n), heard / heard.sum())
    x, C = M @ x, M @ C @ M.T
    return tuple(normal_interval(x[i], np.sqrt(C[i, i])) if heard[i] else None for i in range(n))
