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
    """number of ticks."""
    packets: PacketCounts
    """counts of the commands."""
    timing: TimingFigures | None = None
    """timing of the ticks in real time; None in lockstep."""
    latencies_ms: np.ndarray | None = None
    """latency of every answered tick in real time [ms]; None in lockstep."""
    pictures_skipped: int | None = None
    """number of pictures that the camera's process skipped; None without such a process."""

    def lines(self) -> dict[str, Any]:
        """Return the figures, as the commands print them and write them as JSON."""
        figures = {"ticks": self.ticks} | (as_data(self.timing) if self.timing else {})
        return figures | _skipped(self.pictures_skipped) | _packets(self.packets)


@dataclass(frozen=True)
class OnboardFigures:
    """The figures of an onboard half in real time."""

    silent_at: int | None
    """the tick at which the world fell silent without saying that it had finished; None if it did not fall silent."""
    age_in_ticks: dict[str, int]
    """number of messages used, by their age [ticks]."""
    overtaken: int
    """number of messages not used because a newer one had come."""


@dataclass(frozen=True)
class OnboardReport:
    """The report of an onboard half on its flight."""

    ticks: int
    """number of ticks."""
    packets: PacketCounts
    """counts of the world's packets `tick`."""
    real_time: OnboardFigures | None = None
    """figures of the flight in real time; None in lockstep."""
    pictures_skipped: int | None = None
    """number of pictures that the detector's thread skipped; None without such a thread."""

    def lines(self) -> dict[str, Any]:
        """Return the figures, as the command prints them and writes them as JSON."""
        figures = {"ticks": self.ticks} | (as_data(self.real_time) if self.real_time else {})
        return figures | _skipped(self.pictures_skipped) | _packets(self.packets)


def _skipped(pictures: int | None) -> dict[str, Any]:
    return {} if pictures is None else {"pictures_skipped": pictures}


def _packets(counts: PacketCounts) -> dict[str, Any]:
    return {"packets": as_data(counts), "rejected": counts.rejected}
