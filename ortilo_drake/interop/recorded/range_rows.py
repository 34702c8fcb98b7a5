"""Recorded ranges, one a row: of tables with a column for each anchor, of rows, files or topics of one anchor."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ortilo_drake.interop.recorded.anchor_names import anchors_of
from ortilo_drake.interop.recorded.anchors import in_order, read_anchors
from ortilo_drake.interop.recorded.columns import Stream, files_of, read_stream
from ortilo_drake.interop.recorded.map_file import Find, Map
from ortilo_drake.interop.recorded.rejected import Rejections
from ortilo_drake.model.typed_yaml import InputError

FARTHEST = 1e5  # [m]; what a ranging radio reports beyond is no range, and its square overflows
FEWEST = 10  # ranges that make a recording
SHOWN = 8  # names of anchors in an error

Rows = tuple[np.ndarray, np.ndarray, np.ndarray]  # stamps [s], anchors, ranges (n each)


class Surveyed(NamedTuple):
    """What the rows call the anchors, empty if nothing says it, and positions (n, 3) or the number to be found."""

    names: tuple[str, ...]
    positions: np.ndarray | int

    @property
    def number(self) -> int:
        """Return how many anchors there are."""
        return self.positions if isinstance(self.positions, int) else len(self.positions)


def surveyed(folder: Path, map_: Map) -> Surveyed:
    """Return the map's anchors in the order of its ranges; InputError if their file is wrong or one is not in it."""
    anchors, names = map_.anchors, map_.ranges.names
    if isinstance(anchors, Find):
        return Surveyed(names, anchors.find)
    if isinstance(anchors, tuple):
        return Surveyed(names, np.array(anchors))
    if isinstance(anchors, str):
        anchors = read_anchors(files_of(folder, anchors)[0])
    return Surveyed(*in_order(anchors, names, "ranges.names"))


def _of_rows(stream: Stream, names: tuple[str, ...]) -> Rows:
    """Return the rows whose anchor is one of these; others and repetitions are counted."""
    assert stream.names is not None
    anchor = anchors_of(stream.names.tolist(), names)
    unknown = anchor < 0
    if unknown.all():
        said = ", ".join(np.unique(stream.names)[:SHOWN])
        raise InputError(f"{stream.rejected.source}: no row names an anchor of the map: {said}, not {', '.join(names)}")
    called = f" ('{stream.names[np.argmax(unknown)]}')"
    reason = "ranges to anchors that the map does not name"
    stream.rejected.add(reason, stream.place(unknown) + called, int(unknown.sum()))
    stream, anchor = stream.only(~unknown), anchor[~unknown]
    _, first = np.unique(np.column_stack([stream.t, anchor]), axis=0, return_index=True)
    again = np.ones(len(anchor), dtype=bool)
    again[first] = False
    stream.rejected.add("duplicate stamps of one anchor", stream.place(again), int(again.sum()))
    return stream.t[~again], anchor[~again], stream.values[~again, 0]


def _usable(stream: Stream, rows: Rows, in_a_row: int, scale: float, others: str = "") -> Rows:
    """Return the ranges [m] that are some; the others are counted."""
    t, anchor, r = rows
    none, low = ~np.isfinite(r), np.isfinite(r) & (r <= 0.0)
    far = np.isfinite(r) & (r > FARTHEST / scale)
    reasons = ("ranges that are NaN or empty", "ranges of 0 or less", f"ranges of more than {FARTHEST / 1000:g} km")
    for bad, reason in zip((none, low, far), reasons, strict=True):
        first = int(np.argmax(bad))
        place = (
            f"at {t[first]:.3f} s" if in_a_row == 1 else f"in {stream.rejected.word} {stream.rows[first // in_a_row]}"
        )
        stream.rejected.add(reason + others, place, int(bad.sum()))
    good = ~(none | low | far)
    return t[good], anchor[good], scale * r[good]


def _of_one_anchor(stream: Stream, i: int, scale: float) -> Rows:
    width = stream.values.shape[1]
    if width != 1:
        raise InputError(f"{stream.rejected.source}: {width} values in a row or message, one anchor")
    return _usable(stream, (stream.t, np.full(len(stream.t), i), stream.values[:, 0]), 1, scale)


def _each_of_one_anchor(folder: Path, map_: Map, count: int, names: tuple[str, ...]) -> Iterator[tuple[int, Stream]]:
    """Yield anchor and stream of each file or topic that has the ranges to one anchor; none if the map has no such."""
    source, of_files = map_.ranges, map_.ranges.anchors_of_files
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


def read_range_rows(folder: Path, map_: Map, told: list[Rejections]) -> tuple[Rows, np.ndarray | int]:
    """Return the ranges [m] by their stamps [s], and the anchors' positions (n, 3), or their number.

    Args:
        folder: where the map's files are.
        map_: what is what.
        told: gets what was rejected.

    Raises:
        InputError: if a file cannot be read, or its ranges are not those to the map's anchors.
    """
    source, (names, positions) = map_.ranges, (found := surveyed(folder, map_))
    count, parts = found.number, []
    for i, stream in _each_of_one_anchor(folder, map_, count, names):
        told += stream.told
        parts.append(_of_one_anchor(stream, i, source.scale))
    if not parts:
        paths = files_of(folder, source.file)
        stream = read_stream(paths, source, source.values, "ranges", source.topic, source.anchor)
        told += stream.told
        width = stream.values.shape[1]
        if source.rows_name_anchors:
            if not names:
                raise InputError("ranges.names: are missing: what the rows call the anchors; or give `anchors` by name")
            if width != 1:
                raise InputError(f"{stream.rejected.source}: {width} values in a row that names one anchor")
            parts.append(_usable(stream, _of_rows(stream, names), 1, source.scale))
        elif width != count:
            raise InputError(f"{stream.rejected.source}: {width} ranges in a row, but {count} anchors in the map")
        else:
            rows = np.repeat(stream.t, count), np.tile(np.arange(count), len(stream.t)), stream.values.ravel()
            parts.append(_usable(stream, rows, count, source.scale, " (the others of their row are kept)"))
    t, anchor, r = (np.concatenate(part) for part in zip(*parts, strict=True))
    if len(t) < FEWEST:
        raise InputError(f"{told[-1].source}: {len(t)} ranges")
    order = np.lexsort((anchor, t))
    return (t[order], anchor[order], r[order]), positions
