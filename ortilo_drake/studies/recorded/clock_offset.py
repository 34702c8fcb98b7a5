"""The offset of the truth's clock from the sensors', by the turns that both truth and gyro saw.

Over each interval the truth's turn, as a rotation vector, is M times the integral of the body rates; M turns the IMU's
body axes to the truth's. The offset is the one whose best M (Kabsch) leaves the smallest residual. Intervals overlap.
They are long enough for the truth's turns to exceed its noise, which the third differences of its attitude tell.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ortilo_drake.interop.recorded.recording import Imu, Truth
from ortilo_drake.studies.recorded.truth_path import interpolated

COARSE, FINE, NEAR = 0.02, 0.001, 1.0  # two steps of the search, and its reach around a roughly known offset [s]
SPANS = (0.05, 1.0)  # the shortest and about the longest interval [s]
STANDS_OUT = 6.0  # least ratio of the turns' RMS to the attitude's noise
LONGEST = 3.0  # intervals of the truth longer than this many medians contain a gap and are left out
TELLS = 0.1  # body rates tell the clock if they leave a smaller share of the turns' mean square; transposed R leave 0.2


class ByRates(NamedTuple):
    """Offset [s], mount M (3, 3) from the IMU's body axes to the truth's, and the unexplained share of the turns.

    `scale` is the factor of the rates that would leave the smallest share, `scaled` the share left with it.
    """

    offset: float
    mount: np.ndarray
    left: float
    scale: float
    scaled: float


def intervals_apart(t: np.ndarray, R: Rotation) -> int:
    """Return how many stamps apart attitudes R (n) at t (n) [s] must be for their turn to exceed their noise."""
    step = float(np.median(np.diff(t)))
    third = np.diff((R[:-1].inv() * R[1:]).as_rotvec(), 2, axis=0)  # multiplies the variance of white noise by 20
    noise = float(np.sqrt(np.mean(np.sum(third**2, axis=1)) / 20.0))
    apart = max(1, int(np.ceil(SPANS[0] / step - 1e-6)))
    while 2 * apart * step < SPANS[1] and 4 * apart < len(t):
        turns = (R[:-apart].inv() * R[apart:]).magnitude()
        if np.sqrt(np.mean(turns**2)) > STANDS_OUT * noise:
            break
        apart *= 2
    return min(apart, len(t) - 1)


def best_by_rates(
    imu: Imu,
    truth: Truth,
    part: Callable[[float], tuple[float, float]],
    search: float,
    known: float | None,
    centres: Sequence[float] = (0.0,),
    any_scale: bool = False,
) -> ByRates:
    """Return the best offset and mount, even if they leave much: they tell the clock only if `left` is below TELLS.

    Args:
        imu: the body rates.
        truth: the attitudes.
        part: maps an offset to the first and the last stamp of the truth that may be used [s].
        search: greatest distance from a centre that is tried [s].
        known: the offset, if only the mount is asked for [s].
        centres: offsets to search around [s].
        any_scale: whether to minimise `scaled` instead of `left`.
    """
    assert truth.R is not None
    R = Rotation.from_matrix(truth.R)
    apart = intervals_apart(truth.t, R)
    all_turns = (R[:-apart].inv() * R[apart:]).as_rotvec()
    begins, ends = truth.t[:-apart], truth.t[apart:]
    whole = ends - begins < LONGEST * np.median(ends - begins)
    swept = np.zeros((len(imu.t), 3))
    swept[1:] = np.cumsum((imu.rates[1:] + imu.rates[:-1]) / 2.0 * np.diff(imu.t)[:, None], axis=0)

    def fit(offset: float) -> ByRates:
        begin, end = part(offset)
        usable = whole & (begins >= begin) & (ends <= end)
        turns, first, last = all_turns[usable], begins[usable], ends[usable]
        both = (first - offset >= imu.t[0]) & (last - offset <= imu.t[-1])
        if both.sum() < max(20, 0.3 * len(both)):
            return ByRates(offset, np.eye(3), np.inf, 1.0, np.inf)
        seen = turns[both]
        swept_then = np.subtract(*(interpolated(t[both] - offset, imu.t, swept) for t in (last, first)))
        seen, swept_then = seen - seen.mean(axis=0), swept_then - swept_then.mean(axis=0)  # without a gyro's bias
        U, _, Vt = np.linalg.svd(seen.T @ swept_then)
        M = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
        turned, size = swept_then @ M.T, max(np.mean(seen**2), 1e-12)
        scale = float(np.sum(seen * turned) / max(np.sum(turned**2), 1e-12))
        left, scaled = (float(np.mean((seen - by * turned) ** 2) / size) for by in (1.0, scale))
        return ByRates(offset, M, left, scale, scaled)

    def badness(offset: float) -> float:
        found = fit(offset)
        return found.scaled if any_scale else found.left

    best = known
    if best is None:
        tried = np.concatenate([centre + np.arange(-search, search + COARSE, COARSE) for centre in centres])
        best = min(tried, key=badness)
        best = min(np.arange(best - COARSE, best + COARSE + FINE, FINE), key=badness)
    return fit(float(best))


def gains_by_rates(imu: Imu | None, truth: Truth | None, offset: float) -> float | None:
    """Return the gain of the truth's clock on the imu's [s/s], by the truth's two halves; None if they do not tell."""
    if imu is None or truth is None or truth.R is None:
        return None
    middle = (truth.t[0] + truth.t[-1]) / 2.0
    first = best_by_rates(imu, truth, lambda _: (-np.inf, middle), NEAR, None, (offset,))
    second = best_by_rates(imu, truth, lambda _: (middle, np.inf), NEAR, None, (offset,))
    told = max(first.left, second.left) < TELLS
    return (second.offset - first.offset) / ((truth.t[-1] - truth.t[0]) / 2.0) if told else None
