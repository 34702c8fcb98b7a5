"""Doubts about an IMU: its force against gravity, its rates against the force, both against the truth's motion.

Over a short span the body rates give the attitude R_0 Q(t), except for its start R_0. The specific force turned by it
is acceleration plus gravity's reaction, R_0 Q(t) f(t) = a(t) + g. Both sides are averaged by the same triangle; for the
truth this is a second difference over the triangle's half width. The best R_0 and factor of f are fitted to each span
(Kabsch), so neither the unit's mounting nor a force 6 % wrong counts. The misfit is the RMS residual of a span, and the
median over all spans. Each exchange of axes and signs is tried for the rates, each mirroring one for the force.
"""

from itertools import permutations, product

import numpy as np
from scipy.spatial.transform import Rotation

from ortilo_drake.interop.recorded.map_file import Map, unit_key
from ortilo_drake.interop.recorded.recording import GRAVITY, Imu, Recording, Truth
from ortilo_drake.interop.recorded.sources import Quaternion
from ortilo_drake.interop.recorded.units import FORCE_UNITS, RATE_UNITS, axes_matrix, axes_names, in_axes, size_of
from ortilo_drake.studies.recorded.clock_offset import TELLS, ByRates, best_by_rates, gains_by_rates
from ortilo_drake.studies.recorded.freed import DRIFT
from ortilo_drake.studies.recorded.truth_path import TruthPath, interpolated, truth_path

OFF = 1.5  # largest difference of the force at rest from gravity; some units are 6 % wrong [m/s²]
TELLING = 0.1  # a unit is told if it brings the force this near to gravity, as a share
VARIES = 0.7  # gravity is missing if the force's 10 % and 90 % quantiles differ by a larger share of the median
FAST = 10.0  # body rates of this RMS look like degrees [rad/s]
SPAN = 1.0  # over this time the force keeps its direction in the world [s]
LOSES = 0.05  # share of the force that its mean over a span loses if it is turned wrongly
SPANS = 40  # spans tried
AROUND = 0.3  # clock offsets are tried this far around the one found [s]
SURE = 0.02  # largest share of the turns that a reading may leave: right readings of real motions leave 0.3 %
BETTER = 4.0  # another reading of the attitude must leave less of the turns by this factor
STANDS = 1e-6  # an attitude that turns by no more was never measured [rad]
TURNED = np.radians(20.0)  # a body that turned by less tells nothing about its attitude
OTHER = 1.2  # rates that are larger or smaller by this factor have another unit
NAMED = 0.03  # a unit of rates is called by its name if it is this near, as a share
WINDOWS, LASTS, FINE = 40, 4.0, 0.02  # number of spans of `misfits`, their duration and their step [s]
HALF = 25  # half width of the triangle, in steps
CLEARER, CARRIES = 2.0, 0.5  # other axes must leave less by this factor, and at most this [m/s²]
ALIKE = 1.25  # of the axes that leave at most this factor of the least, those that change least are told
AXES = [
    np.eye(3)[list(order)] * np.array(s)[:, None]
    for order in permutations(range(3))
    for s in product((1, -1), repeat=3)
]


def force_doubts(imu: Imu, map_: Map) -> list[str]:
    """Return doubts about the specific force: at rest it should be gravity's reaction, 9.81 m/s²."""
    size = np.linalg.norm(imu.force, axis=1)
    whole, first = float(np.median(size)), float(np.median(size[imu.t <= imu.t[0] + 1.0]))
    rest = min((whole, first), key=lambda one: abs(one - GRAVITY))
    if abs(rest - GRAVITY) <= OFF:
        return []
    said = f"imu: the force at rest is {rest:.3g} m/s², not {GRAVITY:g}"
    if map_.command is not None:
        return [f"{said}: command: {{scale: {map_.command.scale * GRAVITY / rest:.4g}}} makes it so"]
    assert map_.imu is not None
    if rest == 0.0:
        return ["imu: its force is 0: it was not measured, or `imu: force` names other columns"]
    if abs(float(np.median(np.linalg.norm(imu.rates, axis=1))) - GRAVITY) < OFF:
        return [f"{said}, but the body rates are: the columns of `rates` and `force` change places?"]
    in_file = rest / abs(size_of(map_.imu.force_unit, FORCE_UNITS))
    unit = min(FORCE_UNITS, key=lambda one: abs(in_file * FORCE_UNITS[one] - GRAVITY))
    there = in_file * FORCE_UNITS[unit]
    low, high = np.quantile(size, [0.1, 0.9])
    if high - low > VARIES * whole:
        return [f"{said}: gravity was taken out of it? The filter needs it: log the accelerometer as it is"]
    if abs(there - GRAVITY) < TELLING * GRAVITY and unit != map_.imu.force_unit:
        return [f"{said}: imu: {{force_unit: {unit}}} makes it {there:.2f}"]
    made = f"imu: {{force_unit: {GRAVITY / in_file:.4g}}} makes it {GRAVITY:g}"
    return [f"{said}: {made}, if `imu: force` names the right columns"]


def is_gravity(imu: Imu) -> bool:
    """Return whether the force's median size may be gravity, also for a vehicle that already flies."""
    return 0.5 < float(np.median(np.linalg.norm(imu.force, axis=1))) / GRAVITY < 2.0


def rate_doubts(imu: Imu, map_: Map) -> list[str]:
    """Return a doubt if the body rates look like rates of a smaller unit, by the force alone.

    This is for a truth without attitude. The doubt names the largest unit with which the force keeps its direction.
    """
    assert map_.imu is not None
    now = size_of(map_.imu.rate_unit, RATE_UNITS)
    smaller = sorted((unit for unit in RATE_UNITS if RATE_UNITS[unit] < abs(now) / OTHER), key=lambda u: -RATE_UNITS[u])
    fast = float(np.sqrt(np.mean(np.sum(imu.rates**2, axis=1))))
    said, kept = f"imu: the body rates look like another unit's (RMS {fast:.3g} rad/s)", force_kept(imu, 1.0)
    for unit in smaller:
        then = force_kept(imu, RATE_UNITS[unit] / abs(now))
        if 1.0 - kept > max(LOSES, BETTER * (1.0 - then)) and fast * RATE_UNITS[unit] / abs(now) < FAST:
            return [
                f"{said}: turned by them the force keeps {kept:.0%} of its size over {SPAN:g} s, with imu: "
                f"{{rate_unit: {unit}}} {then:.0%}"
            ]
    slow = next((unit for unit in smaller if fast * RATE_UNITS[unit] / abs(now) < FAST), None)
    return [f"{said}: imu: {{rate_unit: {slow}}}?"] if fast > FAST and slow is not None else []


def force_kept(imu: Imu, by: float) -> float:
    """Return |mean force| / mean |force|, with the force turned back by the rates times `by`: a mean over spans.

    A span lasts a second. The ratio is 1 if the rates turn the body rightly and it hardly accelerates.
    """
    h = float(np.median(np.diff(imu.t)))
    n = max(2, round(SPAN / h))
    starts = np.unique(np.linspace(0, max(0, len(imu.t) - n - 1), SPANS).astype(int))
    at = starts[:, None] + np.arange(min(n, len(imu.t)))
    turned, total = Rotation.identity(len(starts)), np.zeros((len(starts), 3))
    for k in at.T:
        total += turned.apply(imu.force[k])
        turned = turned * Rotation.from_rotvec(imu.rates[k] * h * by)
    sizes = np.linalg.norm(imu.force, axis=1)[at].sum(axis=1)
    return float(np.mean(np.linalg.norm(total, axis=1) / np.maximum(sizes, 1e-9)))


def attitude_doubts(recording: Recording, map_: Map, offset: float, up: np.ndarray | None) -> list[str]:
    """Return a doubt if the truth's attitude does not turn as the body rates do, with the keys that would mend it.

    offset: the truth's clock less the sensors', each from its own first stamp [s]; up: the anchors' z in the truth's
    frame (3), None if the ranges do not tell it.
    """
    truth, imu = recording.truth, recording.imu
    assert imu is not None
    assert map_.imu is not None
    if truth is None or truth.R is None or map_.truth is None or map_.truth.rotation is None:
        return rate_doubts(imu, map_)
    R = Rotation.from_matrix(truth.R)
    turned = float((R[0].inv() * R).magnitude().max())
    if turned < TURNED:
        swept = np.cumsum(imu.rates[1:] * np.diff(imu.t)[:, None], axis=0)
        if turned < STANDS and np.ptp(swept, axis=0).max() > TURNED:
            return ["truth: its attitude never changes though the body rates turn: leave `truth: rotation` out"]
        return rate_doubts(imu, map_)
    rotation = map_.truth.rotation
    orders = ("xyzw", "wxyz") if isinstance(rotation, Quaternion) else (None,)
    found: dict[str, float] = {}
    now = np.inf
    signs = (1.0, -1.0) if force_kept(imu, -1.0) > force_kept(imu, 1.0) else (1.0,)  # all three may be turned
    for sign, of, order in product(signs, ("body", "world"), orders):
        keys = [f"order: {order}"] * (order != getattr(rotation, "order", None)) + [f"of: {of}"] * (of != rotation.of)
        said = [f"truth: {{rotation: {{{', '.join(keys)}}}}}"] if keys else []
        read = truth._replace(R=_read_as(truth.R, map_, of, order))
        turning = best_by_rates(
            imu._replace(rates=sign * imu.rates), read, lambda _: (-np.inf, np.inf), AROUND, None, (offset,), True
        )
        off = _off_up(imu, read, turning, up)
        if not said and sign > 0.0:
            now = turning.left + off
        if sign < 0.0 or not 1.0 / OTHER < turning.scale < OTHER:
            said.append(f"imu: {{rate_unit: {_unit_of(map_.imu.rate_unit, sign * turning.scale)}}}")
        found[", ".join(said)] = turning.scaled + off
    better = [
        key for key, left in found.items() if key and left * BETTER <= now and left < SURE and now > TELLS / BETTER
    ]
    if better:
        least = min(found[key] for key in better)
        key = min(better, key=lambda one: (found[one] > 1.5 * least, "rate_unit: -" in one, one.count(":")))
        return [f"{_says(now)}: {key} leaves {found[key]:.1%}"]
    if now < TELLS:
        return []
    return [f"{_says(now)}: other axes, one sign of them, another body, or a clock beyond `search`?"]


def drift_doubts(recording: Recording, map_: Map, offset: float) -> list[str]:
    """Return a doubt if the imu's clock drifts against the truth's clock, by the turns of both."""
    gains = gains_by_rates(recording.imu, recording.truth, offset)
    if gains is None or abs(gains) < DRIFT:
        return []
    return [f"imu: the truth's clock gains {gains:.2%} on it, not on the ranges': {unit_key(map_, 1.0 + gains)}"]


def _unit_of(unit: str | float, by: float) -> str:
    """Return the unit of body rates `by` times as large as `unit`: its name if it has one, else its size [rad/s]."""
    size = size_of(unit, RATE_UNITS) * by
    named = min(RATE_UNITS, key=lambda one: abs(size / RATE_UNITS[one] - 1.0))
    return named if abs(size / RATE_UNITS[named] - 1.0) < NAMED else f"{size:.4g}"


def _says(left: float) -> str:
    share = f"{left:.0%}" if left < 10.0 else f"{left:.0f} times as much" if np.isfinite(left) else "all"
    return f"truth: its attitude does not turn as the body rates and the force say ({share} is left)"


def _read_as(R: np.ndarray, map_: Map, of: str, order: str | None) -> np.ndarray:
    """Return the attitudes (n, 3, 3) that the file's numbers give with another `of` and order."""
    assert map_.truth is not None
    rotation = map_.truth.rotation
    assert rotation is not None
    A = axes_matrix(map_.truth.axes, "truth.axes", mirrors=True)
    in_file = in_axes(R, A.T)
    in_file = in_file if rotation.of == "body" else in_file.transpose(0, 2, 1)
    if isinstance(rotation, Quaternion) and order is not None:
        q = Rotation.from_matrix(in_file).as_quat()
        columns = q if rotation.order == "xyzw" else q[:, [3, 0, 1, 2]]
        in_file = Rotation.from_quat(columns if order == "xyzw" else columns[:, [1, 2, 3, 0]]).as_matrix()
    return in_axes(in_file if of == "body" else in_file.transpose(0, 2, 1), A)


def _off_up(imu: Imu, truth: Truth, turning: ByRates, up: np.ndarray | None) -> float:
    """Return how far the mean force points away from up (3): 0 along it, 1 opposite; 0 if up is not known."""
    if up is None or not np.isfinite(turning.left):
        return 0.0
    assert truth.R is not None
    then = np.clip(truth.t - turning.offset, imu.t[0], imu.t[-1])
    force = interpolated(then, imu.t, imu.force)
    up_T = np.mean(np.einsum("kij,jl,kl->ki", truth.R, turning.mount, force), axis=0)
    size = float(np.mean(np.linalg.norm(force, axis=1)))
    return 0.5 * (1.0 - float(up_T @ up) / max(size, 1e-9))


def misfits(imu: Imu, path: TruthPath, offset: float, of_rates: np.ndarray, of_force: np.ndarray) -> np.ndarray:
    """Return the misfit of each reading of the axes to the truth's acceleration (c) [m/s²]; NaN if they hardly overlap.

    Args:
        imu: body rates and force.
        path: the truth, its z up.
        offset: truth's clock less the sensors' [s].
        of_rates: axes tried for the rates (c, 3, 3).
        of_force: axes tried for the force, with those of the rates (c, 3, 3).
    """
    t, f = imu.accelerometer or (imu.t, imu.force)
    wide = HALF * FINE
    first, last = max(imu.t[0], path.first - offset + wide), min(imu.t[-1], path.last - offset - wide) - LASTS
    if last < first:
        return np.full(len(of_rates), np.nan)
    at = np.linspace(first, last, WINDOWS)[:, None] + np.arange(0.0, LASTS, FINE)
    rates, force = interpolated(at, imu.t, imu.rates), interpolated(at, t, f)
    turns = np.einsum("cij,skj->cski", of_rates, rates) * FINE
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
    """Return a doubt if other axes of the rates, or a mirrored force, fit the truth's motion clearly better."""
    imu, truth, source = recording.imu, recording.truth, map_.imu
    if imu is None or truth is None or source is None or map_.command is not None:
        return []
    others = [D for D in AXES if not np.allclose(D, np.eye(3))]
    mirrors = [D for D in others if np.linalg.det(D) < 0.0]
    same = [np.eye(3)]
    rates, force = np.array(same + others + same * len(mirrors)), np.array(same * (1 + len(others)) + mirrors)
    left = misfits(imu, truth_path(truth), offset, rates, force)
    least = float(left.min())
    if not CLEARER * least < left[0] or least > CARRIES:
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
