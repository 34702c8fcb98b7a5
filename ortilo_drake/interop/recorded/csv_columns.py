"""Tables of text: a header or none, any delimiter, empty lines and broken rows."""

import csv
from pathlib import Path

import numpy as np

from ortilo_drake.interop.recorded.rejected import Rejections
from ortilo_drake.interop.recorded.sources import Column, Source
from ortilo_drake.model.input_files import DATA_LIMIT, read_bytes
from ortilo_drake.model.typed_yaml import InputError, nearest

DELIMITERS = {"tab": "\t", "space": " "}
EMPTY = ("", "nan", "na", "null", "none", "-")  # cells without a number


def _number(cell: str) -> float | None:
    """Return a cell's number, NaN if it is empty, None if it is neither."""
    if cell.lower() in EMPTY:
        return np.nan
    try:
        return float(cell)
    except ValueError:
        return None


def _delimiter(source: Source, line: str) -> str:
    if source.delimiter != "auto":
        return DELIMITERS.get(source.delimiter, source.delimiter)
    return max("\t,;", key=line.count) if any(mark in line for mark in "\t,;") else " "


def _index(column: Column, names: list[str] | None, path: Path) -> int:
    if isinstance(column, int):
        return column - 1
    if names is None:
        raise InputError(f"{path}: has no header, so column '{column}' is not found by name: count columns from 1")
    if column not in names:
        raise InputError(f"{path}: no column '{column}'{nearest(column, names)}; has {', '.join(names)}")
    return names.index(column)


def read_csv(
    path: Path, source: Source, columns: tuple[Column, ...], rejected: Rejections
) -> tuple[np.ndarray, np.ndarray]:
    """Return stamps (n, the file's unit) and the columns (n, m), NaN in empty cells.

    Rows with fewer cells than asked for, or with a cell that is no number, are counted and left out.

    Raises:
        InputError: if the file cannot be read, a column is missing, or most rows are no numbers.
    """
    try:
        text = read_bytes(path, DATA_LIMIT).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path}: cannot be read: not UTF-8 text") from None
    lines = [(k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip()]
    if not lines:
        raise InputError(f"{path}: is empty")
    mark = _delimiter(source, lines[0][1])
    rows = csv.reader((line for _, line in lines), delimiter=mark, skipinitialspace=mark == " ")
    try:
        cells = [[cell.strip() for cell in row] for row in rows]
    except csv.Error as error:
        raise InputError(f"{path}: cannot be read: {error}") from None
    numeric = all(_number(cell) is not None for cell in cells[0])
    has_header = source.header == "yes" or (source.header == "auto" and not numeric)
    names = cells[0] if has_header else None
    wanted = [_index(column, names, path) for column in (source.time or 1, *columns)]
    width, found = max(wanted) + 1, []
    body = list(zip(lines, cells, strict=True))[has_header:]
    for (k, _), row in body:
        numbers = [_number(row[i]) for i in wanted] if len(row) >= width else []
        if not numbers:
            rejected.add(f"rows with fewer than {width} cells", f"in line {k}")
        elif None in numbers:
            rejected.add("rows with a cell that is no number", f"in line {k}")
        else:
            found.append(numbers)
    if len(found) < max(2, len(body) / 2):
        why = next(iter(rejected.lines()), "no rows")
        raise InputError(f"{path}: {len(found)} of {len(body)} rows can be read ({why})")
    table = np.array(found, dtype=float)
    return table[:, 0], table[:, 1:]
