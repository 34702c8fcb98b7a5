"""Reports of the two halves on a flight."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ortilo_drake.hil.real_time.tick_timing import TimingFigures
from ortilo_drake.hil.wire.inbox import PacketCounts
from ortilo_drake.model.as_data import as_data


@dataclass(frozen=True)
class WorldReport:
    """The report of a world on its flight."""

    ticks: int
    """how many."""
    packets: PacketCounts
    """the commands."""
    timing: TimingFigures | None = None
    """of the ticks in real time; None in lockstep."""
    latencies_ms: np.ndarray | None = None
    """of every answered tick in real time [ms]; None in lockstep."""
    pictures_skipped: int | None = None
    """by a camera's process; None without one."""

    def lines(self) -> dict[str, Any]:
        """Return the figures, as the commands print them and write them as JSON."""
        figures = {"ticks": self.ticks} | (as_data(self.timing) if self.timing else {})
        return figures | _skipped(self.pictures_skipped) | _packets(self.packets)


@dataclass(frozen=True)
class OnboardFigures:
    """The figures of an onboard half in real time."""

    silent_at: int | None
    """the tick at which the world fell silent before it said that it has finished; None if it did not."""
    age_in_ticks: dict[str, int]
    """how many messages were used at what age [ticks]."""
    overtaken: int
    """messages not used, as a newer one had come."""


@dataclass(frozen=True)
class OnboardReport:
    """The report of an onboard half on its flight."""

    ticks: int
    """how many."""
    packets: PacketCounts
    """the world's ticks."""
    real_time: OnboardFigures | None = None
    """None in lockstep."""
    pictures_skipped: int | None = None
    """by a detector's thread; None without one."""

    def lines(self) -> dict[str, Any]:
        """Return the figures, as the command prints them and writes them as JSON."""
        figures = {"ticks": self.ticks} | (as_data(self.real_time) if self.real_time else {})
        return figures | _skipped(self.pictures_skipped) | _packets(self.packets)


def _skipped(pictures: int | None) -> dict[str, Any]:
    return {} if pictures is None else {"pictures_skipped": pictures}


def _packets(counts: PacketCounts) -> dict[str, Any]:
    return {"packets": as_data(counts), "rejected": counts.rejected}
