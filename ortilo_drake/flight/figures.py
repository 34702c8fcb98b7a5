"""The scalar figures of a compiled flight, as in flight/metrics.py, computed from a trace of a few numbers a tick."""

import math

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.compiled.inlined import Calling
from ortilo_drake.flight.lost import Bounds, cause_of_loss
from ortilo_drake.loop.element import Box, Element
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.signals import N_XBAR
from ortilo_drake.onboard.ranging.range_equations import inverse, product

# A trace row, one for each tick: the position p_WB, its estimate, e^T P_pp^-1 e, and the reference r.
TRUE, ESTIMATED, NEES, REFERENCE = slice(0, 3), slice(3, 6), 6, slice(7, 10)
TRACE_SIZE = 10
WINDOW = 32  # number of path points on either side of the last nearest one that are searched first
# As in flight.summary.Summary, but for `ticks`, the last tick flown, and `cause`, an index in lost.CAUSES, -1 for none.
FIGURES = (
    "ticks",
    "cause",
    "mse_x",
    "mse_y",
    "mse_z",
    "path_mse",
    "path_distance_mse",
    "max_path_distance",
    "max_reference_distance",
    "nees",
)


@register_jitable(forceinline=True, error_model="numpy")
def position_nees(x: np.ndarray, xhat: np.ndarray, P: np.ndarray) -> float:
    """Return e^T P_pp^-1 e of the position, given P row by row (225); NaN where P_pp is not positive definite."""
    e, n = (xhat[0] - x[0], xhat[1] - x[1], xhat[2] - x[2]), N_XBAR
    definite, C = inverse((P[0], P[1], P[2], P[n + 1], P[n + 2], P[2 * n + 2]))
    if not definite:
        return np.nan
    Ce = product(C, e)
    return e[0] * Ce[0] + e[1] * Ce[1] + e[2] * Ce[2]


@cached_njit
def nees_of_ticks(x: np.ndarray, xhat: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Return position_nees at each tick (n) of a log, given x (n, 12), xhat (n, 15), P row by row (n, 225)."""
    found = np.empty(x.shape[0])
    for k in range(x.shape[0]):
        found[k] = position_nees(x[k], xhat[k], P[k])
    return found


@register_jitable
def squared_distance_to(path: np.ndarray, i: int, p: np.ndarray) -> float:
    """Return the squared distance of p (3) from the i-th point of a path (n, 3) [m^2]."""
    return (path[i, 0] - p[0]) ** 2 + (path[i, 1] - p[1]) ** 2 + (path[i, 2] - p[2]) ** 2


@register_jitable
def nearest_beside(
    path: np.ndarray, longest: float, p: np.ndarray, start: int, direction: int, nearest: int, least: float
) -> tuple[int, float]:
    """Return the index of the point on one side of a path (n, 3) nearest to p (3), and its squared distance [m^2].

    At a point at distance D from p, any point nearer than the best is at least (D - best) / longest points away. So the
    search skips that many points at once and misses none. `longest` is the largest distance between two neighbours on
    the path [m]. The search begins with the point `start` and goes forward (direction 1) or backward (-1). Where no
    point is nearer than the squared distance `least`, the function returns `nearest` and `least`.
    """
    i, best = start, np.sqrt(least)
    while 0 <= i < path.shape[0]:
        squared = squared_distance_to(path, i, p)
        if squared < least:
            nearest, least, best = i, squared, np.sqrt(squared)
        ahead = (np.sqrt(squared) - best) * (1.0 - 1e-9)  # rounding must not skip the nearest
        i += direction * max(1, int(ahead / longest)) if ahead < longest * path.shape[0] else direction * len(path)
    return nearest, least


@cached_njit(nogil=True)
def squared_path_distances(trace: np.ndarray, path: np.ndarray, longest: float) -> np.ndarray:
    """Return the squared distance of each trace row (n, 3 or more) from the nearest point of a path (m, 3) [m^2] (n).

    Consecutive positions are close to each other. So the search looks first at a window of points about the last
    nearest one. All other points are at least `clear` away: their least distance when the window was set, less the way
    moved since. While `clear` exceeds the least distance in the window, none of them is nearer. `longest` is the
    largest distance between two neighbours on the path [m].
    """
    found = np.empty(trace.shape[0])
    low, high, near, clear = 0, 1, 0, 0.0
    last = trace[0, TRUE]
    for k in range(trace.shape[0]):
        p = trace[k, TRUE]
        moved = (p[0] - last[0]) ** 2 + (p[1] - last[1]) ** 2 + (p[2] - last[2]) ** 2
        clear, last, least = clear - np.sqrt(moved), p, np.inf
        for i in range(low, high):
            squared = squared_distance_to(path, i, p)
            if squared < least:
                near, least = i, squared
        if np.sqrt(least) >= clear - 1e-9:  # [m], far more than rounding
            near, least = nearest_beside(path, longest, p, low - 1, -1, near, least)
            near, least = nearest_beside(path, longest, p, high, 1, near, least)
            low, high = max(near - WINDOW, 0), min(near + WINDOW + 1, path.shape[0])
            _, outside = nearest_beside(path, longest, p, low - 1, -1, near, np.inf)
            clear = np.sqrt(nearest_beside(path, longest, p, high, 1, near, outside)[1])
        found[k] = least
    return found


@register_jitable
def distinct(path: np.ndarray) -> np.ndarray:
    """Return the points of a path (n, 3) that differ from the point before them."""
    points, m = path.copy(), 1
    for k in range(1, len(path)):
        if path[k, 0] != path[k - 1, 0] or path[k, 1] != path[k - 1, 1] or path[k, 2] != path[k - 1, 2]:
            put(path[k], points[m])
            m += 1
    return points[:m]


@cached_njit(nogil=True)
def squared_distances_from(path: np.ndarray, trace: np.ndarray) -> np.ndarray:
    """Return squared_path_distances of a trace (n, 3 or more) and a path that may repeat points (m, 3) [m^2] (n)."""
    longest = 1e-12
    for k in range(1, len(path)):
        longest = max(longest, np.sqrt(squared_distance_to(path, k, path[k - 1])))
    return squared_path_distances(trace, distinct(path), longest)  # a path that waits at its goal repeats the point


@cached_njit
def path_mse(trace: np.ndarray, path: np.ndarray) -> float:
    """Return metrics.path_mse [m^2] of a trace and its path (n, 3); NaN where the path does not run forward in x."""
    n, m = trace.shape[0], 1
    x, y = np.empty(n), np.empty(n)
    x[0], y[0] = path[0, 0], path[0, 1]
    for k in range(1, n):
        if path[k, 0] - path[k - 1, 0] < -1e-9:
            return np.nan
        if path[k, 0] > path[k - 1, 0]:
            x[m], y[m] = path[k, 0], path[k, 1]
            m += 1
    if m < 2:
        return np.nan
    total, i = 0.0, 0  # i is the segment of the path; the search starts from the segment of the tick before
    for k in range(n):
        p = trace[k, 0]
        while i < m - 2 and x[i + 1] <= p:
            i += 1
        while i > 0 and x[i] > p:
            i -= 1
        share = min(max((p - x[i]) / (x[i + 1] - x[i]), 0.0), 1.0)
        total += (trace[k, 1] - (y[i] + share * (y[i + 1] - y[i]))) ** 2
    return total / n


@register_jitable
def is_finite(row: np.ndarray, size: int) -> bool:
    """Return whether the first `size` numbers of a row are finite."""
    total = 0.0
    for i in range(size):
        total += row[i]
    return math.isfinite(total)


@cached_njit(nogil=True, pipeline_class=Calling)
def figures_of(trace: np.ndarray, path: np.ndarray, out: np.ndarray) -> None:
    """Write the errors of a flight, all FIGURES but the first two, to `out` (10).

    The trace (n, TRACE_SIZE or more) has a row for each tick flown, which begins as described above; its r is not read.
    The path (n, 3) is r at those ticks. Ticks from the first one that is not finite on are left out.
    """
    n = 0
    while n < trace.shape[0] and is_finite(trace[n], 6):
        n += 1
    fill(out[2:], np.nan)
    if n == 0:
        return
    trace, path = trace[:n], path[:n]
    fill(out[2:], 0.0)
    out[5] = path_mse(trace, path)
    squared = squared_distances_from(path, trace)
    for k in range(n):
        p = trace[k, TRUE]
        for i in range(3):
            out[2 + i] += (trace[k, 3 + i] - p[i]) ** 2 / n
        out[6] += squared[k] / n
        out[7] = max(out[7], np.sqrt(squared[k]))
        out[8] = max(out[8], np.sqrt(squared_distance_to(path, k, p)))
        out[9] += trace[k, NEES] / n


_R = REFERENCE.start


def figures_out(
    state: np.ndarray,
    belief: np.ndarray,
    reference: np.ndarray,
    bounds: Bounds,
    out: np.ndarray,
) -> None:
    """Write a trace row and the cause of the flight's loss, an index in lost.CAUSES, to `out` (11)."""
    for i in range(3):
        out[i], out[3 + i], out[_R + i] = state[i], belief[i], reference[i]
    out[NEES] = position_nees(state, belief, belief[N_XBAR:])
    out[TRACE_SIZE] = cause_of_loss(state, bounds)


OF_A_TICK = Element("figures", out=figures_out)


def figures_box(bounds: Bounds) -> Box:
    """Return the box of a flight's figures; the box reads the true state (12), the belief (240) and the reference."""
    return Box("figures", OF_A_TICK, TRACE_SIZE + 1).with_groups(bounds=bounds)
