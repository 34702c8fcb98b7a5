"""The table that every reader returns: the rows of one file as numbers, each with its place in the file."""

import re
from array import array
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from ortilo_drake.model.typed_yaml import InputError

NUMBERS: Final = 2**24  # most numbers of a stream, half an hour of IMU at 1 kHz; processing takes 60 bytes for each
LONGEST: Final = 257  # most characters of a name that are kept; names in a map have 256 at most
NAMES: Final = 10_000  # most names of anchors in a file
EMPTY = ("", "nan", "na", "n/a", "#n/a", "null", "none", "-")  # cells without a number
_COMMA = re.compile(r"[-+]?\d+,\d+(e[-+]?\d+)?", re.IGNORECASE)


class Table(NamedTuple):
    """The rows of a file.

    t: stamps in the file's unit (n); values: (n, m), NaN where a row has none; names: each row's names of anchors and
    tag (n, k), None if rows name none; rows: number of the line or message (n), from 1.
    """

    t: np.ndarray
    values: np.ndarray
    names: np.ndarray | None
    rows: np.ndarray


class Rows:
    """The rows of a file while the file is read; a number takes 8 bytes."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.width = 0
        self._t, self._values, self._order = array("d"), array("d"), array("q")
        self._rows = array("q")
        self._names: list[str] = []
        self._known: dict[str, str] = {}

    def __len__(self) -> int:
        return len(self._rows)

    def add(self, row: int, t: float, values: Sequence[float], names: Iterable[str] = (), order: int = 0) -> None:
        """Add a row with its number `row` in the file; rows are sorted by `order`, rows of equal order as added.

        InputError for more than NUMBERS numbers, or more than NAMES names of anchors.
        """
        self.width = len(values)
        if len(self._values) + len(self._rows) + self.width >= NUMBERS:
            raise InputError(f"{self.path}: more than {NUMBERS:,} numbers in its rows; cut it into several recordings")
        self._names.extend(self._known.setdefault(name[:LONGEST], name[:LONGEST]) for name in names)
        if len(self._known) > NAMES:
            raise InputError(f"{self.path}: its rows name more than {NAMES:,} anchors: wrong column?")
        self._rows.append(row)
        self._t.append(t)
        self._values.extend(values)
        self._order.append(min(order, 2**63 - 1))

    def table(self) -> Table:
        """Return all rows."""
        order = np.argsort(np.array(self._order), kind="stable")
        values = np.array(self._values).reshape(len(self), -1)[order]
        names = np.array(self._names, dtype=object).reshape(len(self), -1)[order] if self._known else None
        return Table(np.array(self._t)[order], values, names, np.array(self._rows)[order])


def number(cell: str) -> float | None:
    """Return a cell's number, NaN for an empty cell, None for any other text; 3,62 means 3.62."""
    if cell.lower() in EMPTY:
        return np.nan
    if "_" in cell:  # Python's float accepts 1_000
        return None
    try:
        return float(cell.replace(",", ".") if _COMMA.fullmatch(cell) else cell)
    except ValueError:
        return None
