"""One use of a live topic: which fields of its messages are read, and the rows that wait for their turn."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from ortilo_drake.interop.recorded.columns import UNITS
from ortilo_drake.interop.recorded.message_fields import field_of, numbers_of, stamp_of
from ortilo_drake.interop.recorded.recording import LARGEST
from ortilo_drake.interop.recorded.rejected import HOUR, Rejections
from ortilo_drake.interop.recorded.sources import Column, Source

MOST: Final = 1_000_000  # rows that wait; the oldest go
YOUNG, BELIEVED = 10, 3  # a stream's clock may still be set, and its stamps are believed, after so many rows
FAR: Final = "rows with a stamp more than an hour from the others"
INCOMPLETE: Final = "rows with NaN, infinity or an empty cell"

Row = tuple[float, ...]


@dataclass
class LiveStream:
    """A use of a topic.

    Attributes:
        topic: its name.
        source: the map's entry.
        columns: fields with numbers.
        names: fields that name anchors; rows of such streams need not come in the order of their stamps.
        width: how many numbers a message has.
        rows_of: from numbers and names of a message to rows without their stamp; a text says why there is none.
        rejected: what was not used.
        rows: those that wait, a stamp [s] before each.
        newest: largest stamp that was accepted [s], -inf before the first.
        messages: how many came.
        used: how many of them had a stamp that was accepted.
    """

    topic: str
    source: Source
    columns: tuple[Column, ...]
    names: tuple[Column, ...]
    width: int
    rows_of: Callable[[list[float], tuple[str, ...]], Iterable[Row | str]]
    rejected: Rejections
    rows: list[Row] = field(default_factory=list)
    newest: float = -np.inf
    messages: int = 0
    used: int = 0

    @property
    def settled(self) -> bool:
        """True once enough has arrived for its stamps to be believed where other topics' differ."""
        return self.used >= BELIEVED

    def drop(self, reason: str) -> None:
        """Count a row that is not used."""
        self.rejected.add(reason, f"in message {self.messages}")

    def add(self, received: int, message: Any, given: float) -> str:
        """Take a message; return the problem that all such messages have, empty if there is none.

        Args:
            received: when it came [ns]; its stamp if it has none.
            message: with attributes as the map names them.
            given: rows before this stamp have been given out [s].
        """
        self.messages += 1
        try:
            numbers = numbers_of(message, self.columns)
            t = stamp_of(message, received, self.source.time)
            names = tuple(str(field_of(message, str(column))) for column in self.names)
        except LookupError as error:
            self.drop("messages without a field asked for")
            return f"{type(message).__name__} has no field '{error.args[0]}'"
        except (TypeError, ValueError, OverflowError):
            self.drop("messages whose field is no number")
            return f"a field of {list(self.columns)} is no number"
        if len(numbers) != self.width:
            self.drop(f"messages without {self.width} values")
            return f"{len(numbers)} values in a message, not {self.width}"
        if self.source.time is not None:
            t *= UNITS[self.source.unit]
        reason = self._why_not(t, given)
        if reason:
            self.drop(reason)
            return ""
        self.newest, self.used = max(self.newest, t), self.used + 1
        for row in self.rows_of(numbers, names):
            if isinstance(row, str):
                self.drop(row)
            else:
                self.rows.append((t - self.source.late, *row))
        if len(self.rows) > MOST:
            self.rejected.add(
                "rows that waited too long for the filter's start", f"in message {self.messages}", MOST // 2
            )
            del self.rows[: MOST // 2]
        return ""

    def _why_not(self, t: float, given: float) -> str:
        """Return the reason why a stamp [s] cannot be used, in the words of the file readers; empty if it can."""
        if not np.isfinite(t):
            return "rows without a stamp"
        if np.isfinite(self.newest) and abs(t - self.newest) > HOUR:
            if self.used >= YOUNG:
                return FAR
            self.rejected.add(FAR, "in message 1", self.used)  # a clock that was not set yet: the new stamp counts
            self.rows, self.newest, self.used = [], -np.inf, 0
        if not self.names and t == self.newest:
            return "duplicate stamps"
        if not self.names and t < self.newest:
            return "backward stamps"
        return "rows that came too late" if t - self.source.late < given else ""

    def until(self, stamp: float, width: int) -> np.ndarray:
        """Return the waiting rows before a stamp [s], (n, width) in its order; they wait no more."""
        early = [row for row in self.rows if row[0] < stamp]
        if not early:
            return np.zeros((0, width))
        self.rows = [row for row in self.rows if row[0] >= stamp]
        found = np.array(early)
        return found[np.argsort(found[:, 0], kind="stable")] if self.names else found


def complete(numbers: list[float], vectors: int) -> str:
    """Return the reason why a row cannot be used; its first numbers are vectors, whose squares must be finite."""
    if not np.isfinite(numbers).all():
        return INCOMPLETE
    return f"rows with a number beyond {LARGEST:g}" if max(map(abs, numbers[:vectors])) > LARGEST else ""
