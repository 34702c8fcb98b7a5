"""The table that every reader returns: the rows of one file as numbers, or a topic of a log of many."""

from array import array
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, time
from pathlib import Path
from typing import Final, NamedTuple, TypeVar

import numpy as np

from ortilo_drake.interop.recorded.sources import Column
from ortilo_drake.model.typed_yaml import InputError, nearest

NUMBERS: Final = 2**24  # of a stream: IMU at 1 kHz for half an hour; what works on them takes 60 bytes for each
LONGEST: Final = 257  # characters of a name that are kept; those in a map have 256 at most
NAMES: Final = 10_000  # of anchors that the rows of a file name
EMPTY = ("", "nan", "na", "null", "none", "-")  # cells without a number
FEWEST = 2  # rows


class Table(NamedTuple):
    """Rows of a file.

    t: stamps, the file's unit (n); values: (n, m), NaN where a row has none; names: what each row calls its anchor (n),
    None if it does not; rows: number of the line or message (n), from 1.
    """

    t: np.ndarray
    values: np.ndarray
    names: np.ndarray | None
    rows: np.ndarray


class Rows:
    """The rows of a file while it is read, 8 bytes a number."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.width = 0
        self._t, self._values, self._order = array("d"), array("d"), array("q")
        self._rows = array("q")
        self._names: list[str] = []
        self._known: dict[str, str] = {}

    def __len__(self) -> int:
        return len(self._rows)

    def add(self, row: int, t: float, values: Sequence[float], name: str | None = None, order: int = 0) -> None:
        """Add a row, with its number in the file; rows are sorted by `order`, those of one as they came.

        Raises:
            InputError: if there are more than NUMBERS, or more than NAMES of anchors.
        """
        self.width = len(values)
        if len(self._values) + len(self._rows) + self.width >= NUMBERS:
            raise InputError(f"{self.path}: more than {NUMBERS:,} numbers in its rows; cut it into several recordings")
        if name is not None:
            self._names.append(self._known.setdefault(name[:LONGEST], name[:LONGEST]))
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
        names = np.array(self._names, dtype=object)[order] if self._known else None
        return Table(np.array(self._t)[order], values, names, np.array(self._rows)[order])


def number(cell: str) -> float | None:
    """Return a cell's number, NaN if it is empty, None if it is neither."""
    if cell.lower() in EMPTY:
        return np.nan
    try:
        return float(cell)
    except ValueError:
        return None


def stamp(cell: str) -> float | None:
    """Return a stamp's number; of a date or time of day, as ISO 8601 has it, the seconds (UTC); None if it is none."""
    found = number(cell)
    if found is not None:
        return found
    try:
        moment = datetime.fromisoformat(cell)
        return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    except ValueError:
        pass
    try:
        day = time.fromisoformat(cell)
    except ValueError:
        return None
    return 3600.0 * day.hour + 60.0 * day.minute + day.second + 1e-6 * day.microsecond


Topic = TypeVar("Topic")


def topic_of(path: Path, topic: str, topics: Mapping[str, Topic]) -> Topic:
    """Return a log's topic; InputError if there is no such."""
    if topic not in topics:
        raise InputError(f"{path}: no topic '{topic}'{nearest(topic, topics)}; has {', '.join(topics) or 'none'}")
    return topics[topic]


def check_size(path: Path, topic: str, rows: int, columns: int) -> None:
    """Raise InputError if a topic has hardly a row, or more numbers than are read."""
    if rows < FEWEST:
        raise InputError(f"{path}: {topic}: {rows} rows")
    if rows * (columns + 2) > NUMBERS:
        raise InputError(f"{path}: {topic}: more than {NUMBERS:,} numbers; cut the log into several recordings")


def place_of(path: Path, topic: str, wanted: Column, fields: Sequence[str]) -> int:
    """Return the index of a field, given by name or counted from 1; InputError if there is no such field."""
    at = wanted - 1 if isinstance(wanted, int) else fields.index(wanted) if wanted in fields else -1
    if not 0 <= at < len(fields):
        raise InputError(f"{path}: {topic} has no field '{wanted}'; has {', '.join(fields)}")
    return at


def table_of(
    path: Path,
    topic: str,
    t: np.ndarray,
    fields: Sequence[str],
    values: Sequence[np.ndarray],
    columns: tuple[Column, ...],
    names: Column | None,
) -> Table:
    """Return a topic's stamps t (n), and of the values of its fields (n each) columns and anchors' names, as a table.

    Raises:
        InputError: if there is no such field.
    """
    found = [values[place_of(path, topic, one, fields)].astype(float) for one in columns]
    called = None
    if names is not None:
        its = values[place_of(path, topic, names, fields)].tolist()
        called = np.array([str(name) for name in its], dtype=object)
    return Table(t, np.column_stack(found), called, np.arange(1, len(t) + 1))
