"""One use of a live topic: the fields of its messages that are read, and the rows that wait for release."""

from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np

from ortilo_drake.interop.recorded.columns import UNITS, Stream
from ortilo_drake.interop.recorded.message_fields import field_of, numbers_of, stamp_of
from ortilo_drake.interop.recorded.rejected import HOUR, Rejections
from ortilo_drake.interop.recorded.sources import Column, Source
from ortilo_drake.interop.recorded.units import size_of

MOST: Final = 1_000_000  # most rows that wait; beyond it the oldest half is dropped
YOUNG, BELIEVED = 10, 3  # rows within which a stream's clock may still be set, and after which its stamps are believed
PIECE, PIECES = 1.0, (5, 200)  # a piece of time, with its least delay [s]; least and most pieces that tell a drift
DRIFTS, LINEAR = 3e-4, 0.1  # least slope of the delay that is a drift; largest deviation from a line, over the change
TOO_LATE: Final = "rows that came too late"
FAR: Final = "rows with a stamp more than an hour from the others"


class _Waiting(NamedTuple):
    t: float
    message: int
    numbers: list[float]
    names: tuple[str, ...]


@dataclass
class LiveStream:
    """One use of a topic."""

    topic: str
    """name of the topic."""
    source: Source
    """entry of the map."""
    columns: tuple[Column, ...]
    """fields with numbers."""
    width: int
    """number of numbers in a message."""
    names: tuple[Column, ...]
    """fields that name anchors; rows of a stream with such fields need not come in the order of their stamps."""
    rejected: Rejections
    """counts of rows that were not used."""
    rows: list[_Waiting] = field(default_factory=list)
    """rows that wait for release."""
    newest: float = -np.inf
    """largest accepted stamp [s], -inf before the first."""
    messages: int = 0
    """number of messages received."""
    used: int = 0
    """number of messages whose stamp was accepted."""
    delays: list[list[float]] = field(default_factory=list)
    """first stamp and least delay from stamp to receipt [s], for each piece of time."""
    dropped: int = 0
    """number of messages dropped since the last one whose stamp was accepted."""
    late_by: float = 0.0
    """largest lateness of the rows that came too late [s]."""

    @property
    def settled(self) -> bool:
        """True once enough rows have arrived to believe their stamps, even where the stamps of other topics differ."""
        return self.used >= BELIEVED

    def drop(self, reason: str) -> None:
        """Count a row that is not used, with the reason."""
        self.rejected.add(reason, f"in message {self.messages}")
        self.dropped += 1

    def add(self, received: int, message: Any, given: float) -> str:
        """Take a message and its time of receipt [ns]; return a problem that all such messages have, else empty text.

        Rows before the stamp `given` [s] have been released.
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
            t *= size_of(self.source.unit, UNITS)
        self._add_delay(t, 1e-9 * received - t)
        reason = self._why_not(t, given)
        if reason:
            self.drop(reason)
            return ""
        self.newest, self.used, self.dropped = max(self.newest, t), self.used + 1, 0
        self.rows.append(_Waiting(t - self.source.late, self.messages, numbers, names))
        if len(self.rows) > MOST:
            self.rejected.add(
                "rows that waited too long for the filter's start", f"in message {self.messages}", MOST // 2
            )
            del self.rows[: MOST // 2]
        return ""

    @property
    def drift(self) -> float:
        """The rate at which the stamps' clock gains on the clock of receipts [1]; 0 where delays follow no line."""
        if len(self.delays) < PIECES[0]:
            return 0.0
        t, delay = np.transpose(self.delays)
        slope, first = np.polyfit(t - t[0], delay, 1)
        off = np.std(delay - first - slope * (t - t[0]))
        return -float(slope) if abs(slope) > DRIFTS and off < LINEAR * abs(slope) * (t[-1] - t[0]) else 0.0

    def _add_delay(self, t: float, delay: float) -> None:
        if not np.isfinite(delay):
            return
        if not self.delays or not 0.0 <= t - self.delays[-1][0] < PIECE:
            self.delays = [*self.delays[1 - PIECES[1] :], [t, delay]]
        self.delays[-1][1] = min(self.delays[-1][1], delay)

    def _why_not(self, t: float, given: float) -> str:
        """Return the reason why a stamp [s] cannot be used, in the words of the file readers; empty if it can be."""
        if not np.isfinite(t):
            return "rows without a stamp"
        if np.isfinite(self.newest) and abs(t - self.newest) > HOUR:
            if self.used >= YOUNG:
                return FAR
            self.rejected.add(FAR, "in message 1", self.used)  # the clock was not set before: the new stamp counts
            self.rows, self.newest, self.used = [], -np.inf, 0
        if not self.names and t == self.newest:
            return "duplicate stamps"
        if not self.names and t < self.newest:
            return "backward stamps"
        late = given - (t - self.source.late)
        if late <= 0.0:
            return ""
        self.late_by = max(self.late_by, late)
        return TOO_LATE

    def until(self, stamp: float) -> Stream:
        """Return the waiting rows before a stamp [s] in the order of stamps, and remove them from the waiting rows."""
        early = [row for row in self.rows if row.t < stamp]
        if early:
            self.rows = [row for row in self.rows if row.t >= stamp]
        if self.names:
            early.sort(key=lambda row: row.t)
        values = np.array([row.numbers for row in early]).reshape(len(early), self.width)
        names = np.array([row.names for row in early], dtype=object).reshape(len(early), len(self.names))
        rows = np.array([row.message for row in early], dtype=np.int64)
        return Stream(np.array([row.t for row in early]), values, names, rows, self.rejected, ())
