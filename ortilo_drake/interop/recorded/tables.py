"""What every reader returns: the rows of one file, as numbers, each with its place."""

from datetime import UTC, datetime, time
from typing import NamedTuple

import numpy as np

EMPTY = ("", "nan", "na", "null", "none", "-")  # cells without a number


class Table(NamedTuple):
    """Rows of a file.

    t: stamps, the file's unit (n); values: (n, m), NaN where a row has none; names: what each row calls its anchor (n),
    None if it does not; rows: number of the line or message (n), from 1.
    """

    t: np.ndarray
    values: np.ndarray
    names: np.ndarray | None
    rows: np.ndarray


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
