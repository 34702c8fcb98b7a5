"""Position and velocity by the ranges of a short time alone: where the filter starts, and where it starts anew.

Least squares over the antenna's p and v at the first stamp t_0, robust against single ranges that are far too long:

    Σ rho((|p + v (t_k - t_0) - a_i| + c_i - r_k) / 0.1 m) + |v|² / (2 m/s)²,   first rho = soft L1, then Cauchy

and, where the height is known or constant, (z - height)² / sd² and v_z² / sd². A vehicle that moves at the first stamp
is found moving. Three anchors, or all in one plane, leave a mirror image: the one near the last estimate is taken, or
at the start the one near z = 0.5 m, as no vehicle is under the floor and few are above the ceiling. Anchors almost in
one plane leave a local minimum on its wrong side: the search starts near their plane and far from it, on both sides.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from ortilo_drake.interop.recorded.recording import Ranges
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.recorded.filter_types import UNKNOWN_LEVEL, Level
from ortilo_drake.studies.recorded.truth_path import modelled

FIRST_RANGES = 1.0  # the ranges that a position goes by [s]
LONGEST = 3.0  # of slow ranges, until enough anchors are heard [s]
ENOUGH, LEAST = 4, 3  # anchors
SPREAD, SPEED = 0.1, 2.0  # of a range's error [m], and of a velocity [m/s]
CHANGE = 1.0  # of the velocity within a second [m/s]
SURE = 0.3  # no fix is better than this, as its ranges are filtered once more [m], [m/s]
UNSEEN = 1.0  # nor is it worse: it is in the room, even where no range tells its height [m], [m/s]
FITS = 0.3  # a range agrees that is this near [m]
FLOOR = 0.5  # of two mirror images the one near this height is taken at the start [m]
STARTS = (-1.5, -0.5, 0.5, 1.5)  # of the search, from the anchors' mean along the normal of their plane [m]
MIRROR = 3.0  # costs that differ by less do not tell one position from another

Arms = np.ndarray | float


class Fix(NamedTuple):
    """Position and velocity of the antenna (6), variances (6), and the share of ranges that agree."""

    x: np.ndarray
    variances: np.ndarray
    agreeing: float


def ranges_for_a_fix(ranges: Ranges) -> Ranges:
    """Return the first ranges, those that a fix goes by: of one second, or of up to three if they are slow.

    Raises:
        InputError: if fewer than three anchors are heard in it.
    """
    t = ranges.t[: np.searchsorted(ranges.t, ranges.t[0] + LONGEST, side="right")]
    _, at = np.unique(ranges.anchor[: len(t)], return_index=True)
    if len(at) < LEAST:
        raise InputError(f"ranges: {len(at)} anchors heard in the first {LONGEST:g} s, at least {LEAST} are needed")
    enough = t[np.sort(at)[min(ENOUGH, len(at)) - 1]]
    last = int(np.searchsorted(t, max(t[0] + FIRST_RANGES, enough), side="right"))
    return Ranges(*(part[:last] for part in ranges))


def fix_known_at(ranges: Ranges) -> float:
    """Return the stamp [s] after which no range belongs to ranges_for_a_fix, by the ranges received so far."""
    first = float(ranges.t[0])
    near = ranges.t <= first + LONGEST
    _, at = np.unique(ranges.anchor[near], return_index=True)
    if len(at) < ENOUGH:
        return first + LONGEST
    return max(first + FIRST_RANGES, float(ranges.t[np.sort(at)[ENOUGH - 1]]))


def agreeing(ranges: Ranges, anchors: np.ndarray, c: np.ndarray, x: np.ndarray, arms: Arms = 0.0) -> float:
    """Return the share of ranges that agree with position and velocity x (6) at the first stamp."""
    return float(np.mean(np.abs(_errors(ranges, anchors, c, x, arms)) < FITS))


def _errors(ranges: Ranges, anchors: np.ndarray, c: np.ndarray, x: np.ndarray, arms: Arms) -> np.ndarray:
    return modelled(x[:3] + (ranges.t - ranges.t[0])[:, None] * x[3:] + arms, anchors, c, ranges) - ranges.r


def solve_first_fix(
    ranges: Ranges,
    anchors: np.ndarray,
    c: np.ndarray,
    level: Level = UNKNOWN_LEVEL,
    near: np.ndarray | None = None,
    arms: Arms = 0.0,
) -> Fix:
    """Return position and velocity of the antenna at the first stamp.

    Args:
        ranges: of a short time.
        anchors: positions (n, 3).
        c: biases of the ranges (n) [m].
        level: what is known of the height.
        near: the last position that was known (3); none at the start.
        arms: from there to the tag of each range, in W (n, 3); 0 where there is one.
    """

    def residuals(x: np.ndarray) -> np.ndarray:
        known = [(x[2] - level.height) / level.deviation, x[5] / level.climb]
        return np.concatenate([_errors(ranges, anchors, c, x, arms) / SPREAD, x[3:] / SPEED, known])

    def solved(start: np.ndarray, loss: str) -> tuple[float, np.ndarray, np.ndarray]:
        found = least_squares(residuals, start, loss=loss)
        return float(found.cost), found.x, found.jac

    heard = anchors[np.unique(ranges.anchor)]
    middle = heard.mean(axis=0)
    normal = np.linalg.svd(heard - middle)[2][2]
    fits = [solved(np.append(middle + step * normal, np.zeros(3)), "soft_l1") for step in STARTS]
    best = min(fits, key=lambda found: found[0])
    near = np.array([*middle[:2], FLOOR]) if near is None else near
    nearest = min(fits, key=lambda found: float(np.linalg.norm(found[1][:3] - near)))
    best = nearest if nearest[0] < best[0] + MIRROR else best
    _, x, jacobian = solved(best[1], "cauchy")
    span = ranges.t[-1] - ranges.t[0]
    variances = np.minimum(np.diag(np.linalg.pinv(jacobian.T @ jacobian)), UNSEEN**2) + SURE**2
    variances[3:] += (CHANGE * span / 2.0) ** 2
    return Fix(x, variances, agreeing(ranges, anchors, c, x, arms))
