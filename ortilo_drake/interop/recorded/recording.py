"""A recorded motion as plain arrays: ranges, IMU and truth, in our axes, with what was rejected."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ortilo_drake.interop.recorded.columns import Stream, read_stream
from ortilo_drake.interop.recorded.map_file import Find, Map
from ortilo_drake.interop.recorded.rejected import Rejections
from ortilo_drake.interop.recorded.sources import Matrix, Quaternion, RangeSource
from ortilo_drake.model.input_files import exists
from ortilo_drake.model.typed_yaml import InputError

GRAVITY = 9.81  # [m/s²]; the accelerometer's bias takes up what differs from place to place
FORCE_UNITS = {"m/s2": 1.0, "g": GRAVITY, "mg": GRAVITY / 1000.0, "ft/s2": 0.3048, "cm/s2": 0.01}


class Ranges(NamedTuple):
    """Single ranges in the order of their stamps: stamp [s], anchor, range [m] (n each)."""

    t: np.ndarray
    anchor: np.ndarray
    r: np.ndarray


class Imu(NamedTuple):
    """Stamps [s] (n), body rates [rad/s] and specific force [m/s²] (n, 3), attitude (n, 3, 3) if known; body FLU."""

    t: np.ndarray
    rates: np.ndarray
    force: np.ndarray
    attitude: np.ndarray | None


class Truth(NamedTuple):
    """Stamps by the truth's clock [s] (n), position [m] (n, 3), attitude (n, 3, 3) if it was recorded."""

    t: np.ndarray
    p: np.ndarray
    R: np.ndarray | None


class Recording(NamedTuple):
    """A motion; stamps count from the first range, the truth's from its own first.

    `origin` and `truth_origin` [s] are what was taken off, `anchors` (n, 3) or their number if they are to be found.
    """

    name: str
    ranges: Ranges
    imu: Imu | None
    truth: Truth | None
    anchors: np.ndarray | int
    origin: float
    truth_origin: float
    told: list[str]
    rejected: dict[str, int]


def axes_matrix(axes: str | tuple[str, ...], what: str = "imu.axes") -> np.ndarray:
    """Return the matrix from the unit's axes to ours; InputError if it mirrors.

    Entry k of a list says which of the unit's axes ours (x forward, y left, z up) is.
    """
    if isinstance(axes, str):
        return np.diag([1.0, 1.0, 1.0] if axes == "flu" else [1.0, -1.0, -1.0])
    M = np.zeros((3, 3))
    for k, axis in enumerate(axes):
        M[k, "xyz".index(axis[-1])] = -1.0 if axis[0] == "-" else 1.0
    if np.linalg.det(M) < 0:
        raise InputError(f"{what}: {list(axes)}: mirrors space; change one sign")
    return M


def rotations(values: np.ndarray, source: Matrix | Quaternion, what: str) -> np.ndarray:
    """Return rotation matrices body to world (n, 3, 3) of quaternions (n, 4) or matrices (n, 9).

    Raises:
        InputError: if they are none.
    """
    if isinstance(source, Matrix):
        R = values.reshape(-1, 3, 3)
        off = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max() if len(R) else 0.0
        if off > 0.05 or np.linalg.det(R).min() < 0:
            raise InputError(f"{what}: no rotation matrices: R R' differs from 1 by {off:.2g}")
    else:
        norms = np.linalg.norm(values, axis=1)
        if np.abs(norms - 1.0).max() > 0.05:
            raise InputError(f"{what}: no unit quaternions: norms {norms.min():.3g} to {norms.max():.3g}")
        R = Rotation.from_quat(values if source.order == "xyzw" else values[:, [1, 2, 3, 0]]).as_matrix()
    return R if source.of == "body" else np.ascontiguousarray(R.transpose(0, 2, 1))


def _complete(t: np.ndarray, values: np.ndarray, rejected: Rejections) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows without NaN or infinity; the others are counted."""
    bad = ~np.isfinite(values).all(axis=1)
    rejected.add("rows with NaN, infinity or an empty cell", f"in row {np.argmax(bad) + 1}", int(bad.sum()))
    if (~bad).sum() < 2:
        raise InputError(f"{rejected.source}: {(~bad).sum()} of {len(bad)} rows are complete")
    return t[~bad], values[~bad]


def _of_rows(stream: Stream, names: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return stamps, anchors and ranges of rows that name their anchor; unknown names and repetitions are counted."""
    known = np.isin(stream.values[:, 0], names)
    place = f"in row {np.argmin(known) + 1}"
    stream.rejected.add("ranges to anchors that the map does not name", place, int((~known).sum()))
    t, r = stream.t[known], stream.values[known, 1]
    anchor = np.array([names.index(int(name)) for name in stream.values[known, 0]], dtype=np.int64)
    _, first = np.unique(np.column_stack([t, anchor]), axis=0, return_index=True)
    stream.rejected.add("duplicate stamps", "of one anchor", len(t) - len(first))
    first = np.sort(first)
    return t[first], anchor[first], r[first]


def _read_ranges(folder: Path, map_: Map, told: list[Rejections]) -> tuple[Ranges, float]:
    source: RangeSource = map_.ranges
    count = map_.anchors.find if isinstance(map_.anchors, Find) else len(map_.anchors)
    parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for i, topic in enumerate(source.topics or (source.topic,)):
        columns = source.values if source.anchor is None else (source.anchor, *source.values)
        stream = read_stream(folder, source, columns, "ranges", topic, repeats=source.anchor is not None)
        told.append(stream.rejected)
        width = stream.values.shape[1]
        if source.anchor is not None:
            parts.append(_of_rows(stream, source.names))
        elif source.topics:
            if width != 1:
                raise InputError(f"{stream.rejected.source}: {topic}: {width} values in a message, one anchor")
            parts.append((stream.t, np.full(len(stream.t), i), stream.values[:, 0]))
        elif width != count:
            raise InputError(f"{stream.rejected.source}: {width} ranges in a row, but {count} anchors in the map")
        else:
            anchors = np.tile(np.arange(count), len(stream.t))
            parts.append((np.repeat(stream.t, count), anchors, stream.values.ravel()))
    t, anchor, r = (np.concatenate(part) for part in zip(*parts, strict=True))
    r = r * source.scale
    none = ~np.isfinite(r)
    told[-1].add("ranges that are NaN or empty (the others of their row are kept)", "", int(none.sum()))
    low = ~none & (r <= 0.0)
    told[-1].add("ranges of 0 or less (the others of their row are kept)", "", int(low.sum()))
    order = np.lexsort((anchor, t))
    order = order[~(none | low)[order]]
    if len(order) < 10:
        raise InputError(f"{told[-1].source}: {len(order)} ranges")
    origin = float(t[order[0]])
    return Ranges(t[order] - origin, anchor[order], r[order]), origin


def _read_imu(folder: Path, map_: Map, origin: float, told: list[Rejections]) -> Imu:
    source = map_.imu
    assert source is not None
    turned = () if source.orientation is None else source.orientation.columns
    stream = read_stream(folder, source, (*source.rates, *source.force, *turned), "imu", source.topic)
    told.append(stream.rejected)
    t, values = _complete(stream.t, stream.values, stream.rejected)
    M = axes_matrix(source.axes)
    rates = values[:, :3] @ M.T * (np.pi / 180.0 if source.rate_unit == "deg/s" else 1.0)
    force = values[:, 3:6] @ M.T * FORCE_UNITS[source.force_unit]
    attitude = None
    if source.orientation is not None:
        # The unit's world is as its body: z down with axes frd. A half turn about x leaves the heading to be found.
        attitude = M @ rotations(values[:, 6:], source.orientation, stream.rejected.source) @ M.T
    t = t - (float(t[0]) if source.zero == "first" else origin)
    if map_.command is not None:
        commanded = read_stream(folder, map_.command, (map_.command.thrust,), "command", map_.command.topic)
        told.append(commanded.rejected)
        t_u, thrust = _complete(commanded.t, commanded.values, commanded.rejected)
        t_u = t_u - (float(t_u[0]) if map_.command.zero == "first" else origin)
        held = np.clip(np.searchsorted(t_u, t, side="right") - 1, 0, len(t_u) - 1)
        force = np.column_stack([np.zeros((len(t), 2)), thrust[held, 0] * map_.command.scale])
    return Imu(t, rates, force, attitude)


def frozen_rows(t: np.ndarray, p: np.ndarray, longest: float) -> np.ndarray:
    """Return which rows repeat the position before them, in runs that last longer than this.

    Args:
        t: stamps (n) [s].
        p: positions (n, 3).
        longest: a repetition of no more than this is no freeze [s].
    """
    new = np.concatenate(([True], (np.diff(p, axis=0) != 0.0).any(axis=1)))
    starts, run = np.flatnonzero(new), np.cumsum(new) - 1
    lasts = np.maximum.reduceat(t, starts) - t[starts]
    return np.asarray(~new & (lasts > longest)[run])


def _read_truth(folder: Path, map_: Map, told: list[Rejections]) -> tuple[Truth, float]:
    source = map_.truth
    assert source is not None
    turned = () if source.rotation is None else source.rotation.columns
    stream = read_stream(folder, source, (*source.position, *turned), "truth", source.topic)
    told.append(stream.rejected)
    t, values = _complete(stream.t, stream.values, stream.rejected)
    if source.drop_zero_rows:
        none = (values[:, :3] == 0.0).all(axis=1)
        stream.rejected.add("rows without a position (all zero)", f"at {t[np.argmax(none)]:g} s", int(none.sum()))
        t, values = t[~none], values[~none]
    if source.drop_frozen is not None:
        kept = ~frozen_rows(t, values[:, :3], source.drop_frozen)
        stream.rejected.add("rows that repeat a position (frozen)", f"at {t[np.argmin(kept)]:g} s", int((~kept).sum()))
        t, values = t[kept], values[kept]
    if len(t) < 10:
        raise InputError(f"{stream.rejected.source}: {len(t)} rows have a position")
    M = axes_matrix(source.axes, "truth.axes")
    R = None if source.rotation is None else rotations(values[:, 3:], source.rotation, stream.rejected.source)
    p = values[:, :3] @ M.T * source.scale
    return Truth(t - t[0], p, None if R is None else M @ R), float(t[0])


def read_recording(path: Path, map_: Map) -> Recording:
    """Read a motion.

    Args:
        path: the folder with the map's files, or one of them.
        map_: what is what.

    Raises:
        InputError: one line, if a file, column, topic or field is missing, or hardly anything can be read.
    """
    if not exists(path):
        raise InputError(f"{path}: no such file or folder")
    told: list[Rejections] = []
    ranges, origin = _read_ranges(path, map_, told)
    imu = None if map_.imu is None else _read_imu(path, map_, origin, told)
    truth, truth_origin = (None, 0.0) if map_.truth is None else _read_truth(path, map_, told)
    if imu is not None and (imu.t[-1] < 0.0 or imu.t[0] > ranges.t[-1]):
        line = f"from {imu.t[0]:.6g} to {imu.t[-1]:.6g} s after the first range; give imu.late or imu.zero: first"
        raise InputError(f"{path}: the imu's stamps do not overlap the ranges': {line}")
    anchors = map_.anchors.find if isinstance(map_.anchors, Find) else np.array(map_.anchors)
    lines = [line for part in told for line in part.lines()]
    counts: dict[str, int] = {}
    for part in told:
        for reason, n in part.counts.items():
            counts[f"{part.source}: {reason}"] = counts.get(f"{part.source}: {reason}", 0) + n
    name = path.name if path.is_dir() else path.parent.name
    return Recording(name, ranges, imu, truth, anchors, origin, truth_origin, lines, counts)
