"""Recorded ranges as rows of one range, from tables with a column for each anchor or rows, files, topics of one."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ortilo_drake.interop.recorded.anchors import anchors_of, in_order, read_anchors
from ortilo_drake.interop.recorded.columns import Stream, files_of, read_stream
from ortilo_drake.interop.recorded.map_file import Find, Map
from ortilo_drake.interop.recorded.range_sources import DifferenceSource, RangeSource
from ortilo_drake.interop.recorded.rejected import Rejections
from ortilo_drake.interop.recorded.sources import OfOne
from ortilo_drake.model.typed_yaml import InputError

CODED = (5, 3.0)  # a code for no range: its least count, and its least ratio to the largest true range
FARTHEST = 1e5  # largest range [m]; a larger report of a radio is no range, and its square overflows
FEWEST = 10  # least number of ranges of a recording
LONGER = 1.0  # largest error by which a difference may exceed the distance between its anchors [m]
SHOWN = 8  # number of names shown in an error

Names = tuple[str, ...]


class Ranges(NamedTuple):
    """Ranges and differences in the order of their stamps (n each).

    t: stamp [s]; anchor: index of the anchor b; r: range r_b or difference r_b - r_a [m]; other: index of the anchor a,
    -1 for a single range; tag: index of the tag that heard them, 0 where there is only one.
    """

    t: np.ndarray
    anchor: np.ndarray
    r: np.ndarray
    other: np.ndarray
    tag: np.ndarray

    def only(self, which: np.ndarray) -> "Ranges":
        """Return the rows that `which` selects."""
        return Ranges(*(part[which] for part in self))


def single_ranges(t: np.ndarray, anchor: np.ndarray, r: np.ndarray) -> Ranges:
    """Return single ranges r [m] of one tag at stamps t [s] (n each), without differences."""
    return Ranges(t, anchor, r, np.full(len(t), -1), np.zeros(len(t), np.int64))


NO_RANGES = single_ranges(np.zeros(0), np.zeros(0, np.int64), np.zeros(0))


def surveyed(folder: Path, map_: Map) -> tuple[Names, np.ndarray | int]:
    """Return the anchors' names in the rows, () if unknown, and positions (n, 3) [m] or the number to be found.

    The anchors stand in the order of the map's ranges. InputError if their file is wrong or lacks an anchor.
    """
    anchors, names = map_.anchors, map_.names
    if isinstance(anchors, Find):
        return names, anchors.find
    if isinstance(anchors, tuple):
        return names, np.array(anchors)
    if isinstance(anchors, str):
        anchors = read_anchors(files_of(folder, anchors)[0])
    return in_order(anchors, names, "ranges.names")


def _check_known(stream: Stream, called: Names | np.ndarray, found: np.ndarray, what: str, has: Names) -> None:
    """Refuse a stream in which no row names an anchor or tag (`what`) of the map."""
    if (found < 0).all():
        shown = ", ".join(np.unique(called)[:SHOWN])
        raise InputError(f"{stream.rejected.source}: no row names {what} of the map: {shown}, not {', '.join(has)}")


def _tags_of(source: RangeSource | DifferenceSource, stream: Stream, tags: Names) -> np.ndarray:
    """Return each row's tag (n), an index into the map's tags; -1 for an unknown tag, 0 where rows name no tag."""
    if stream.names is None or source.tag is None:
        return np.zeros(len(stream.t), np.int64)
    called = np.array([".".join(row) for row in stream.names[:, -len(source.tag_columns) :]])
    found = anchors_of(called.tolist(), tags)
    _check_known(stream, called, found, "a tag", tags)
    stream.rejected.add_rows("rows of tags that the map does not name", found < 0, stream.rows, called)
    return found


def ranges_by_name(stream: Stream, anchor: np.ndarray, tag: np.ndarray, scale: float) -> Ranges:
    """Return the ranges [m] of rows that name an anchor: index (n), -1 if unknown; repeated rows count as rejected."""
    ranges, unknown = single_ranges(stream.t, anchor, stream.values[:, 0])._replace(tag=tag), anchor < 0
    assert stream.names is not None
    named = stream.names[:, 0]
    stream.rejected.add_rows("ranges to anchors that the map does not name", unknown, stream.rows, named)
    stream, ranges = stream.only(~unknown), ranges.only(~unknown)
    again = np.ones(len(ranges.t), dtype=bool)
    keys = np.column_stack([ranges.t, ranges.anchor, ranges.tag])
    again[np.unique(keys, axis=0, return_index=True)[1]] = False
    stream = stream.without(again, "duplicate stamps of one anchor")
    return _usable(stream, ranges.only(~again), scale)


def ranges_by_column(stream: Stream, tag: np.ndarray, scale: float) -> Ranges:
    """Return the ranges [m] of rows that have one range to each anchor."""
    n, count = stream.values.shape
    ranges = single_ranges(np.repeat(stream.t, count), np.tile(np.arange(count), n), stream.values.ravel())
    return _usable(stream, ranges._replace(tag=np.repeat(tag, count)), scale, " (the others of their row are kept)")


def ranges_of_anchor(stream: Stream, i: int, scale: float) -> Ranges:
    """Return the ranges [m] of rows that all belong to the anchor i."""
    width = stream.values.shape[1]
    if width != 1:
        raise InputError(f"{stream.rejected.source}: {width} values in a row or message, one anchor")
    return _usable(stream, single_ranges(stream.t, np.full(len(stream.t), i), stream.values[:, 0]), scale)


def _usable(stream: Stream, ranges: Ranges, scale: float, others: str = "") -> Ranges:
    """Return the valid ranges, scaled to m; the others are counted as rejected."""
    r, rows = ranges.r, np.repeat(stream.rows, stream.values.shape[1])
    none, low = ~np.isfinite(r), np.isfinite(r) & (r <= 0.0)
    far = np.isfinite(r) & (r > FARTHEST / scale)
    code = code_of_none(r[~(none | low)])
    coded = r == code
    bad = {
        "ranges that are NaN or empty": none,
        "ranges of 0 or less": low,
        f"ranges of exactly {code:g}, far above all others: not heard?": coded,
        f"ranges of more than {FARTHEST / 1000:g} km": far & ~coded,
    }
    for reason, which in bad.items():
        stream.rejected.add_rows(reason + others, which, rows)
    return ranges._replace(r=scale * r).only(~np.any(list(bad.values()), axis=0))


def code_of_none(r: np.ndarray) -> float:
    """Return a value that codes no range, such as 65535: one frequent value far above all others; NaN if none."""
    most = float(r.max(initial=0.0))
    less = r[r < most]
    often = len(less) and len(r) - len(less) >= CODED[0]
    return most if often and most > CODED[1] * less.max() else np.nan


def _each_of_one_anchor(folder: Path, source: RangeSource, count: int, names: Names) -> Iterator[tuple[int, Stream]]:
    """Yield (anchor, stream) of each file or topic with the ranges to one anchor; nothing if the map has none such."""
    of_files = source.anchors_of_files
    paths = files_of(folder, source.file)
    for i, topic in enumerate(source.topics):
        yield i, read_stream(paths, source, source.values, "ranges", topic)
    if source.topics or not (of_files or source.a_file_each):
        return
    if not of_files and len(paths) != count:
        raise InputError(f"ranges.file: {len(paths)} files of one range a row, but {count} anchors in the map")
    for i, path in enumerate(paths):
        anchor = i
        if of_files and names:
            anchor = int(anchors_of([of_files[i]], names)[0])
            if anchor < 0:
                raise InputError(f"ranges.file: '{of_files[i]}' is none of the anchors, which are {', '.join(names)}")
        yield anchor, read_stream([path], source, source.values, "ranges", source.topic)


def _each_tag(source: RangeSource, tags: Names) -> Iterator[tuple[int, RangeSource]]:
    """Yield (tag, source with its files only) for each tag with its own files; else (0, the whole source)."""
    of_files = source.tags_of_files
    if not of_files:
        yield 0, source
        return
    found = anchors_of(of_files, tags)
    if (found < 0).any():
        raise InputError(f"ranges.file: '{of_files[int(np.argmin(found))]}' is none of the tags: {', '.join(tags)}")
    for i in np.unique(found):
        its = [one for one, tag in zip(source.file, found, strict=True) if tag == i and isinstance(one, OfOne)]
        files = tuple(one.file if one.anchor is None else one.model_copy(update={"tag": None}) for one in its)
        alone = len(files) == 1 and its[0].anchor is None
        yield int(i), source.model_copy(update={"file": files[0] if alone else files})


def _of_ranges(
    folder: Path, source: RangeSource, names: Names, count: int, told: list[Rejections], tags: Names
) -> list[Ranges]:
    parts = []
    for i, stream in _each_of_one_anchor(folder, source, count, names):
        told += stream.told
        parts.append(ranges_of_anchor(stream, i, source.scale))
    if parts:
        return parts
    paths = files_of(folder, source.file)
    called = (*(() if source.anchor is None else (source.anchor,)), *source.tag_columns)
    stream = read_stream(paths, source, source.values, "ranges", source.topic, called)
    told += stream.told
    tag, width = _tags_of(source, stream, tags), stream.values.shape[1]
    stream, tag = stream.only(tag >= 0), tag[tag >= 0]
    if not source.rows_name_anchors:
        if width != count:
            raise InputError(f"{stream.rejected.source}: {width} ranges in a row, but {count} anchors in the map")
        return [ranges_by_column(stream, tag, source.scale)]
    if not names:
        raise InputError("ranges.names: are missing: what the rows call the anchors; or give `anchors` by name")
    if width != 1:
        raise InputError(f"{stream.rejected.source}: {width} values in a row that names one anchor")
    assert stream.names is not None
    anchor = anchors_of(stream.names[:, 0].tolist(), names)
    _check_known(stream, stream.names[:, 0], anchor, "an anchor", names)
    return [ranges_by_name(stream, anchor, tag, source.scale)]


def _of_differences(
    folder: Path, source: DifferenceSource, names: Names, anchors: np.ndarray, told: list[Rejections], tags: Names
) -> Ranges:
    called = (source.b, source.a, *source.tag_columns)
    stream = read_stream(files_of(folder, source.file), source, (source.value,), "differences", source.topic, called)
    told += stream.told
    assert stream.names is not None
    b, a = (anchors_of(its.tolist(), names) for its in stream.names[:, :2].T)
    tag = _tags_of(source, stream, tags)
    _check_known(stream, stream.names[:, 0], np.minimum(a, b), "two anchors", names)
    value, apart = np.abs(source.scale * stream.values[:, 0]), np.linalg.norm(anchors[a] - anchors[b], axis=1)
    long = (np.minimum(a, b) >= 0) & (a != b) & (value > apart + LONGER)
    if long.sum() > len(long) / 2:
        raise InputError(
            f"{stream.rejected.source}: differences of {np.median(value[long]):.3g} m and more for anchors up to "
            f"{apart.max():.3g} m apart: in mm or cm? differences: {{scale: }} makes them metres"
        )
    return differences_of(stream, b, a, tag, anchors, source)


def differences_of(
    stream: Stream, b: np.ndarray, a: np.ndarray, tag: np.ndarray, anchors: np.ndarray, source: DifferenceSource
) -> Ranges:
    """Return the valid differences r_b - r_a [m]; the others are counted as rejected.

    `b`, `a` and `tag` are indices of the two anchors and of the tag that heard the difference (n), -1 if unknown.
    `anchors` are the positions of all anchors (m, 3) [m]; `source` is the map's entry.
    """
    value, unknown = stream.values[:, 0], (a < 0) | (b < 0)
    none, same = ~unknown & ~np.isfinite(value), ~unknown & (a == b)
    apart = np.linalg.norm(anchors[a] - anchors[b], axis=1)
    long = ~(unknown | none | same) & (np.abs(source.scale * value) > apart + LONGER)
    assert stream.names is not None
    blamed = np.where(b < 0, *stream.names[:, :2].T)
    stream.rejected.add_rows("differences to anchors that are not surveyed", unknown, stream.rows, blamed)
    for bad, reason in (
        (none, "differences that are NaN or empty"),
        (same, "differences of one anchor to itself"),
        (long, f"differences longer by {LONGER:g} m than their anchors lie apart"),
    ):
        stream.rejected.add_rows(reason, bad, stream.rows)
    good = ~(unknown | none | same | long | (tag < 0))
    return Ranges(stream.t, b, source.sign * source.scale * value, a, tag).only(good)


def read_range_rows(folder: Path, map_: Map, told: list[Rejections]) -> tuple[Ranges, np.ndarray | int]:
    """Return ranges and differences in the order of stamps, and the anchors' positions (n, 3) [m] or their number.

    InputError if a file cannot be read, or its ranges do not belong to the map's anchors.
    """
    (names, anchors), tags = surveyed(folder, map_), tuple(map_.tags or ())
    count = anchors if isinstance(anchors, int) else len(anchors)
    parts: list[Ranges] = []
    for i, source in () if map_.ranges is None else _each_tag(map_.ranges, tags):
        rows = _of_ranges(folder, source, names, count, told, tags)
        parts += [one._replace(tag=one.tag + i) for one in rows]
    if map_.differences is not None:
        parts.append(_of_differences(folder, map_.differences, names, np.asarray(anchors), told, tags))
    ranges = Ranges(*(np.concatenate(part) for part in zip(*parts, strict=True)))
    if len(ranges.t) < FEWEST:
        raise InputError(f"{told[-1].source}: {len(ranges.t)} ranges")
    return ranges.only(np.lexsort((ranges.tag, ranges.anchor, ranges.t))), anchors
