"""Timing of the ticks of a flight in real time: latencies, deadlines, jitter."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Quantiles:
    """Median, 99th percentile and maximum of some values; all None if there are no values."""

    median: float | None = None
    p99: float | None = None
    max: float | None = None


@dataclass(frozen=True)
class TimingFigures:
    """The timing figures of the ticks of a flight in real time."""

    ticks: int
    """number of ticks sent."""
    latency_ms: Quantiles
    """time from sending a tick's messages to receiving its command [ms]."""
    missed_deadlines: int
    """number of ticks without a command by the time at which the next tick was due; ticks sent late count as well."""
    unanswered: int
    """number of ticks without a command."""
    longest_silence: float
    """longest run of ticks without a command [s]."""
    lateness_ms: float
    """largest delay of a command beyond its deadline [ms]."""
    jitter_ms: Quantiles
    """delay with which the world sent its ticks [ms]."""
    real_time_factor: float | None
    """simulated over wall time [1]; None for less than two ticks."""


def quantiles(values: np.ndarray) -> Quantiles:
    """Return median, 99th percentile and maximum of values (n)."""
    if not len(values):
        return Quantiles()
    return Quantiles(float(np.median(values)), float(np.quantile(values, 0.99)), float(np.max(values)))


class TickTiming:
    """The world's record of its ticks of h [s] and of the commands that answered them; times of time.perf_counter()."""

    def __init__(self, h: float):
        self._h = h
        self._due: list[float] = []
        self._sent: list[float] = []
        self._answered: dict[int, float] = {}

    def sent(self, due: float, now: float) -> None:
        """Note that the next tick was due at the time `due` and sent at the time `now` [s]."""
        self._due.append(due)
        self._sent.append(now)

    def answered(self, tick: int, now: float) -> None:
        """Note the time of a tick's first command [s]; a command of a tick that was not sent is ignored."""
        if tick < len(self._sent):
            self._answered.setdefault(tick, now)

    def latencies_ms(self, ticks: int | None = None) -> np.ndarray:
        """Return the latency [ms], messages sent to command received, of each answered tick among the first `ticks`."""
        return self._after(self._sent, ticks)

    def _after(self, times: list[float], ticks: int | None) -> np.ndarray:
        answered = sorted(self._answered.items())
        return np.array([1e3 * (now - times[k]) for k, now in answered if ticks is None or k < ticks])

    def summary(self, ticks: int | None = None) -> TimingFigures:
        """Return the figures of the first `ticks` ticks, all by default.

        In flight leave out the present tick, which is not answered yet. Another thread may call this method in flight.
        """
        ticks = len(self._sent) if ticks is None else ticks
        latencies, beyond = self.latencies_ms(ticks), self._after(self._due, ticks) - 1e3 * self._h
        sent, due = np.array(self._sent[:ticks]), np.array(self._due[:ticks])
        simulated = (ticks - 1) * self._h
        return TimingFigures(
            ticks=ticks,
            latency_ms=quantiles(latencies),
            missed_deadlines=int(np.sum(beyond > 0.0)) + ticks - len(latencies),
            unanswered=ticks - len(latencies),
            longest_silence=self._h * int(np.max(np.diff([-1, *sorted(self._answered), ticks])) - 1),
            lateness_ms=float(np.max(beyond, initial=0.0)),
            jitter_ms=quantiles(1e3 * (sent - due)),
            real_time_factor=simulated / float(sent[-1] - sent[0]) if ticks > 1 else None,
        )
