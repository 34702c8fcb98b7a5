"""A recorded stream: stamps and a table of numbers, from one file or several files of any kind."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ortilo_drake.interop.recorded.range_sources import RangeSource
from ortilo_drake.interop.recorded.rejected import Rejections, began_anew, kept_in_order
from ortilo_drake.interop.recorded.ros2_folder import natural
from ortilo_drake.interop.recorded.sources import MOST, Column, OfOne, Source
from ortilo_drake.interop.recorded.tables import Table
from ortilo_drake.interop.recorded.units import size_of
from ortilo_drake.model.input_files import exists
from ortilo_drake.model.typed_yaml import InputError

UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


class Stream(NamedTuple):
    """Rising stamps (n) [s], numbers (n, columns), names of anchors and tag (n, k) or None, and the rejected rows.

    `rows` (n) are the numbers of lines or messages in their file; `told` has each file's rejections, `rejected` last.
    """

    t: np.ndarray
    values: np.ndarray
    names: np.ndarray | None
    rows: np.ndarray
    rejected: Rejections
    told: tuple[Rejections, ...]

    def without(self, which: np.ndarray, reason: str) -> "Stream":
        """Count the rows in the mask `which` (n) as rejected for a reason, and return the other rows."""
        self.rejected.add_rows(reason, which, self.rows)
        return self.only(~which)

    def only(self, which: np.ndarray) -> "Stream":
        """Return the rows in the mask `which` (n)."""
        names = None if self.names is None else self.names[which]
        return self._replace(t=self.t[which], values=self.values[which], names=names, rows=self.rows[which])


def files_of(folder: Path, names: str | Sequence[str | OfOne]) -> list[Path]:
    """Return the files that a map names; files of a pattern stand in natural order, anchor2 before anchor10.

    InputError if no file fits a pattern, or there are too many files.
    """
    base, found = folder if folder.is_dir() else folder.parent, []
    for entry in [names] if isinstance(names, str) else names:
        name = entry if isinstance(entry, str) else entry.file
        if not any(mark in name for mark in "*?[") or exists(base / name):
            found.append(base / name)
            continue
        try:
            fitting = [path for path in base.glob(name) if path.is_file()]
        except (NotImplementedError, OSError, ValueError) as error:  # an absolute pattern, or ** within a name
            raise InputError(f"{base / name}: not a pattern of files: {error}") from None
        if not fitting:
            raise InputError(f"{base / name}: no file fits this pattern")
        found += sorted(fitting, key=lambda path: natural(str(path)))
    if len(found) > MOST:
        raise InputError(f"{base}: {len(found)} files of one stream, at most {MOST} are read")
    return found


def read_stream(
    paths: Sequence[Path],
    source: Source,
    columns: tuple[Column, ...],
    what: str,
    topic: str | None,
    names: tuple[Column, ...] = (),
) -> Stream:
    """Read the columns of a source's files, merged by their stamps; NaN where a row has no value.

    `what` is the name of the stream in messages, `topic` its topic if the files are bags, else None, `names` the
    columns that name each row's anchors and tag. InputError if a file cannot be read, or too little of it.
    """
    parts = [_read_file(path, source, columns, what, topic, names) for path in paths]
    if len(parts) == 1:
        return parts[0]
    widths = {part.values.shape[1] for part in parts}
    if len(widths) > 1:
        raise InputError(
            f"{what}: its files have {', '.join(map(str, sorted(widths)))} values in a row, not one number"
        )
    t, values = np.concatenate([part.t for part in parts]), np.concatenate([part.values for part in parts])
    called = (
        None if parts[0].names is None else np.concatenate([part.names for part in parts if part.names is not None])
    )
    order = np.argsort(t, kind="stable")
    merged = Rejections(f"{len(parts)} files ({what})", word="row")
    if called is None:
        same = np.concatenate(([False], np.diff(t[order]) == 0.0))
        merged.add("stamps that two files have", f"at {t[order][np.argmax(same)]:.6f} s", int(same.sum()))
        order = order[~same]
    told = tuple(part.rejected for part in parts)
    rows = np.arange(1, len(order) + 1)
    return Stream(t[order], values[order], None if called is None else called[order], rows, merged, (*told, merged))


def _read_file(
    path: Path, source: Source, columns: tuple[Column, ...], what: str, topic: str | None, names: tuple[Column, ...]
) -> Stream:
    from ortilo_drake.interop.recorded.bag_columns import read_bag
    from ortilo_drake.interop.recorded.csv_columns import read_csv
    from ortilo_drake.interop.recorded.flight_logs import is_flight_log, read_flight_log
    from ortilo_drake.interop.recorded.lec_console import read_lec

    rejected = Rejections(f"{path.name} ({what if topic is None else f'{what}, {topic}'})")
    table: Table
    if isinstance(source, RangeSource) and source.format == "lec":
        table = read_lec(path, rejected)
    elif topic is None:
        table = read_csv(path, source, columns, rejected, names)
    elif is_flight_log(path):
        table = read_flight_log(path, topic, source.time, columns, rejected, names)
    else:
        table = read_bag(path, topic, source, columns, rejected, names)
    in_unit = source.time is not None or topic is None
    t = table.t * size_of(source.unit, UNITS) if in_unit else table.t
    tagged = getattr(source, "tag", None) is not None  # the rows of one tag may come after the rows of another tag
    named_by = None if table.names is None else table.names[:, 0]
    if not tagged and (back := began_anew(t, named_by)) is not None:
        row = f"{rejected.word} {table.rows[back]}"
        raise InputError(f"{rejected.source}: its clock begins anew in {row}: two times would be mixed; cut it there")
    keep = kept_in_order(t, table.rows, rejected, named_by)
    called = None if table.names is None else table.names[keep]
    return Stream(t[keep] - source.late, table.values[keep], called, table.rows[keep], rejected, (rejected,))
