"""Tables of text: with or without header, with any delimiter, comments, empty lines and broken rows."""

import csv
from codecs import BOM_UTF16_BE, BOM_UTF16_LE, getincrementaldecoder
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from io import TextIOWrapper
from itertools import chain, takewhile
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple

import numpy as np

from ortilo_drake.interop.recorded.rejected import Rejections
from ortilo_drake.interop.recorded.sources import Column, Source
from ortilo_drake.interop.recorded.stamps import clock_period, stamp, unrolled
from ortilo_drake.interop.recorded.tables import Rows, Table, number
from ortilo_drake.model.input_files import DATA_LIMIT, MIB, open_file
from ortilo_drake.model.typed_yaml import InputError, nearest

LINE: Final = MIB  # longest line [characters]; a row of 10,000 columns takes a quarter of it
HEAD: Final = 10_000  # largest number of lines above the rows
DELIMITERS = {"tab": "\t", "space": " "}
SIGNS = "#%"  # first signs of comments, and of headers that numpy, ROS and others write as comments
BLOCK: Final = MIB
LOOKED_AT = 20  # number of rows from which the delimiter is found

Line = tuple[int, str]


def _encoding(file: BinaryIO, path: Path, rejected: Rejections) -> str:
    """Return a table's encoding; Latin-1, with a note, for text that is not UTF-8 (as by a degree sign in a header)."""
    begin = file.read(64)
    file.seek(0)
    if begin[:2] in (BOM_UTF16_LE, BOM_UTF16_BE) and begin.count(0) > max(3, len(begin) // 2 - 2):
        return "utf-16"  # the encoding of Excel's text files
    decoder, line, nul, bad = getincrementaldecoder("utf-8")(), 1, False, False
    while block := file.read(BLOCK):
        nul |= b"\0" in block
        if not bad:
            held = decoder.getstate()[0]
            try:
                decoder.decode(block)
                line += block.count(b"\n")
            except UnicodeDecodeError as error:
                bad, line = True, line + block[: max(0, error.start - len(held))].count(b"\n")
    file.seek(0)
    if not bad and not decoder.getstate()[0]:
        return "utf-8-sig"
    if nul:
        raise InputError(f"{path}: cannot be read: not UTF-8 text")
    rejected.notes.append(f"not UTF-8, first in line {line}; read as Latin-1")
    return "latin-1"


def lines_of(path: Path, rejected: Rejections, limit: int = DATA_LIMIT) -> Iterator[Line]:
    """Yield (number, text) of the lines that are not empty; the file may be large, for only one line is held.

    InputError if the file cannot be read, is no text, is empty, or has a line of more than LINE characters.
    """
    with open_file(path, limit) as file, TextIOWrapper(file, _encoding(file, path, rejected), "replace") as text:
        empty = True
        for k, line in enumerate(iter(lambda: text.readline(LINE + 1), ""), 1):
            if len(line) > LINE:
                raise InputError(f"{path}: line {k}: more than {LINE:,} characters, the most that are read")
            if line.strip():
                empty = False
                yield k, line.rstrip("\n")
    if empty:
        raise InputError(f"{path}: is empty")


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


def _head_of(lines: Iterator[Line], path: Path) -> list[Line]:
    """Return the first lines, from which the layout is found: a few rows (LOOKED_AT) and the lines above them."""
    found, rows = [], 0
    for line in lines:
        found.append(line)
        rows += not is_comment(line)
        if rows == LOOKED_AT:
            break
        if len(found) > HEAD:
            raise InputError(f"{path}: no {LOOKED_AT} rows in its first {HEAD:,} lines")
    return found


def read_csv(
    path: Path, source: Source, columns: tuple[Column, ...], rejected: Rejections, names: tuple[Column, ...] = ()
) -> Table:
    """Return the rows of a table, with stamps in the file's unit.

    Rows with too few cells or with a cell that is no number, and rows commented out with `#` or `%`, are counted and
    left out. InputError if the file cannot be read, a column is missing, or fewer than half of the rows can be read.
    """
    times = source.time if isinstance(source.time, tuple) else (source.time or 1,)
    wanted = (*times, *columns, *names)
    numbered = [c for c in wanted[: len(times) + len(columns)] if isinstance(c, int)]

    def is_row(cells: list[str]) -> bool:
        return any(cells[c - 1] and stamp(cells[c - 1]) is not None for c in numbered if c <= len(cells))

    try:
        lines = lines_of(path, rejected)
        layout = layout_of(_head_of(lines, path), source.delimiter, source.header, wanted, is_row)
        if not layout.rows:
            raise InputError(f"{path}: holds no rows")
        places = [_index(column, layout.names, path) for column in wanted]
        others: list[int] = []

        def count_comment(k: int, text: str) -> None:
            cells = cells_of(plain(text), layout.mark)
            if any(cells) and all(number(cell) is not None for cell in cells):
                rejected.add("rows that are commented out", f"in line {k}")
            elif k > layout.rows[0][0]:
                others.append(k)

        for comment in layout.comments:
            count_comment(*comment)
        width, rows, count = max(places) + 1, Rows(path), 0
        at, where, first_stamp = places[0], places[len(times) : len(times) + len(columns)], ""
        called = places[len(times) + len(columns) :]
        for k, text in chain(layout.rows, lines):
            if k > layout.rows[-1][0] and is_comment((k, text)):
                count_comment(k, text)
                continue
            count += 1
            row = cells_of(text, layout.mark)
            if len(row) < width:
                rejected.add(f"rows with fewer than {width} cells", f"in line {k}")
                continue
            t, values = stamp(row[at]), [value for i in where if (value := number(row[i])) is not None]
            if t is not None and len(times) > 1:
                t += 1e-9 * (np.nan if (more := number(row[places[1]])) is None else more)
            if t is None or len(values) < len(where):
                rejected.add("rows with a cell that is no number", f"in line {k}")
                continue
            first_stamp = first_stamp or row[at]
            rows.add(k, t, values, [row[i] for i in called])
    except csv.Error as error:
        raise InputError(f"{path}: cannot be read: {error}") from None
    if others:
        rejected.notes.append(f"{len(others)} comments among the rows, first in line {others[0]}")
    if len(rows) < max(2, count / 2):
        why = rejected.most() or "no more"
        raise InputError(f"{path}: {len(rows)} of {count} rows can be read ({why})")
    table = rows.table()
    return table._replace(t=unrolled(table.t, clock_period(first_stamp)))


class Layout(NamedTuple):
    """The layout of a table: column names or None, delimiter, lines with rows, and comments other than the header."""

    names: list[str] | None
    mark: str
    rows: list[Line]
    comments: list[Line]


def plain(name: str) -> str:
    """Return a column's name without a sign of comments before it."""
    return name.strip().lstrip(SIGNS).strip()


def is_comment(line: Line) -> bool:
    """Return whether a line that is not empty begins with a sign of comments."""
    return line[1].lstrip()[0] in SIGNS


def cells_of(line: str, mark: str) -> list[str]:
    """Return the cells of a line; quotes as in CSV are allowed."""
    if '"' in line:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=mark, skipinitialspace=True))]
    return line.split() if mark == " " else [cell.strip() for cell in line.split(mark)]


def mark_of(line: str) -> str:
    """Return the delimiter of a line: the one of tab, comma, semicolon or bar that it has most, else space.

    The comma of numbers such as 3,62 between other delimiters is no delimiter.
    """
    for mark in "\t;| " if "," in line else "":
        cells = cells_of(line, mark)
        if len(cells) > 1 and all("," not in cell or number(cell) is not None for cell in cells):
            return mark
    return max("\t,;|", key=line.count) if any(mark in line for mark in "\t,;|") else " "


def _readings(line: Line, mark: str) -> list[tuple[Line, list[str]]]:
    """Return possible lists of column names in a header line, split by the rows' delimiter or by its own.

    First come the names without a leading sign of comments. A sign alone may be a name: a counter is often called #.
    """
    found = []
    for own in dict.fromkeys((mark, mark_of(line[1]), " ")):
        cells = cells_of(line[1], own)
        found.append((line, cells_of(line[1].lstrip().lstrip(SIGNS), own)))
        if plain(cells[0]) == "":
            found.append((line, cells))
    return [(line, [plain(name) or name for name in names]) for line, names in found if not _all_numbers(names)]


def _all_numbers(cells: list[str]) -> bool:
    return all(number(cell) is not None for cell in cells)


def layout_of(
    lines: list[Line], delimiter: str, header: str, columns: Sequence[str | int], is_row: Callable[[list[str]], bool]
) -> Layout:
    """Return the layout of a table. Its header is the line with the wanted columns and as many cells as the rows.

    Candidates are the lines above the first row of numbers; then the comments above them, from below; then the first
    lines that follow, if one has all columns: Vicon's tables have a rate above their header. `lines` are the lines that
    are not empty, with their numbers. `delimiter` is the map's word for it; `header` is auto, yes or no. `columns` are
    the wanted columns by name or number; `is_row` says whether cells have numbers in the columns given by number.
    """
    comments = [line for line in lines if is_comment(line)]
    rows = [line for line in lines if not is_comment(line)]
    mark = DELIMITERS.get(delimiter, delimiter)
    if delimiter == "auto":
        marks = Counter(mark_of(text) for _, text in rows[:LOOKED_AT])
        mark = marks.most_common(1)[0][0] if rows else " "
    asked = {plain(column) for column in columns if isinstance(column, str)}
    first = cells_of(rows[0][1], mark) if rows else []
    if header == "no" or not rows or (header == "auto" and not asked and is_row(first)):
        return Layout(None, mark, rows, comments)
    lead = list(takewhile(lambda row: not (_all_numbers(its := cells_of(row[1], mark)) or is_row(its)), rows))
    width = len(cells_of(rows[len(lead) if len(lead) < len(rows) else min(1, len(rows) - 1)][1], mark))
    lines_above = [line for line in comments[::-1] if line[0] < rows[0][0]]
    text_first = not _all_numbers(first)
    maybe = lead + lines_above + [rows[0]] * (header == "yes" and not text_first)
    heads = [head for line in maybe for head in _readings(line, mark)]
    heads += [head for line in rows[len(lead) : LOOKED_AT] for head in _readings(line, mark) if asked <= set(head[1])]
    with_all = [head for head in heads if asked and asked <= set(head[1])]
    found = next((head for head in with_all or heads if len(head[1]) == width), next(iter(with_all), None))
    if found is None and (text_first or header == "yes"):
        found = (rows[0], [plain(name) for name in cells_of(rows[0][1], mark_of(rows[0][1]))])
    if found is None:
        return Layout(None, mark, rows, comments)
    line, names = found
    below = rows.index(line) + 1 if line in rows else 0
    return Layout(names, mark, rows[below:], [comment for comment in comments if comment != line])
