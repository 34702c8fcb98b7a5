"""The anchors' positions from ranges: an adjustment of the network on three known anchors.

Unknown are the other anchors a_i and the vehicle's places p_k; measured are ranges from places to anchors and between
anchors, and perhaps the places. With independent normal errors the likelihood is greatest where

    sum_ki ((|p_k - a_i| - r_ki) / s_ki)^2 + sum_ij ((|a_i - a_j| - r_ij) / s_ij)^2 + sum_k |p_k - p_k0|^2 / s_k^2

is least (a bundle adjustment: Triggs, McLauchlan, Hartley and Fitzgibbon, "Bundle adjustment - a modern synthesis",
2000; of ultra-wideband anchors: Hamer and D'Andrea, "Self-calibrating ultra-wideband network supporting multi-robot
localization", IEEE Access 6, 2018). The fit is repeated at least once: a range's standard deviation is s_0 + s_1 d,
with d from the fit before. A robust loss replaces the square (scipy.optimize.least_squares). With N = J^T J, J the
Jacobian of the weighted residuals,

    cov(a) = (N^-1)_aa = (N_aa - N_ap N_pp^-1 N_pa)^-1.

Distances cannot tell the network from its mirror image in the plane of three known anchors: of the best fit and its
image, the one nearer to the assumed anchors is taken. The search starts from the assumed anchors and, if ranges between
anchors connect them all, from both images that these give; the best fit counts. Places in one plane, as of a flight at
constant height, cannot tell on which side of it each anchor stands: that takes ranges between anchors (better_sides).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import OptimizeResult, least_squares
from scipy.special import chdtri

from ortilo_drake.model.input_error import InputError
from ortilo_drake.studies.room_design.network import FLAT, Network, Ranges, better_sides, mirror_images, plane_of

FEWEST = 4  # least ranges of a place whose position is unknown; with fewer it tells nothing about the anchors
SAME = 1e-3  # relative difference of costs up to which two fits count as mirror images
DENSE = 60  # most places with which the Jacobian is dense
START_STEPS = 30
MOST_FITS = 6


@dataclass(frozen=True)
class Survey:
    """The surveyed anchors p_W (n, 3) [m], and how they were found.

    covariance (3 n, 3 n) [m^2] is that of their coordinates, row by row, 0 for known anchors. places (k, 3) [m] are the
    vehicle's p_W. `ranges` is the number of ranges, cost the least cost. chi2 is the sum of the squared weighted
    residuals; its mean is freedom, the number of residuals less that of unknowns.
    """

    anchors: np.ndarray
    covariance: np.ndarray
    places: np.ndarray
    ranges: int
    cost: float
    chi2: float
    freedom: int

    @property
    def sd(self) -> np.ndarray:
        """Standard deviations of the anchors' coordinates (n, 3) [m]."""
        return np.sqrt(np.diagonal(self.covariance)).reshape(-1, 3)


def survey(
    ranges: Ranges, believed: np.ndarray, known: Sequence[int], noise: tuple[float, float], loss: str = "linear"
) -> Survey:
    """Return the anchors that fit the ranges best, by a loss of scipy.optimize.least_squares.

    `believed` (n, 3) [m] are the assumed p_W of the anchors; `known` are the indices of those that are exactly there:
    three or more, not on one line. noise is s_0 [m] and s_1 of a range's standard deviation s_0 + s_1 d. InputError if
    the known anchors are too few or on one line, or if an anchor cannot be found.
    """
    refuse_known(believed, known)
    ranges = _useful(ranges)
    _refuse_unheard(ranges, len(believed), known)
    images = mirror_images(ranges.between, ranges.between_distance, believed, known)
    fits = [_fitted(ranges, start, known, noise, loss) for start in [believed, *images]]
    least = min(fit.cost for fit in fits)
    same = [fit for fit in fits if fit.cost <= least * (1.0 + SAME) + 1e-9]
    if not np.isfinite(ranges.p_sd).any():
        same += [mirrored(fit, believed[list(known)]) for fit in same]
    return min(same, key=lambda fit: float(np.linalg.norm(fit.anchors - believed)))


def mirrored(found: Survey, plane: np.ndarray) -> Survey:
    """Return a survey's mirror image in the plane of three points; the survey itself for more points (n, 3)."""
    if len(plane) > 3:
        return found
    normal = np.cross(plane[1] - plane[0], plane[2] - plane[0])
    normal /= np.linalg.norm(normal)
    M = np.eye(3) - 2.0 * np.outer(normal, normal)
    whole = np.kron(np.eye(len(found.anchors)), M)
    return replace(
        found,
        anchors=(found.anchors - plane[0]) @ M + plane[0],
        places=(found.places - plane[0]) @ M + plane[0],
        covariance=whole @ found.covariance @ whole,
    )


def doubts(found: Survey, ranges: Ranges) -> list[str]:
    """Return a line for each reason not to trust a survey of these ranges."""
    lines = []
    if found.freedom > 0:
        low, high = chdtri(found.freedom, [0.9995, 0.0005])
        if found.chi2 > high:
            lines.append("the ranges disagree by more than their noise: outliers, biases, or noise that is set too low")
        if found.chi2 < low:
            lines.append("the ranges agree better than their noise allows: it is set too high, and so are the sd")
    if len(found.places) > 2 and not len(ranges.between):
        flat, _, _ = plane_of(found.places)
        if flat < FLAT:
            lines.append(
                f"the places lie within {flat:.2f} m (RMS) of a plane: on which side of it an anchor stands is a "
                "guess; ranges between anchors settle it"
            )
    return lines


def refuse_known(believed: np.ndarray, known: Sequence[int]) -> None:
    """Raise InputError if the known anchors are fewer than three, not among the room's (n, 3), or on one line."""
    shown = ", ".join(map(str, known))
    if len(set(known)) < 3 or len(set(known)) != len(known):
        raise InputError(f"known: {shown}: must be three different anchors or more")
    if not all(0 <= i < len(believed) for i in known):
        raise InputError(f"known: {shown}: must be numbers of anchors, 0 to {len(believed) - 1}")
    spread = np.linalg.svd(believed[list(known)] - believed[list(known)].mean(axis=0), compute_uv=False)
    if spread[1] < 0.1:
        raise InputError(f"known: {shown}: must not be on one line, are within {spread[1]:.2g} m of one")


def _useful(ranges: Ranges) -> Ranges:
    """Return the ranges without the places whose ranges tell nothing about the anchors."""
    enough = (np.bincount(ranges.place, minlength=len(ranges.p)) >= FEWEST) | np.isfinite(ranges.p_sd)
    number, use = np.cumsum(enough) - 1, enough[ranges.place]
    return ranges._replace(
        place=number[ranges.place[use]],
        anchor=ranges.anchor[use],
        distance=ranges.distance[use],
        p=ranges.p[enough],
        p_sd=ranges.p_sd[enough],
    )


def _refuse_unheard(ranges: Ranges, n: int, known: Sequence[int]) -> None:
    count = np.bincount(ranges.anchor, minlength=n) + np.bincount(ranges.between.ravel(), minlength=n)
    for i in range(n):
        if i not in known and count[i] < 3:
            raise InputError(f"anchor {i}: {count[i]} usable ranges: must be at least 3 for it to be found")


def start_places(ranges: Ranges, anchors: np.ndarray) -> np.ndarray:
    """Return the first places (k, 3) [m]: the assumed ones, or else where the ranges to the anchors meet.

    The latter come from damped Gauss-Newton steps from below the mean of the anchors heard, for all places together.
    """
    k, known = len(ranges.p), np.isfinite(ranges.p).all(axis=1)
    count = np.maximum(np.bincount(ranges.place, minlength=k), 1)
    heard = anchors[ranges.anchor]
    mean = np.column_stack([np.bincount(ranges.place, heard[:, axis], k) / count for axis in range(3)])
    p = np.where(known[:, None], ranges.p, mean - [0.0, 0.0, 1.0])
    for _ in range(START_STEPS):
        to = p[ranges.place] - heard
        d = np.maximum(np.linalg.norm(to, axis=1), 1e-6)
        u = to / d[:, None]
        N, g = np.tile(1e-3 * np.eye(3), (k, 1, 1)), np.zeros((k, 3))
        np.add.at(N, ranges.place, u[:, :, None] * u[:, None, :])
        np.add.at(g, ranges.place, u * (ranges.distance - d)[:, None])
        p = np.where(known[:, None], p, p + np.linalg.solve(N, g[:, :, None])[:, :, 0])
    return np.asarray(p)


def _descent(network: Network, x: np.ndarray, sd: np.ndarray, loss: str) -> OptimizeResult:
    """Return the fit that a descent from x reaches."""
    dense = len(network.ranges.p) <= DENSE
    jacobian = (lambda x, sd: network.jacobian(x, sd).toarray()) if dense else network.jacobian
    solver, tolerance = "exact" if dense else "lsmr", {"xtol": 1e-10, "ftol": 1e-10, "max_nfev": 200}
    return least_squares(network.residuals, x, jacobian, args=(sd,), loss=loss, tr_solver=solver, **tolerance)


def _fitted(ranges: Ranges, start: np.ndarray, known: Sequence[int], noise: tuple[float, float], loss: str) -> Survey:
    n, free = len(start), [i for i in range(len(start)) if i not in known]
    network = Network(ranges, start, free)
    x = np.concatenate([start[free].ravel(), start_places(ranges, start).ravel()])
    d, fitted = np.concatenate([ranges.distance, ranges.between_distance]), False
    first = "linear" if loss == "linear" else "soft_l1"  # a redescending loss needs a good start
    for kind in (first, *[loss] * MOST_FITS):
        sd = np.maximum(noise[0] + noise[1] * d, 1e-6)
        found = _descent(network, x, sd, kind)
        cost, d = 2.0 * float(found.cost), np.linalg.norm(network.lines(found.x), axis=1)
        x, changed = better_sides(network, found.x, sd, kind)
        if not changed and fitted:
            break
        fitted = True
    if changed:  # from the last better sides no descent has begun yet
        found = _descent(network, x, sd, loss)
        cost, d = 2.0 * float(found.cost), np.linalg.norm(network.lines(found.x), axis=1)
    x = found.x
    sd = np.maximum(noise[0] + noise[1] * d, 1e-6)
    anchors, places = network.unpacked(x)
    covariance, of_free = np.zeros((3 * n, 3 * n)), (3 * np.array(free)[:, None] + np.arange(3)).ravel()
    if free:
        covariance[np.ix_(of_free, of_free)] = network.covariance(x, sd)
    e = network.residuals(x, sd)
    return Survey(anchors, covariance, places, len(d), cost, float(e @ e), len(e) - len(x))
