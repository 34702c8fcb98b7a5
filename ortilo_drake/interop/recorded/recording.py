"""A recorded motion as plain arrays: ranges, IMU and truth, in our axes, with what was rejected."""

import os
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ortilo_drake.interop.recorded.attitudes import are_attitudes, rotations
from ortilo_drake.interop.recorded.boxes import Scene, read_boxes
from ortilo_drake.interop.recorded.columns import Stream, files_of, read_stream
from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.range_rows import Ranges, read_range_rows
from ortilo_drake.interop.recorded.rejected import Rejections
from ortilo_drake.interop.recorded.sources import Column, ImuSource, Matrix, Quaternion, Source
from ortilo_drake.interop.recorded.units import FORCE_UNITS, RATE_UNITS, axes_matrix, in_axes, size_of
from ortilo_drake.model.input_files import exists
from ortilo_drake.model.signals import DETECTIONS_SIZE
from ortilo_drake.model.typed_yaml import InputError

GRAVITY = 9.81  # [m/s²]; the accelerometer's bias takes up what differs from place to place
LARGEST = 1e12  # of a file's numbers; UTM in mm reaches 1e10


class Imu(NamedTuple):
    """Stamps [s] (n), body rates [rad/s] and specific force [m/s²] (n, 3), attitude (n, 3, 3) if known; body FLU.

    Of an accelerometer with stamps of its own, `accelerometer` holds these (m) and its samples (m, 3), and `force` what
    it last said at the gyro's stamps.
    """

    t: np.ndarray
    rates: np.ndarray
    force: np.ndarray
    attitude: np.ndarray | None
    accelerometer: tuple[np.ndarray, np.ndarray] | None = None


class Truth(NamedTuple):
    """Stamps by the truth's clock [s] (n), position [m] (n, 3), attitude (n, 3, 3) if it was recorded."""

    t: np.ndarray
    p: np.ndarray
    R: np.ndarray | None


class AidRows(NamedTuple):
    """The rows of range finder, flow and camera, each at its stamp [s] (k), (m), (l).

    They are distances [m] (k), flow [px] (m, 2), and a detections message of each picture (l, DETECTIONS_SIZE).
    """

    finder_t: np.ndarray
    distance: np.ndarray
    flow_t: np.ndarray
    flow: np.ndarray
    boxes_t: np.ndarray
    boxes: np.ndarray


NO_AID_ROWS = AidRows(*(np.zeros(0),) * 3, np.zeros((0, 2)), np.zeros(0), np.zeros((0, DETECTIONS_SIZE)))


ONE_TAG = np.zeros((1, 3))  # at that point itself


class Recording(NamedTuple):
    """A motion; stamps count from the first range, the truth's from its own first.

    `origin` and `truth_origin` [s] are what was taken off, `anchors` (n, 3) or their number if they are to be found,
    `tags` (m, 3) where the tags are from the point that the lever leads to, body axes, `scene` what the boxes show.
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
    looks: AidRows = NO_AID_ROWS
    tags: np.ndarray = ONE_TAG
    scene: Scene | None = None


def _complete(stream: Stream, vectors: int) -> Stream:
    """Return the rows without NaN or infinity, and none in its vectors whose square is; the others are counted."""
    bad = ~np.isfinite(stream.values).all(axis=1)
    far = ~bad & (np.abs(stream.values[:, :vectors]) > LARGEST).any(axis=1)
    stream.rejected.add(f"rows with a number beyond {LARGEST:g}", stream.place(far), int(far.sum()))
    stream.rejected.add("rows with NaN, infinity or an empty cell", stream.place(bad), int(bad.sum()))
    bad |= far
    if (~bad).sum() < 2:
        raise InputError(f"{stream.rejected.source}: {(~bad).sum()} of {len(bad)} rows are complete")
    return stream.only(~bad)


def _with_attitude(stream: Stream, source: Matrix | Quaternion | None, begin: int) -> Stream:
    """Return the rows whose columns from `begin` on are an attitude; the others are counted, and refused if most."""
    if source is None:
        return stream
    good = are_attitudes(stream.values[:, begin:], source)
    if good.sum() < max(2, len(good) / 2):
        rotations(stream.values[:, begin:], source, stream.rejected.source)  # says what is wrong
    kind = "unit quaternion" if isinstance(source, Quaternion) else "rotation matrix"
    stream.rejected.add(f"rows without a {kind}", stream.place(~good), int((~good).sum()))
    return stream.only(good)


def _read(
    folder: Path, source: Source, columns: tuple[Column, ...], what: str, told: list[Rejections], vectors: int
) -> Stream:
    stream = read_stream(files_of(folder, source.file), source, columns, what, source.topic)
    told += stream.told
    return _complete(stream, vectors)


def imu_columns(map_: Map) -> tuple[Column, ...]:
    """Return the columns read from the imu's stream: rates, force and, where it has one, the attitude.

    An accelerometer with a stream of its own has the force; the rates then stand in its place, too.
    """
    source = map_.imu
    assert source is not None
    turned = () if source.orientation is None else source.orientation.columns
    return (*source.rates, *(source.force if map_.accelerometer is None else source.rates), *turned)


def force_of(values: np.ndarray, source: ImuSource) -> np.ndarray:
    """Return the specific force [m/s²] (n, 3), body FLU, from the accelerometer's samples."""
    return np.asarray(values @ axes_matrix(source.axes).T * size_of(source.force_unit, FORCE_UNITS))


def imu_motion(values: np.ndarray, source: ImuSource, what: str) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Return body rates [rad/s], specific force [m/s²] (n, 3) and attitude (n, 3, 3) or None, body FLU.

    Args:
        values: rows of imu_columns.
        source: the map's entry.
        what: what the stream is called in an error.
    """
    M = axes_matrix(source.axes)
    rates = values[:, :3] @ M.T * size_of(source.rate_unit, RATE_UNITS)
    force = force_of(values[:, 3:6], source)
    if source.orientation is None:
        return rates, force, None
    # The unit's world is as its body: z down with axes frd. A half turn about x leaves the heading to be found.
    return rates, force, M @ rotations(values[:, 6:], source.orientation, what) @ M.T


def held_at(t: np.ndarray, stamps: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the values that hold at t (n): the last of values (m, ...) at rising stamps (m), before all the first."""
    return np.asarray(values[np.clip(np.searchsorted(stamps, t, side="right") - 1, 0, len(stamps) - 1)])


def _read_imu(folder: Path, map_: Map, origin: float, told: list[Rejections]) -> Imu:
    source = map_.imu
    assert source is not None
    stream = _read(folder, source, imu_columns(map_), "imu", told, 6)
    stream = _with_attitude(stream, source.orientation, 6)
    rates, force, attitude = imu_motion(stream.values, source, stream.rejected.source)
    t = _counted(stream.t, source, origin)
    if map_.command is not None:
        commanded = _read(folder, map_.command, (map_.command.thrust,), "command", told, 1)
        t_u, thrust = commanded.t, commanded.values
        t_u = _counted(t_u, map_.command, origin)
        force = np.column_stack([np.zeros((len(t), 2)), held_at(t, t_u, thrust[:, 0] * map_.command.scale)])
    own = None
    if map_.accelerometer is not None:
        stream = _read(folder, map_.accelerometer, map_.accelerometer.force, "accelerometer", told, 3)
        own = _counted(stream.t, map_.accelerometer, origin), force_of(stream.values, source)
        force = held_at(t, *own)
    return Imu(t, rates, force, attitude, own)


def _counted(t: np.ndarray, source: Source, origin: float) -> np.ndarray:
    """Return stamps [s] from the first range's on, or from their own first."""
    return t - (float(t[0]) if source.zero == "first" else origin)


def _read_looks(folder: Path, map_: Map, origin: float, told: list[Rejections]) -> tuple[AidRows, Scene | None]:
    looks, scene = NO_AID_ROWS, None
    if map_.range_finder is not None:
        stream = _read(folder, map_.range_finder, (map_.range_finder.distance,), "range_finder", told, 1)
        distance = stream.values[:, 0] * map_.range_finder.scale
        none = distance <= 0.0
        stream.rejected.add("distances of 0 or less", stream.place(none), int(none.sum()))
        t = _counted(stream.t, map_.range_finder, origin)
        looks = looks._replace(finder_t=t[~none], distance=distance[~none])
    if map_.flow is not None:
        stream = _read(folder, map_.flow, map_.flow.pixels, "flow", told, 2)
        looks = looks._replace(flow_t=_counted(stream.t, map_.flow, origin), flow=stream.values)
    if map_.boxes is not None:
        t, boxes, scene = read_boxes(folder, map_.boxes, told)
        looks = looks._replace(boxes_t=_counted(t, map_.boxes, origin), boxes=boxes)
    return looks, scene


def frozen_rows(t: np.ndarray, p: np.ndarray, longest: float) -> np.ndarray:
    """Return a mask (n) of the rows that repeat the position before them, in runs longer than `longest`.

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
    stream = _read(folder, source, (*source.position, *turned), "truth", told, 3)
    if source.drop_zero_rows:
        none = (stream.values[:, :3] == 0.0).all(axis=1)
        stream.rejected.add("rows without a position (all zero)", stream.place(none), int(none.sum()))
        stream = stream.only(~none)
    stream = _with_attitude(stream, source.rotation, 3)
    if source.drop_frozen is not None and len(stream.t):
        frozen = frozen_rows(stream.t, stream.values[:, :3], source.drop_frozen)
        stream.rejected.add("rows that repeat a position (frozen)", stream.place(frozen), int(frozen.sum()))
        stream = stream.only(~frozen)
    t, values = stream.t, stream.values
    if len(t) < 10:
        raise InputError(f"{stream.rejected.source}: {len(t)} rows have a position")
    M = axes_matrix(source.axes, "truth.axes", mirrors=True)
    R = None if source.rotation is None else rotations(values[:, 3:], source.rotation, stream.rejected.source)
    p = values[:, :3] @ M.T * source.scale
    return Truth(t - t[0], p, None if R is None else in_axes(R, M)), float(t[0])


def _check_spans(path: Path, ranges: np.ndarray, others: dict[str, np.ndarray]) -> None:
    """Refuse stamps [s] whose spans differ by a factor of about a thousand or a million from the ranges'."""
    for name, t in others.items():
        ratio = max(np.ptp(t), 1e-9) / max(np.ptp(ranges), 1e-9)
        power = 3.0 * round(float(np.log10(ratio)) / 3.0)
        if power and abs(ratio / 10.0**power - 1.0) < 0.3:
            line = f"{np.ptp(t):.3g} s, the ranges' {np.ptp(ranges):.3g} s: {name}.unit or ranges.unit is wrong"
            raise InputError(f"{path}: the {name}'s stamps span {line}")


def _check_overlap(path: Path, ranges: np.ndarray, imu: np.ndarray) -> None:
    """Refuse an imu whose stamps [s] lie before or after the ranges'."""
    if imu[-1] < 0.0 or imu[0] > ranges[-1]:
        line = f"from {imu[0]:.6g} to {imu[-1]:.6g} s after the first range; give imu.late or imu.zero: first"
        raise InputError(f"{path}: the imu's stamps do not overlap the ranges': {line}")


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
    ranges, anchors = read_range_rows(path, map_, told)
    origin = float(ranges.t[0])
    ranges = ranges._replace(t=ranges.t - origin)
    looks, scene = _read_looks(path, map_, origin, told)
    imu = None if map_.imu is None else _read_imu(path, map_, origin, told)
    truth, truth_origin = (None, 0.0) if map_.truth is None else _read_truth(path, map_, told)
    _check_spans(path, ranges.t, {n: one.t for n, one in (("imu", imu), ("truth", truth)) if one is not None})
    if imu is not None:
        _check_overlap(path, ranges.t, imu.t)
    lines = [line for part in told for line in part.lines()]
    counts: dict[str, int] = {}
    for part in told:
        for reason, n in part.counts.items():
            counts[f"{part.source}: {reason}"] = counts.get(f"{part.source}: {reason}", 0) + n
    folder = path if path.is_dir() else path.parent
    name = Path(os.path.abspath(folder)).name  # "." has no name of its own, a link has
    tags = ONE_TAG if map_.tags is None else np.array(list(map_.tags.values()))
    return Recording(name, ranges, imu, truth, anchors, origin, truth_origin, lines, counts, looks, tags, scene)
