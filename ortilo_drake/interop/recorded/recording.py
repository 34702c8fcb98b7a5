"""A recorded motion as plain arrays in our axes: ranges, IMU and truth; and a report of the rejected rows."""

import os
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ortilo_drake.interop.recorded.boxes import Scene, read_boxes
from ortilo_drake.interop.recorded.columns import Stream, files_of, read_stream
from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.range_rows import Ranges, read_range_rows
from ortilo_drake.interop.recorded.rejected import Rejections, frozen_rows, leaping_rows, lines_of_all
from ortilo_drake.interop.recorded.sources import Column, Matrix, Quaternion, Source
from ortilo_drake.interop.recorded.units import (
    FORCE_UNITS,
    RATE_UNITS,
    are_attitudes,
    axes_matrix,
    in_axes,
    rotations,
    size_of,
)
from ortilo_drake.model.input_files import exists
from ortilo_drake.model.signals import DETECTIONS_SIZE
from ortilo_drake.model.typed_yaml import InputError

GRAVITY = 9.81  # [m/s²]; the accelerometer's bias absorbs the local deviation
LARGEST = 1e12  # limit of a file's numbers; UTM in mm reaches 1e10
MEASURED = {
    "imu": ("rates", "force"),
    "accelerometer": ("force",),
    "command": ("thrust",),
    "range_finder": ("distance",),
    "flow": ("pixels",),
    "truth": ("position",),
}


class Imu(NamedTuple):
    """Stamps (n) [s], body rates [rad/s] and specific force [m/s²] (n, 3), attitude (n, 3, 3) or None; body FLU.

    For a separate accelerometer, `accelerometer` holds its stamps (m) and samples (m, 3), and `force` its last sample
    at each stamp of the gyro.
    """

    t: np.ndarray
    rates: np.ndarray
    force: np.ndarray
    attitude: np.ndarray | None
    accelerometer: tuple[np.ndarray, np.ndarray] | None = None


class Truth(NamedTuple):
    """Stamps by the truth's clock (n) [s], position (n, 3) [m], attitude (n, 3, 3) or None if it was not recorded."""

    t: np.ndarray
    p: np.ndarray
    R: np.ndarray | None

    def only(self, which: np.ndarray | slice) -> "Truth":
        """Return the rows that `which` selects."""
        return Truth(self.t[which], self.p[which], None if self.R is None else self.R[which])


class AidRows(NamedTuple):
    """The rows of range finder (k), flow (m) and camera (l), with their stamps [s].

    The rows are distances (k) [m], flow (m, 2) [px], and a detections message of each picture (l, DETECTIONS_SIZE).
    """

    finder_t: np.ndarray
    distance: np.ndarray
    flow_t: np.ndarray
    flow: np.ndarray
    boxes_t: np.ndarray
    boxes: np.ndarray


NO_AID_ROWS = AidRows(*(np.zeros(0),) * 3, np.zeros((0, 2)), np.zeros(0), np.zeros((0, DETECTIONS_SIZE)))


ONE_TAG = np.zeros((1, 3))  # a single tag, at the point that the lever leads to


class Recording(NamedTuple):
    """A recorded motion. Stamps count from the first range, the truth's stamps from its own first row.

    `origin` and `truth_origin` are the times subtracted [s]; `anchors` positions (n, 3) [m], or the number to be found;
    `tags` (m, 3) their positions from the point that the lever leads to, body axes [m]; `scene` the boxes' landmarks.
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


Read = Callable[[str], Stream]  # key of a map's entry -> its complete rows, with the columns of columns_of


def columns_of(map_: Map, key: str) -> tuple[tuple[Column, ...], int]:
    """Return the columns of a map's entry, measured quantities first, then the attitude; and the number of the first.

    If a separate accelerometer measures the force, the imu has no columns of it: the rates stand there once more.
    """
    source, found = getattr(map_, key), list[Column]()
    for name in ("rates", "rates") if key == "imu" and map_.accelerometer is not None else MEASURED[key]:
        its = getattr(source, name)
        found += its if isinstance(its, tuple) else (its,)
    turned = getattr(source, "orientation", None) or getattr(source, "rotation", None)
    return (*found, *(() if turned is None else turned.columns)), len(found)


def complete(stream: Stream, vectors: int) -> Stream:
    """Return the rows of finite numbers, at most LARGEST in the first `vectors` columns; count the others."""
    bad = ~np.isfinite(stream.values).all(axis=1)
    far = ~bad & (np.abs(stream.values[:, :vectors]) > LARGEST).any(axis=1)
    stream.rejected.add_rows(f"rows with a number beyond {LARGEST:g}", far, stream.rows)
    stream.rejected.add_rows("rows with NaN, infinity or an empty cell", bad, stream.rows)
    return stream.only(~(bad | far))


def with_attitude(stream: Stream, source: Matrix | Quaternion, begin: int) -> Stream:
    """Return the rows whose columns from `begin` on are a valid attitude; the others are counted as rejected."""
    kind = "unit quaternion" if isinstance(source, Quaternion) else "rotation matrix"
    return stream.without(~are_attitudes(stream.values[:, begin:], source), f"rows without a {kind}")


def _mostly_with_attitude(stream: Stream, source: Matrix | Quaternion | None, begin: int) -> Stream:
    if source is None:
        return stream
    kept = with_attitude(stream, source, begin)
    if len(kept.t) < max(2, len(stream.t) / 2):
        rotations(stream.values[:, begin:], source, stream.rejected.source)  # says what is wrong
    return kept


def _reader(folder: Path, map_: Map, told: list[Rejections]) -> Read:
    """Return a reader of a map's entries, which refuses one with fewer than 2 rows; add the rejected rows to `told`."""

    def read(key: str) -> Stream:
        source, (columns, measured) = getattr(map_, key), columns_of(map_, key)
        stream = read_stream(files_of(folder, source.file), source, columns, key, source.topic)
        told.extend(stream.told)
        found = complete(stream, measured)
        if len(found.t) < 2:
            raise InputError(f"{stream.rejected.source}: {len(found.t)} of {len(stream.t)} rows are complete")
        return _mostly_with_attitude(found, getattr(source, "orientation", None), measured)

    return read


def between(imu: Imu, after: float, until: float) -> Imu:
    """Return the samples after the stamp `after`, up to and including the stamp `until` [s]."""
    kept, own = (imu.t > after) & (imu.t <= until), imu.accelerometer
    if own is not None:
        its = (own[0] > after) & (own[0] <= until)
        own = own[0][its], own[1][its]
    turned = None if imu.attitude is None else imu.attitude[kept]
    return Imu(imu.t[kept], imu.rates[kept], imu.force[kept], turned, own)


def held_at(t: np.ndarray, stamps: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the last of `values` (m, ...), with rising stamps (m), at each time t (n); before all, the first value."""
    return np.asarray(values[np.clip(np.searchsorted(stamps, t, side="right") - 1, 0, len(stamps) - 1)])


def imu_of(map_: Map, read: Read, origin: float) -> Imu:
    """Return the imu's samples in body FLU; stamps count from `origin` [s], the stamp of the first range.

    With a separate accelerometer `force` is not filled in.
    """
    source, own = map_.imu, map_.accelerometer
    assert source is not None
    turned, M = source.orientation, axes_matrix(source.axes, "imu.axes")
    of_rates, of_force = (
        M if own_axes is None else axes_matrix(own_axes, "imu", mirrors=True)
        for own_axes in (source.rate_axes, source.force_axes)
    )
    stream = read("imu")
    t, unit = _counted(stream.t, source, origin), size_of(source.force_unit, FORCE_UNITS)
    rates = stream.values[:, :3] @ of_rates.T * size_of(source.rate_unit, RATE_UNITS)
    imu = Imu(t, rates, stream.values[:, 3:6] @ of_force.T * unit, None)
    if turned is not None:
        # The unit's world frame follows its body frame: z down with axes frd. M turns both; the heading stays unknown.
        imu = imu._replace(attitude=M @ rotations(stream.values[:, 6:], turned, stream.rejected.source) @ M.T)
    if map_.command is not None:
        commanded = read("command")
        thrust = commanded.values[:, 0] * map_.command.scale
        held = held_at(t, _counted(commanded.t, map_.command, origin), thrust)
        imu = imu._replace(force=np.column_stack([np.zeros((len(t), 2)), held]))
    if own is not None:
        stream = read("accelerometer")
        imu = imu._replace(accelerometer=(_counted(stream.t, own, origin), stream.values @ of_force.T * unit))
    return imu


def _counted(t: np.ndarray, source: Source, origin: float) -> np.ndarray:
    """Return stamps [s] that count from `origin`, or with `zero: first` from the first of them."""
    return t - (float(t[0]) if source.zero == "first" else origin)


def looks_of(map_: Map, read: Read, origin: float) -> AidRows:
    """Return the rows of range finder and flow; stamps count from `origin` [s], the stamp of the first range."""
    looks, finder, flow = NO_AID_ROWS, map_.range_finder, map_.flow
    if finder is not None:
        stream = read("range_finder")
        stream = stream.without(stream.values[:, 0] * finder.scale <= 0.0, "distances of 0 or less")
        distance = stream.values[:, 0] * finder.scale
        looks = looks._replace(finder_t=_counted(stream.t, finder, origin), distance=distance)
    if flow is not None:
        stream = read("flow")
        looks = looks._replace(flow_t=_counted(stream.t, flow, origin), flow=stream.values)
    return looks


def _truth(map_: Map, read: Read) -> tuple[Truth, float]:
    source = map_.truth
    assert source is not None
    stream = read("truth")
    if source.drop_zero_rows:
        stream = stream.without((stream.values[:, :3] == 0.0).all(axis=1), "rows without a position (all zero)")
    stream = _mostly_with_attitude(stream, source.rotation, 3)
    if len(stream.t) > 2:
        leaps = leaping_rows(stream.values[:, :3] * source.scale)
        stream = stream.without(leaps, "rows whose position leaps away and back")
    if source.drop_frozen is not None and len(stream.t):
        frozen = frozen_rows(stream.t, stream.values[:, :3], source.drop_frozen)
        stream = stream.without(frozen, "rows that repeat a position (frozen)")
    t, values = stream.t, stream.values
    if len(t) < 10:
        raise InputError(f"{stream.rejected.source}: {len(t)} rows have a position")
    M = axes_matrix(source.axes, "truth.axes", mirrors=True)
    R = None if source.rotation is None else rotations(values[:, 3:], source.rotation, stream.rejected.source)
    p = values[:, :3] @ M.T * source.scale
    return Truth(t - t[0], p, None if R is None else in_axes(R, M)), float(t[0])


def _check_spans(path: Path, ranges: np.ndarray, others: dict[str, np.ndarray]) -> None:
    """Refuse stamps [s] whose span differs from the span of the ranges by a factor of about 1000 or its powers."""
    for name, t in others.items():
        ratio = max(np.ptp(t), 1e-9) / max(np.ptp(ranges), 1e-9)
        power = 3.0 * round(float(np.log10(ratio)) / 3.0)
        if power and abs(ratio / 10.0**power - 1.0) < 0.3:
            line = f"{np.ptp(t):.3g} s, the ranges' {np.ptp(ranges):.3g} s: {name}.unit or ranges.unit is wrong"
            raise InputError(f"{path}: the {name}'s stamps span {line}")


def _check_overlap(path: Path, ranges: np.ndarray, imu: np.ndarray) -> None:
    """Refuse an imu whose stamps [s] all lie before or after those of the ranges."""
    if imu[-1] < 0.0 or imu[0] > ranges[-1]:
        line = f"from {imu[0]:.6g} to {imu[-1]:.6g} s after the first range; give imu.late or imu.zero: first"
        raise InputError(f"{path}: the imu's stamps do not overlap the ranges': {line}")


def read_recording(path: Path, map_: Map) -> Recording:
    """Read a motion from the folder with the map's files, or from one of these files.

    InputError of one line if a file, column, topic or field is missing, or too few rows can be read.
    """
    if not exists(path):
        raise InputError(f"{path}: no such file or folder")
    told: list[Rejections] = []
    ranges, anchors = read_range_rows(path, map_, told)
    origin = float(ranges.t[0])
    ranges = ranges._replace(t=ranges.t - origin)
    read, scene = _reader(path, map_, told), None
    looks = looks_of(map_, read, origin)
    if map_.boxes is not None:
        t, boxes, scene = read_boxes(path, map_.boxes, told)
        looks = looks._replace(boxes_t=_counted(t, map_.boxes, origin), boxes=boxes)
    imu = None if map_.imu is None else imu_of(map_, read, origin)
    if imu is not None and imu.accelerometer is not None:
        imu = imu._replace(force=held_at(imu.t, *imu.accelerometer))
    truth, truth_origin = (None, 0.0) if map_.truth is None else _truth(map_, read)
    _check_spans(path, ranges.t, {n: one.t for n, one in (("imu", imu), ("truth", truth)) if one is not None})
    if imu is not None:
        _check_overlap(path, ranges.t, imu.t)
    lines = lines_of_all(told)
    counts = Counter[str]()
    for part in told:
        counts.update({f"{part.source}: {reason}": n for reason, n in part.counts.items()})
    folder = path if path.is_dir() else path.parent
    name = Path(os.path.abspath(folder)).name  # of a link the name of the link; "." alone would have none
    tags = ONE_TAG if map_.tags is None else np.array(list(map_.tags.values()))
    return Recording(name, ranges, imu, truth, anchors, origin, truth_origin, lines, dict(counts), looks, tags, scene)
