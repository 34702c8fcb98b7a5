"""The head of a table: the line with its columns' names, with or without a `#` or `%`, or none."""

import csv
from collections import Counter
from collections.abc import Callable, Sequence
from itertools import takewhile
from typing import NamedTuple

from ortilo_drake.interop.recorded.tables import number

DELIMITERS = {"tab": "\t", "space": " "}
SIGNS = "#%"  # of comments, and of heads that numpy, ROS and others write as comments
LOOKED_AT = 20  # the rows that tell the delimiter

Line = tuple[int, str]


class Layout(NamedTuple):
    """Names of the columns, if there are any, the lines with rows, and the comments that are neither."""

    names: list[str] | None
    mark: str
    rows: list[Line]
    comments: list[Line]


def plain(name: str) -> str:
    """Return a column's name without the sign before it."""
    return name.strip().lstrip(SIGNS).strip()


def is_comment(line: Line) -> bool:
    """Return whether a line, which is not empty, begins with a sign of comments."""
    return line[1].lstrip()[0] in SIGNS


def cells_of(line: str, mark: str) -> list[str]:
    """Return the cells of a line; CSV's quotes are understood."""
    if '"' in line:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=mark, skipinitialspace=True))]
    return line.split() if mark == " " else [cell.strip() for cell in line.split(mark)]


def mark_of(line: str) -> str:
    """Return the delimiter of a line: tab, comma, semicolon or bar, whichever it has most, else space.

    In numbers such as 3,62 between other delimiters the comma is none.
    """
    for mark in "\t;| " if "," in line else "":
        cells = cells_of(line, mark)
        if len(cells) > 1 and all("," not in cell or number(cell) is not None for cell in cells):
            return mark
    return max("\t,;|", key=line.count) if any(mark in line for mark in "\t,;|") else " "


def _readings(line: Line, mark: str) -> list[tuple[Line, list[str]]]:
    """Return the names that a head may hold, by the rows' delimiter or by its own, first without a sign before them.

    A sign that stands alone may be a name: a column of numbers is often called #.
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


def _has_numbers(cells: list[str], is_row: Callable[[list[str]], bool]) -> bool:
    return _all_numbers(cells) or is_row(cells)


def layout_of(
    lines: list[Line], delimiter: str, header: str, columns: Sequence[str | int], is_row: Callable[[list[str]], bool]
) -> Layout:
    """Find the head of a table: the line that has the columns asked for, and as many as the rows have.

    Candidates are the lines above the first one with numbers, and the comments above them, from below; then the first
    lines that follow, if one has all columns: Vicon's tables have a rate above their head.

    Args:
        lines: number and text of the lines that are not empty.
        delimiter: the map's word for it.
        header: auto, yes or no.
        columns: those asked for, by name or number.
        is_row: whether cells have numbers where columns are asked for by number.
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
    lead = list(takewhile(lambda row: not _has_numbers(cells_of(row[1], mark), is_row), rows))
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
