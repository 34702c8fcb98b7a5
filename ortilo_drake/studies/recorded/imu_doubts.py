"""Doubts about an IMU: its force beside gravity, its rates beside the force and the truth's turns."""

from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.recording import FORCE_UNITS, GRAVITY, Imu, Recording, Truth, axes_matrix
from ortilo_drake.interop.recorded.sources import Quaternion
from ortilo_drake.studies.recorded.clock_offset import TELLS, best_by_rates

OFF = 1.5  # of the force at rest from gravity; some units are 6 % wrong [m/s²]
TELLING = 0.1  # a unit is told if it brings the force this near to gravity, as a share
VARIES = 0.7  # a force whose size varies by more, in its median, from its 10 % to its 90 % has lost gravity
DOWN = 0.5  # share of a mean force along -z that looks upside down
FAST = 10.0  # body rates of this RMS look like degrees [rad/s]
SPAN = 1.0  # over this time the force keeps its direction, but for the turn [s]
LOSES = 0.05  # share of the force that its mean over a span loses, if it is turned wrongly
SPANS = 40  # tried
AROUND = 0.3  # clock offsets tried around the one found [s]
BETTER = 4.0  # another reading of the attitude leaves less of the turns by this factor
TURNED = np.radians(20.0)  # a body that turned by less tells nothing of its attitude
RATES = {"rad/s": 1.0, "deg/s": np.pi / 180.0}


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
    in_file = rest / FORCE_UNITS[map_.imu.force_unit]
    unit = min(FORCE_UNITS, key=lambda one: abs(in_file * FORCE_UNITS[one] - GRAVITY))
    there = in_file * FORCE_UNITS[unit]
    low, high = np.quantile(size, [0.1, 0.9])
    if high - low > VARIES * whole:
        return [f"{said}: gravity was taken out of it? The filter needs it: log the accelerometer as it is"]
    if abs(there - GRAVITY) < TELLING * GRAVITY and unit != map_.imu.force_unit:
        return [f"{said}: imu: {{force_unit: {unit}}} makes it {there:.2f}"]
    return [f"{said}: another unit (imu: force_unit), or other columns (imu: force)?"]


def upside_doubts(imu: Imu, map_: Map) -> list[str]:
    """A doubt if the mean force points down the body's z: then it would fly upside down."""
    up, size = float(imu.force[:, 2].mean()), float(np.linalg.norm(imu.force, axis=1).mean())
    if map_.imu is None or map_.command is not None or up > -DOWN * size:
        return []
    if isinstance(map_.imu.axes, str):
        key = {"flu": "frd", "frd": "flu"}[map_.imu.axes]
    else:  # half a turn about x: the other sign of z alone would mirror
        x, *others = map_.imu.axes
        key = f"[{', '.join([x, *(axis[1:] if axis[0] == '-' else f'-{axis}' for axis in others)])}]"
    return [f"imu: by its force, {up:.3g} m/s² along z, the body is upside down: imu: {{axes: {key}}} turns it up"]


def rate_doubts(imu: Imu, map_: Map) -> list[str]:
    """Return a doubt if body rates look like degrees per second, by the force alone; for a truth without attitude."""
    assert map_.imu is not None
    if map_.imu.rate_unit == "deg/s":
        return []
    fast = float(np.sqrt(np.mean(np.sum(imu.rates**2, axis=1))))
    now, then = (force_kept(imu, by) for by in RATES.values())
    if 1.0 - now > max(LOSES, BETTER * (1.0 - then)):
        return [
            f"imu: the body rates look like degrees (RMS {fast:.3g} rad/s): turned by them the force keeps {now:.0%} "
            f"of its size over {SPAN:g} s, with imu: {{rate_unit: deg/s}} {then:.0%}"
        ]
    if fast > FAST:
        return [f"imu: the body rates look like degrees (RMS {fast:.3g} rad/s): imu: {{rate_unit: deg/s}}?"]
    return []


def force_kept(imu: Imu, by: float) -> float:
    """Return the size of the force's mean beside the mean of its size, turned back by the rates times `by`.

    It is a mean over spans of a second: 1 for a body that the rates turn rightly and that hardly accelerates.
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
    """Return a doubt if the truth's attitude does not turn as the body rates do; it names keys with which it would.

    Args:
        recording: with IMU.
        map_: what it was read by.
        offset: truth's clock less the sensors', each from its own first stamp [s].
        up: the anchors' z in the truth's frame (3), if the ranges tell it.
    """
    truth, imu = recording.truth, recording.imu
    assert imu is not None
    assert map_.imu is not None
    if truth is None or truth.R is None or map_.truth is None or map_.truth.rotation is None:
        return rate_doubts(imu, map_)
    R = Rotation.from_matrix(truth.R)
    if float((R[0].inv() * R).magnitude().max()) < TURNED:
        return rate_doubts(imu, map_)
    rotation = map_.truth.rotation
    orders = ("xyzw", "wxyz") if isinstance(rotation, Quaternion) else (None,)
    found: dict[str, float] = {}
    for rate, of, order in product(RATES, ("body", "world"), orders):
        keys = []
        if order is not None and isinstance(rotation, Quaternion) and order != rotation.order:
            keys.append(f"order: {order}")
        if of != rotation.of:
            keys.append(f"of: {of}")
        said = [f"truth: {{rotation: {{{', '.join(keys)}}}}}"] if keys else []
        said += [] if rate == map_.imu.rate_unit else [f"imu: {{rate_unit: {rate}}}"]
        read = truth._replace(R=_read_as(truth.R, map_, of, order))
        turning = imu._replace(rates=imu.rates * RATES[rate] / RATES[map_.imu.rate_unit])
        found[", ".join(said)] = _left(turning, read, offset, up)
    now = found[""]
    better = [key for key, left in found.items() if left * BETTER <= now and left < TELLS and now > TELLS / BETTER]
    if better:
        key = min(better, key=lambda one: (found[one] > 1.5 * min(found.values()), one.count(":")))
        return [f"{_says(now)}: {key} leaves {found[key]:.1%}"]
    return [] if now < TELLS else [f"{_says(now)}: other axes, another body, or a clock beyond `search`?"]


def _says(left: float) -> str:
    share = f"{left:.0%}" if left < 10.0 else f"{left:.0f} times as much" if np.isfinite(left) else "all"
    return f"truth: its attitude does not turn as the body rates and the force say ({share} is left)"


def _read_as(R: np.ndarray, map_: Map, of: str, order: str | None) -> np.ndarray:
    """Return the attitude as the same numbers of the file give it, read otherwise."""
    assert map_.truth is not None
    rotation = map_.truth.rotation
    assert rotation is not None
    A = axes_matrix(map_.truth.axes, "truth.axes")
    in_file = A.T @ R
    in_file = in_file if rotation.of == "body" else in_file.transpose(0, 2, 1)
    if isinstance(rotation, Quaternion) and order is not None:
        q = Rotation.from_matrix(in_file).as_quat()
        columns = q if rotation.order == "xyzw" else q[:, [3, 0, 1, 2]]
        in_file = Rotation.from_quat(columns if order == "xyzw" else columns[:, [1, 2, 3, 0]]).as_matrix()
    return np.asarray(A @ (in_file if of == "body" else in_file.transpose(0, 2, 1)))


def _left(imu: Imu, truth: Truth, offset: float, up: np.ndarray | None) -> float:
    """Return the share of the turns that the rates leave, plus how far the force is from up: 0 alike, 1 opposite."""
    found = best_by_rates(imu, truth, lambda _: (-np.inf, np.inf), AROUND, None, (offset,))
    if not np.isfinite(found.left):
        return np.inf
    if up is None:
        return found.left
    assert truth.R is not None
    then = np.clip(truth.t - found.offset, imu.t[0], imu.t[-1])
    force = np.column_stack([np.interp(then, imu.t, axis) for axis in imu.force.T])
    up_T = np.mean(np.einsum("kij,jl,kl->ki", truth.R, found.mount, force), axis=0)
    size = float(np.mean(np.linalg.norm(force, axis=1)))
    return found.left + 0.5 * (1.0 - float(up_T @ up) / max(size, 1e-9))
