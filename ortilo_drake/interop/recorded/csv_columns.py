"""Tables of text: a header or none, any delimiter, comments, empty lines and broken rows."""

import csv
from pathlib import Path

import numpy as np

from ortilo_drake.interop.recorded.rejected import Rejections
from ortilo_drake.interop.recorded.sources import Column, Source
from ortilo_drake.interop.recorded.table_head import Line, cells_of, layout_of, plain
from ortilo_drake.interop.recorded.tables import Table, number, stamp
from ortilo_drake.model.input_files import DATA_LIMIT, read_bytes
from ortilo_drake.model.typed_yaml import InputError, nearest


def text_of(path: Path, rejected: Rejections) -> str:
    """Return a file's text; Latin-1 where it is no UTF-8 (a degree sign in a head), which is told.

    Raises:
        InputError: if it cannot be read, or is no text.
    """
    content = read_bytes(path, DATA_LIMIT)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if b"\0" in content:
            raise InputError(f"{path}: cannot be read: not UTF-8 text") from None
        line = content[: error.start].count(b"\n") + 1
        rejected.notes.append(f"not UTF-8, first in line {line}; read as Latin-1")
        return content.decode("latin-1")


def lines_of(path: Path, rejected: Rejections) -> list[Line]:
    """Return number and text of the lines that are not empty; InputError if there are none."""
    lines = [(k, line) for k, line in enumerate(text_of(path, rejected).splitlines(), 1) if line.strip()]
    if not lines:
        raise InputError(f"{path}: is empty")
    return lines


def _index(column: Column, names: list[str] | None, path: Path) -> int:
    if isinstance(column, int):
        return column - 1
    if names is None:
        raise InputError(f"{path}: has no header, so column '{column}' is not found by name: count columns from 1")
    name = column if column in names else plain(column)
    if name not in names:
        raise InputError(f"{path}: no column '{column}'{nearest(column, names)}; has {', '.join(names)}")
    if names.count(name) > 1:
        raise InputError(
            f"{path}: column '{name}' stands {names.count(name)} times in the header: count columns from 1"
        )
    return names.index(name)


def _skip_comments(comments: list[Line], first_row: int, mark: str, rejected: Rejections) -> None:
    """Count rows that are commented out; tell of other comments among the rows."""
    others = []
    for k, text in comments:
        cells = cells_of(plain(text), mark)
        if all(number(cell) is not None for cell in cells) and any(cells):
            rejected.add("rows that are commented out", f"in line {k}")
        elif k > first_row:
            others.append(k)
    if others:
        rejected.notes.append(f"{len(others)} comments among the rows, first in line {others[0]}")


def read_csv(
    path: Path, source: Source, columns: tuple[Column, ...], rejected: Rejections, names: Column | None = None
) -> Table:
    """Return the rows of a table, stamps in the file's unit.

    Rows with fewer cells than asked for, or with a cell that is no number, are counted and left out, and so are rows
    that are commented out with `#` or `%`.

    Args:
        path: the file.
        source: its entry in the map.
        columns: those with numbers.
        rejected: where to count.
        names: the column that names each row's anchor, read as text.

    Raises:
        InputError: if the file cannot be read, a column is missing, or most rows are no numbers.
    """
    lines = lines_of(path, rejected)
    wanted = (source.time or 1, *columns, *(() if names is None else (names,)))
    numbered = [c for c in wanted[: 1 + len(columns)] if isinstance(c, int)]

    def is_row(cells: list[str]) -> bool:
        return any(cells[c - 1] and stamp(cells[c - 1]) is not None for c in numbered if c <= len(cells))

    try:
        layout = layout_of(lines, source.delimiter, source.header, wanted, is_row)
        if not layout.rows:
            raise InputError(f"{path}: holds no rows")
        places = [_index(column, layout.names, path) for column in wanted]
        _skip_comments(layout.comments, layout.rows[0][0], layout.mark, rejected)
        rows = [cells_of(text, layout.mark) for _, text in layout.rows]
    except csv.Error as error:
        raise InputError(f"{path}: cannot be read: {error}") from None
    width, found, called, kept = max(places) + 1, [], [], []
    at, where = places[0], places[1 : 1 + len(columns)]
    for (k, _), row in zip(layout.rows, rows, strict=True):
        if len(row) < width:
            rejected.add(f"rows with fewer than {width} cells", f"in line {k}")
            continue
        numbers = [stamp(row[at]), *(number(row[i]) for i in where)]
        if None in numbers:
            rejected.add("rows with a cell that is no number", f"in line {k}")
            continue
        found.append(numbers)
        kept.append(k)
        if names is not None:
            called.append(row[places[-1]])
    if len(found) < max(2, len(rows) / 2):
        why = rejected.most() or "no more"
        raise InputError(f"{path}: {len(found)} of {len(rows)} rows can be read ({why})")
    table = np.array(found, dtype=float)
    return Table(table[:, 0], table[:, 1:], None if names is None else np.array(called), np.array(kept))
