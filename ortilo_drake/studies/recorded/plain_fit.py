"""A cheap fit of ranges to a truth: frame, clock and one bias for all ranges, so that a wrong map cannot hide.

The full calibration has a bias for each anchor, which absorbs the effect of a wrong unit, axis or anchor. This one
minimises

    Σ rho((|F (p(t_k + d) + R l) + s - a_i| + c - r_ki) / 0.06 m) + |l|² / (0.1 m)²,   rho = soft L1

over the heading or the whole turn F, the shift s, one bias c, the lever l where the truth has an attitude, and the
clock's offset d where it is not held. For a difference r_b - r_a the distance to a is subtracted, and c cancels. The
residual compares one reading of the files with another.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from ortilo_drake.interop.recorded.recording import ONE_TAG, Ranges, Truth
from ortilo_drake.studies.recorded.truth_path import (
    LEAST,
    TruthPath,
    antennas,
    covered_ranges,
    far_away,
    modelled,
    random_sample,
)

SPREAD, LEVER, CLOCK = 0.06, 0.1, 7  # deviations of a range and of the lever [m]; the clock's column in `slopes`
FEW = 160  # ranges used in a fit
KEPT = 0.95  # share of the errors that counts, smallest first: the rest may be outliers
YAWS = (0.0, np.pi / 2, np.pi, -np.pi / 2)
TURNED = {"same": 0, "yaw": 1, "se3": 3}  # number of free components of the turn vector, the last ones
MOST, SCREEN, BEST = 40, 6, 2  # evaluations of a fit, of a start's first trial, and number of starts that go on
FLAT, NUDGE = 0.3, 0.7  # if anchors are less than this off a plane [m], a fit starts so far above the plane [m]


class Reading(NamedTuple):
    """One reading of the files, and the map's key and value that set it.

    offsets: clock offsets to start from [s], None for the trial's; near: whether the frame already found may serve as
    the start; without: index of an anchor whose ranges do not count, -1 if all count.
    """

    key: str
    ranges: Ranges
    anchors: np.ndarray
    truth: Truth | None
    frame: str
    offsets: np.ndarray | None = None
    near: bool = False
    tags: np.ndarray = ONE_TAG
    without: int = -1


class PlainFit(NamedTuple):
    """The fitted offset [s], turn F (3, 3) and shift s (3), RMS range error without the largest 5 % [m], and cost.

    heard: the ranges used (m); places: the antenna's place at each range, in the anchors' frame (m, 3); bias [m];
    slopes (m + q, k): derivatives by k unknowns of the m errors over SPREAD, and of q residuals of prior knowledge.
    """

    offset: float
    F: np.ndarray
    shift: np.ndarray
    left: float
    cost: float
    heard: Ranges
    places: np.ndarray
    bias: float
    slopes: np.ndarray


class _Seen(NamedTuple):
    """For each range at a clock offset: place, velocity and attitude of the truth, the range, and whether it counts."""

    offset: float
    p: np.ndarray
    v: np.ndarray
    R: np.ndarray | None
    heard: Ranges
    counts: np.ndarray


def plain_fit(
    now: Reading,
    path: TruthPath,
    offsets: np.ndarray,
    *,
    moves: bool = False,
    near: PlainFit | None = None,
    few: int = FEW,
) -> PlainFit | None:
    """Return the best fit from several starts, or None if truth and ranges hardly overlap in time.

    Args:
        now: the reading to fit.
        path: its truth.
        offsets: clock offsets to start from [s].
        moves: whether the offset is fitted too.
        near: a fit whose frame is the start, in place of four headings.
        few: ranges used, at most.
    """
    ranges, anchors, starts = now.ranges, now.anchors, []
    flat = float(np.linalg.svd(anchors - anchors.mean(axis=0))[1][-1]) < FLAT * np.sqrt(len(anchors))
    for offset in offsets:
        chosen = random_sample(covered_ranges(ranges, float(offset), path), few)
        if len(chosen) < LEAST:
            continue
        t = np.clip(ranges.t[chosen] + offset, path.first, path.last)
        p, R = path.at(t)
        p = antennas(p, R, np.zeros(3), now.tags, ranges.tag[chosen])
        heard = ranges.only(chosen)
        counts = counted(heard, now.without)
        middle = anchors[np.unique(heard.anchor[counts > 0.0])].mean(axis=0)
        seen = _Seen(float(offset), p, path.p(t, 1), R, heard, counts)
        if near is not None:
            starts.append((seen, near.F, near.shift))
            continue
        for yaw in YAWS if now.frame != "same" else (0.0,):
            F = Rotation.from_rotvec([0.0, 0.0, yaw]).as_matrix()
            shift = middle - F @ p.mean(axis=0) + [0.0, 0.0, NUDGE if flat else 0.0]
            starts.append((seen, F, np.zeros(3) if now.frame == "same" else shift))
    if len(starts) > BEST:
        costs = [_fit(*start, now, moves, SCREEN).cost for start in starts]
        starts = [starts[k] for k in np.argsort(costs)[:BEST]]
    return min((_fit(*start, now, moves, MOST) for start in starts), key=lambda fit: fit.cost, default=None)


def counted(heard: Ranges, without: int) -> np.ndarray:
    """Return 0 for each range to the anchor `without`, which is left out, else 1 (n)."""
    return ((heard.anchor != without) & ((heard.other != without) | (heard.other < 0))).astype(float)


def left_of(errors: np.ndarray, kept: float = KEPT) -> float:
    """Return the RMS of a share `kept` of the errors [m]: the largest ones are left out."""
    return float(np.sqrt(np.mean(np.sort(np.abs(errors))[: max(1, int(kept * len(errors)))] ** 2)))


def _fit(seen: _Seen, F0: np.ndarray, shift: np.ndarray, now: Reading, moves: bool, most: int) -> PlainFit:
    """Return the fit from one start; its unknowns are shift (3), bias, lever (3), offset, and the free turn.

    Places far from 0, as in UTM, count from their middle.
    """
    anchors, frame = now.anchors, now.frame
    middle = seen.p.mean(axis=0) if far_away(seen.p) and frame != "same" else np.zeros(3)
    seen, shift = seen._replace(p=seen.p - middle), shift + F0 @ middle
    heard, counts = seen.heard, seen.counts
    m, free, two = len(heard.r), TURNED[frame], heard.other >= 0
    a, of = anchors[heard.anchor], anchors[heard.other[two]]
    stiff = np.array([1.0 / LEVER] * 3 + [1.0 if moves else 1e6])

    def placed(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return F, and the antenna's places in the truth's frame (m, 3)."""
        F = _turn(_of_last(x[8:])) @ F0 if free else F0
        q = seen.p + x[7] * seen.v
        return F, q if seen.R is None else q + seen.R @ x[4:7]

    def errors(x: np.ndarray) -> np.ndarray:
        F, q = placed(x)
        return modelled(q @ F.T + x[:3], anchors, np.full(len(anchors), x[3]), heard) - heard.r

    def residuals(x: np.ndarray) -> np.ndarray:
        return np.concatenate([counts * errors(x) / SPREAD, x[4:8] * stiff])

    def slopes(x: np.ndarray) -> np.ndarray:
        F, q = placed(x)
        at = q @ F.T + x[:3]
        u = toward(at - a)
        u[two] -= toward(at[two] - of)
        J = np.zeros((m + 4, 8 + free))
        J[:m, :3] = 0.0 if frame == "same" else u
        J[:m, 3] = ~two
        if seen.R is not None:
            J[:m, 4:7] = np.einsum("ki,kij->kj", u @ F, seen.R)
        J[:m, 7] = np.einsum("ki,ki->k", u @ F, seen.v)
        if free:  # u . (w x Fq) = w . (Fq x u)
            around = np.cross(q @ F.T, u) @ _left_jacobian(_of_last(x[8:]))
            J[:m, 8:] = around[:, 3 - free :]
        J[:m] *= counts[:, None] / SPREAD
        J[m:, 4:8] = np.diag(stiff)
        return J

    start = np.concatenate([shift, np.zeros(5 + free)])
    x = least_squares(residuals, start, jac=slopes, loss="soft_l1", x_scale="jac", max_nfev=most)
    F, q = placed(x.x)
    left = left_of(errors(x.x)[counts > 0.0])
    cost = float(x.cost) / max(1.0, counts.sum())
    places, shift = q @ F.T + x.x[:3], x.x[:3] - F @ middle
    offset = seen.offset + float(x.x[7])
    return PlainFit(offset, F, shift, left, cost, heard, places, float(x.x[3]), slopes(x.x))


def toward(d: np.ndarray) -> np.ndarray:
    """Return the unit vectors along vectors (n, 3)."""
    return np.asarray(d / np.maximum(np.linalg.norm(d, axis=1), 1e-9)[:, None])


def _of_last(a: np.ndarray) -> np.ndarray:
    """Return the vector (3) whose last components are `a`; the others are 0."""
    whole = np.zeros(3)
    whole[3 - len(a) :] = a
    return whole


def _cross(a: np.ndarray) -> np.ndarray:
    """Return the matrix K with K b = a x b."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def _turn(a: np.ndarray) -> np.ndarray:
    """Return exp([a]x) (3, 3) by Rodrigues' formula; SciPy takes five times as long for one vector."""
    angle, K = float(np.linalg.norm(a)), _cross(a)
    half = np.sinc(angle / 2.0 / np.pi)  # 2 sin(angle / 2) / angle
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * K + 0.5 * half**2 * (K @ K))


def _left_jacobian(a: np.ndarray) -> np.ndarray:
    """Return J with exp(a + da) = exp(J da) exp(a), to first order (Solà, arXiv 1711.02508, equation 183)."""
    angle = float(np.linalg.norm(a))
    K = _cross(a)
    if angle < 1e-6:
        return np.eye(3) + K / 2.0
    return np.asarray(np.eye(3) + (1 - np.cos(angle)) / angle**2 * K + (angle - np.sin(angle)) / angle**3 * (K @ K))
