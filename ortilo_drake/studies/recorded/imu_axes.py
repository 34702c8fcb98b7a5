"""Axes of the gyro beside those of the accelerometer: do they carry the truth's motion, and which others would?

Over a short span the body rates give the attitude but for its start R_0, and the specific force turned by it is the
acceleration and gravity's reaction, R_0 Q(t) f(t) = a(t) + g. Both sides are averaged by the same triangle, which of
the truth is its second difference over its half width. R_0 and a factor of f are those that fit a span best (Kabsch),
so how the unit is mounted does not count, nor that some are 6 % wrong. What is left is the RMS of a span, the median of
all. Then each exchange of axes and signs of the rates is tried, and of the force each that mirrors.
"""

from itertools import permutations, product

import numpy as np
from scipy.spatial.transform import Rotation

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.recording import GRAVITY, Imu, Recording
from ortilo_drake.interop.recorded.units import axes_matrix, axes_names
from ortilo_drake.studies.recorded.truth_path import TruthPath, truth_path

SPANS, LASTS, STEP = 40, 4.0, 0.02  # how many, how long, and the steps in them [s]
HALF = 25  # half width of the triangle, in steps
BETTER, FITS = 2.0, 0.5  # other axes are told that leave less by this factor, and no more than this [m/s²]
ALIKE = 1.25  # of those that leave about the least, the ones that change least are told
AXES = [
    np.eye(3)[list(order)] * np.array(s)[:, None]
    for order in permutations(range(3))
    for s in product((1, -1), repeat=3)
]


def misfits(imu: Imu, path: TruthPath, offset: float, of_rates: np.ndarray, of_force: np.ndarray) -> np.ndarray:
    """Return what readings of the axes leave of the truth's acceleration (c) [m/s²]: NaN if they hardly meet.

    Args:
        imu: body rates and force.
        path: the truth, its z up.
        offset: truth's clock less the sensors' [s].
        of_rates: axes tried of the rates (c, 3, 3).
        of_force: and of the force with them (c, 3, 3).
    """
    t, f = imu.accelerometer or (imu.t, imu.force)
    wide = HALF * STEP
    first, last = max(imu.t[0], path.first - offset + wide), min(imu.t[-1], path.last - offset - wide) - LASTS
    if last < first:
        return np.full(len(of_rates), np.nan)
    at = np.linspace(first, last, SPANS)[:, None] + np.arange(0.0, LASTS, STEP)
    rates, force = (
        np.stack([np.interp(at, stamps, axis) for axis in values.T], axis=-1)
        for stamps, values in ((imu.t, imu.rates), (t, f))
    )
    turns = np.einsum("cij,skj->cski", of_rates, rates) * STEP
    force = np.einsum("cij,skj->cski", of_force, force)
    turned, G = Rotation.identity(force[:, :, 0].size // 3), np.empty_like(force)
    for k in range(at.shape[1]):
        G[:, :, k] = turned.apply(force[:, :, k].reshape(-1, 3)).reshape(force[:, :, k].shape)
        turned = turned * Rotation.from_rotvec(turns[:, :, k].reshape(-1, 3))
    triangle = np.append(np.arange(1, HALF + 1), np.arange(HALF - 1, 0, -1)) / HALF**2
    G = np.apply_along_axis(np.convolve, 2, G, triangle, "valid")
    middle = at[:, HALF - 1 : at.shape[1] - HALF + 1] + offset
    a = (path.p(middle + wide) - 2.0 * path.p(middle) + path.p(middle - wide)) / wide**2 + [0.0, 0.0, GRAVITY]
    U, sizes, Vt = np.linalg.svd(np.einsum("ski,cskj->csij", a, G))
    sizes[..., 2] *= np.sign(np.linalg.det(U @ Vt))
    left = np.sum(a**2, axis=(1, 2)) - sizes.sum(axis=2) ** 2 / np.sum(G**2, axis=(2, 3))
    return np.asarray(np.median(np.sqrt(np.maximum(0.0, left) / a.shape[1]), axis=1))


def axes_doubts(recording: Recording, map_: Map, offset: float) -> list[str]:
    """Return a doubt if other axes of the rates, or a mirrored force, carry the truth's motion clearly better."""
    imu, truth, source = recording.imu, recording.truth, map_.imu
    if imu is None or truth is None or source is None or map_.command is not None:
        return []
    others = [D for D in AXES if not np.allclose(D, np.eye(3))]
    mirrors = [D for D in others if np.linalg.det(D) < 0.0]
    same = [np.eye(3)]
    rates, force = np.array(same + others + same * len(mirrors)), np.array(same * (1 + len(others)) + mirrors)
    left = misfits(imu, truth_path(truth), offset, rates, force)
    least = float(left.min())
    if not BETTER * least < left[0] or least > FITS:
        return []
    changed = np.sum(np.abs(rates - np.eye(3)) + np.abs(force - np.eye(3)), axis=(1, 2))
    best = int(np.argmin(np.where(left <= ALIKE * least, changed, np.inf)))
    changes = (rates if best <= len(others) else force)[best]
    key = "rate_axes" if best <= len(others) else "force_axes"
    now = axes_matrix(getattr(source, key) or source.axes, key, mirrors=True)
    return [
        f"imu: body rates and force do not carry the truth's motion ({left[0]:.2g} m/s² RMS is left): imu: {{{key}: "
        f"{axes_names(changes @ now)}}} leaves {left[best]:.2g}"
    ]
