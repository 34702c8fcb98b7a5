"""A cheap fit of ranges to one another, where no truth is known: do they agree on places at all?

In each of some short windows it minimises, over a position p and a velocity v,

    Σ rho((|p + v (t_k - t_0) - a_i| - r_ki) / 0.06 m) + |v|² / (2 m/s)²,   rho = soft L1

For a difference r_b - r_a the distance to a is subtracted. The residual compares one reading of the files with
another. The mirror image of a room fits as well as the room.
"""

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import least_squares

from ortilo_drake.interop.recorded.recording import Ranges
from ortilo_drake.studies.recorded.plain_fit import SPREAD, PlainFit, Reading, counted, left_of, toward
from ortilo_drake.studies.recorded.reacquired import LEAST, SPEED
from ortilo_drake.studies.recorded.truth_path import modelled, random_sample

WINDOWS, MOST = 8, 60  # number of windows, and ranges in each, at most
SPAN, LONGEST = 0.5, 3.0  # duration of a window, and of one with slow ranges until there are enough [s]
ENOUGH = 12  # ranges that are enough
STEPS = 40  # evaluations in a window's fit, at most


def lone_fit(now: Reading, windows: int = WINDOWS) -> PlainFit | None:
    """Return the fit of all windows, or None if fewer than half have enough anchors; offset 0, frame unchanged."""
    anchors, found = now.anchors, []
    for heard in _windows(now.ranges, windows):
        counts = counted(heard, now.without)
        to = np.concatenate([heard.anchor[counts > 0.0], heard.other[(counts > 0.0) & (heard.other >= 0)]])
        if len(np.unique(to)) > LEAST:
            found.append((heard, counts, *_fit(heard, anchors, counts)))
    if len(found) < windows / 2:
        return None
    heards, counts, costs, places, slopes = zip(*found, strict=True)
    heard, p = Ranges(*(np.concatenate(part) for part in zip(*heards, strict=True))), np.concatenate(places)
    use = np.concatenate(counts) > 0.0
    errors = modelled(p, anchors, np.zeros(len(anchors)), heard) - heard.r
    left, cost = left_of(errors[use]), float(sum(costs)) / use.sum()
    J = np.vstack([block_diag(*(part[:-3] for part in slopes)), block_diag(*(part[-3:] for part in slopes))])
    return PlainFit(0.0, np.eye(3), np.zeros(3), left, cost, heard, p, 0.0, J)


def _windows(ranges: Ranges, windows: int) -> list[Ranges]:
    """Return the ranges of `windows` short times, evenly spread."""
    found = []
    for t in np.linspace(ranges.t[0], ranges.t[-1], windows + 2)[1:-1]:
        first = int(np.searchsorted(ranges.t, t))
        within = np.searchsorted(ranges.t, [t + SPAN, t + LONGEST], side="right")
        last = int(np.clip(first + ENOUGH, *within))
        if last > first:
            found.append(ranges.only(random_sample(np.arange(first, last), MOST)))
    return found


def _fit(heard: Ranges, anchors: np.ndarray, counts: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Return cost, places (m, 3) and slopes (m + 3, 6) of the better fit, begun above or below the anchors' middle."""
    after, two, none = (heard.t - heard.t[0])[:, None], heard.other >= 0, np.zeros(len(anchors))

    def residuals(x: np.ndarray) -> np.ndarray:
        e = modelled(x[:3] + after * x[3:], anchors, none, heard) - heard.r
        return np.concatenate([counts * e / SPREAD, x[3:] / SPEED])

    def slopes(x: np.ndarray) -> np.ndarray:
        at = x[:3] + after * x[3:]
        u = toward(at - anchors[heard.anchor])
        u[two] -= toward(at[two] - anchors[heard.other[two]])
        u *= counts[:, None] / SPREAD
        return np.vstack([np.hstack([u, after * u]), np.hstack([np.zeros((3, 3)), np.eye(3) / SPEED])])

    middle = anchors[np.unique(heard.anchor[counts > 0.0])].mean(axis=0)
    starts = [np.array([*middle[:2], middle[2] + dz, 0.0, 0.0, 0.0]) for dz in (-0.5, 0.5)]
    fits = [least_squares(residuals, x, jac=slopes, loss="soft_l1", max_nfev=STEPS) for x in starts]
    best = min(fits, key=lambda fit: fit.cost)
    return float(best.cost), best.x[:3] + after * best.x[3:], slopes(best.x)
