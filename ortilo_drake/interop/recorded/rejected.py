"""Rows that cannot be used because of their stamps or, in a truth, their positions; all are counted and reported."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ortilo_drake.model.typed_yaml import InputError

GAP = 5.0  # an interval longer than this many medians is called a gap
RESTARTS, FEWEST = 5, 20  # most restarts of a clock, and least rows between two of them
HOUR, TOGETHER = 3600.0, 0.9  # [s]; least share of rows whose stamps lie together
LEAP = (1.0, 10.0)  # least leap of a lone position: this length [m] plus this number of usual steps


@dataclass
class Rejections:
    """Counts of rejected rows by reason, the first place of each, and notes about rows that were kept."""

    source: str
    counts: dict[str, int] = field(default_factory=dict)
    first: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    word: str = "line"  # the word for a row of this file

    def add(self, reason: str, place: str, count: int = 1) -> None:
        """Count rejections for one reason, with the first place."""
        if count:
            self.counts[reason] = self.counts.get(reason, 0) + count
            self.first.setdefault(reason, place)

    def add_rows(self, reason: str, which: np.ndarray, rows: np.ndarray, names: np.ndarray | None = None) -> None:
        """Count the rows in the mask `which` (n) as rejected; the report gives number (n) and name (n) of the first."""
        if which.any():
            first = int(np.argmax(which))
            called = "" if names is None else f" ('{names[first]}')"
            self.add(reason, f"in {self.word} {rows[first]}{called}", int(which.sum()))

    def lines(self) -> list[str]:
        """Return a line for each reason."""
        return [f"{self.source}: {n} {reason}{self._place(reason)}" for reason, n in self.counts.items()]

    def most(self) -> str:
        """Return the line of the most frequent reason; empty if nothing was rejected."""
        reason = max(self.counts, key=lambda reason: self.counts[reason], default="")
        return f"{self.counts[reason]} {reason}{self._place(reason)}" if reason else ""

    def _place(self, reason: str) -> str:
        return f", first {self.first[reason]}" if self.first[reason] else ""


def lines_of_all(parts: Sequence[Rejections]) -> list[str]:
    """Return the lines of all sources: reasons first, then notes; a note shared by several sources is one line."""
    sharing: dict[str, list[str]] = {}
    for part in parts:
        for note in part.notes:
            sharing.setdefault(note, []).append(part.source)
    found = [line for part in parts for line in part.lines()]
    return found + [
        f"{one}{f' and {len(others)} more' if others else ''}: {note}" for note, (one, *others) in sharing.items()
    ]


def kept_in_order(
    stamps: np.ndarray, rows: np.ndarray, rejected: Rejections, names: np.ndarray | None = None
) -> np.ndarray:
    """Return the indices of the rows to keep, in order; their stamps [s] are finite, near the others and rising.

    The other rows are counted as rejected. `stamps` (n) have the file's order; `rows` (n) are the numbers of lines or
    messages for the report. If rows name anchors (`names`), they are sorted by their stamps and may share a stamp.
    Otherwise a late row is kept only where it fills a gap. InputError if fewer than half of the rows would be kept.
    """
    finite = np.isfinite(stamps)
    rejected.add_rows("rows without a stamp", ~finite, rows)
    far = finite.copy()
    far[finite] = _far_away(stamps[finite])
    rejected.add_rows("rows with a stamp more than an hour from the others", far, rows)
    good = finite & ~far
    before = np.maximum.accumulate(np.concatenate(([-np.inf], np.where(good, stamps, -np.inf))))[:-1]
    backward = good & (stamps < before)
    late = backward & _fills_a_gap(stamps, good) if names is None else backward
    if late.any():
        first = f"in {rejected.word} {rows[np.argmax(late)]}"
        rejected.notes.append(f"{late.sum()} rows out of order, first {first}; sorted by their stamps")
    if names is None:
        same = good & (stamps == before)
        rejected.add_rows("duplicate stamps", same, rows)
        rejected.add_rows("backward stamps", backward & ~late, rows)
        good = good & ~same & (late | ~backward)
    keep = np.flatnonzero(good)
    keep = keep[np.argsort(stamps[keep], kind="stable")]
    if len(keep) < max(2, len(stamps) / 2):
        said = f"{len(keep)} of {len(stamps)} stamps are finite and rise: wrong column?"
        raise InputError(f"{rejected.source}: {said} ({rejected.most()})")
    steps = np.diff(np.unique(stamps[keep]))
    if not len(steps):
        raise InputError(f"{rejected.source}: all rows have one stamp")
    usual = np.median(steps)
    if names is not None:  # anchors are often heard in quick succession, so use the time to the same anchor's next row
        apart = min(len(np.unique(names)), len(keep) - 1)
        usual = max(usual, np.median(stamps[keep][apart:] - stamps[keep][:-apart]))
    gaps = steps > GAP * usual
    if gaps.any():
        rejected.notes.append(
            f"{gaps.sum()} gap{'s' * bool(gaps.sum() > 1)} between stamps, the longest {steps.max():.4g} s (kept)"
        )
    return keep


def _fills_a_gap(stamps: np.ndarray, good: np.ndarray) -> np.ndarray:
    """Return a mask (n) of the stamps [s] that are more than half a usual interval from both neighbours in time.

    A late row fills such a gap. A row whose clock stepped back, or that came twice, does not.
    """
    fills, which = np.zeros(len(stamps), dtype=bool), np.flatnonzero(good)
    if len(which) > 1:
        order = which[np.argsort(stamps[which], kind="stable")]
        steps = np.diff(stamps[order])
        apart = np.minimum(np.append(np.inf, steps), np.append(steps, np.inf))
        fills[order] = apart > 0.5 * np.median(steps)
    return fills


def began_anew(stamps: np.ndarray, names: np.ndarray | None) -> int | None:
    """Return the first row of a clock that restarted and shows the same times again; None if it did not restart.

    The stamps (n) have the file's order. If rows name anchors (n), the stamps of the most frequent anchor decide.
    """
    rows = np.flatnonzero(np.isfinite(stamps))
    if names is not None and len(rows):
        called, first = np.unique(names[rows].astype(str), return_inverse=True)
        rows = rows[first == np.argmax(np.bincount(first, minlength=len(called)))]
    t = stamps[rows]
    backs = np.flatnonzero(np.diff(t) < 0.0) + 1
    if not 0 < len(backs) <= RESTARTS:
        return None
    parts = np.split(t, backs)
    for before, after, back in zip(parts, parts[1:], backs, strict=False):
        shorter = min(np.ptp(before), np.ptp(after))
        common = min(before[-1], after[-1]) - max(before[0], after[0])
        if min(len(before), len(after)) >= FEWEST and shorter > 0.0 and common > 0.5 * shorter:
            return int(rows[back])
    return None


def _far_away(stamps: np.ndarray) -> np.ndarray:
    """Return a mask (n) of the finite stamps [s] more than an hour away from a group of nine tenths of all, if any.

    The cause is a clock that was not set yet, or a damaged number. If kept, the stamp would stretch the recording.
    """
    if not len(stamps):
        return np.zeros(0, dtype=bool)
    order = np.argsort(stamps, kind="stable")
    group = np.empty(len(stamps), dtype=np.int64)
    group[order] = np.concatenate(([0], np.cumsum(np.diff(stamps[order]) > HOUR)))
    sizes = np.bincount(group)
    if sizes.max() < TOGETHER * len(stamps):
        return np.zeros(len(stamps), dtype=bool)
    return np.asarray(group != np.argmax(sizes))


def frozen_rows(t: np.ndarray, p: np.ndarray, longest: float) -> np.ndarray:
    """Return a mask (n) of rows that repeat the position p (n, 3) before them, where it lasts over `longest` [s]."""
    new = np.concatenate(([True], (np.diff(p, axis=0) != 0.0).any(axis=1)))
    starts, run = np.flatnonzero(new), np.cumsum(new) - 1
    lasts = np.maximum.reduceat(t, starts) - t[starts]
    return np.asarray(~new & (lasts > longest)[run])


def leaping_rows(p: np.ndarray) -> np.ndarray:
    """Return a mask (n) of the rows whose position (n, 3) is far from both neighbours, which are near each other.

    LEAP says what is far.
    """
    steps = np.linalg.norm(np.diff(p, axis=0), axis=1)
    beside = np.linalg.norm(p[2:] - p[:-2], axis=1)
    least = np.minimum(steps[:-1], steps[1:])
    far = (least > LEAP[0] + LEAP[1] * np.median(steps)) & (beside < 0.5 * least)
    return np.concatenate(([False], far, [False]))
