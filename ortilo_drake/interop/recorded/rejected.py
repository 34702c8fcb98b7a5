"""What a reader could not use: counted with its reason, never dropped in silence."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ortilo_drake.model.typed_yaml import InputError

GAP = 5.0  # an interval longer than this many medians is called a gap


@dataclass
class Rejections:
    """Counts of rejected rows by reason, the first place of each, and notes about what was kept."""

    source: str
    counts: dict[str, int] = field(default_factory=dict)
    first: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def add(self, reason: str, place: str, count: int = 1) -> None:
        """Count rejections of one reason."""
        if count:
            self.counts[reason] = self.counts.get(reason, 0) + count
            self.first.setdefault(reason, place)

    def lines(self) -> list[str]:
        """Return a line for each reason and note."""
        found = [f"{self.source}: {n} {reason}{self._place(reason)}" for reason, n in self.counts.items()]
        return found + [f"{self.source}: {note}" for note in self.notes]

    def _place(self, reason: str) -> str:
        return f", first {self.first[reason]}" if self.first[reason] else ""


def kept_in_order(stamps: np.ndarray, rejected: Rejections, repeats: bool = False) -> np.ndarray:
    """Return which stamps [s] to keep: finite and later than all before; the rest is counted.

    Args:
        stamps: as they stand in the file.
        rejected: where to count.
        repeats: whether rows may share a stamp, as those of one range do.

    Raises:
        InputError: if more than half would go, as after a clock that jumps far ahead once.
    """
    finite = np.isfinite(stamps)
    rejected.add("rows without a stamp", _place(~finite), int(np.sum(~finite)))
    before = np.maximum.accumulate(np.concatenate(([-np.inf], np.where(finite, stamps, -np.inf))))[:-1]
    same, backward = finite & (stamps == before) & (not repeats), finite & (stamps < before)
    rejected.add("duplicate stamps", _place(same), int(same.sum()))
    rejected.add("backward stamps", _place(backward), int(backward.sum()))
    keep = finite & ~same & ~backward
    if keep.sum() < max(2, len(stamps) / 2):
        raise InputError(f"{rejected.source}: {keep.sum()} of {len(stamps)} stamps are finite and rise: wrong column?")
    steps = np.diff(np.unique(stamps[keep]))
    if not len(steps):
        raise InputError(f"{rejected.source}: all rows have one stamp")
    gaps = steps > GAP * np.median(steps)
    if gaps.any():
        rejected.notes.append(f"{gaps.sum()} gaps between stamps, the longest {steps.max():.4g} s (kept)")
    return keep


def _place(where: np.ndarray) -> str:
    return f"in row {np.argmax(where) + 1}" if where.any() else ""


def named(path: Path, what: str) -> str:
    """Return what to call a file's part in a line."""
    return f"{path.name} ({what})"
