"""Timing of the ticks of a flight in real time: latencies, deadlines, jitter."""

from typing import Any

import numpy as np


def quantiles(values: np.ndarray) -> dict[str, float | None]:
    """Return median, p99 and max, each None of no values."""
    if not len(values):
        return {"median": None, "p99": None, "max": None}
    return {
        "median": float(np.median(values)),
        "p99": float(np.quantile(values, 0.99)),
        "max": float(np.max(values)),
    }


class TickTiming:
    """The world's record of its ticks and of the commands that answered them; times are time.perf_counter() [s].

    Args:
        h: tick [s].
    """

    def __init__(self, h: float):
        self._h = h
        self._due: list[float] = []
        self._sent: list[float] = []
        self._answered: dict[int, float] = {}

    def sent(self, due: float, now: float) -> None:
        """Note that the next tick, due at a time, was sent at a time."""
        self._due.append(due)
        self._sent.append(now)

    def answered(self, tick: int, now: float) -> None:
        """Note when the first command of a tick came; one of a tick that was not sent is ignored."""
        if tick < len(self._sent):
            self._answered.setdefault(tick, now)

    def latencies_ms(self, ticks: int | None = None) -> np.ndarray:
        """Return the latency of every answered tick, from its messages sent to its command received [ms].

        Args:
            ticks: how many of the first ticks to look at; all by default.
        """
        return self._after(self._sent, ticks)

    def _after(self, times: list[float], ticks: int | None) -> np.ndarray:
        answered = sorted(self._answered.items())
        return np.array([1e3 * (now - times[k]) for k, now in answered if ticks is None or k < ticks])

    def summary(self, ticks: int | None = None) -> dict[str, Any]:
        """Return the figures as plain data, for JSON.

        A tick misses its deadline if its command is not there when the next tick is due; a tick that the world sent
        late counts too. lateness_ms is how far the worst was beyond its deadline. longest_silence is the longest run
        of ticks without an answer [s]. jitter_ms is how late the world sent its ticks.

        Args:
            ticks: how many of the first ticks to look at; all by default. In flight leave out the present one, which is
                not answered yet. (Another thread may call this while the flight goes on.)
        """
        ticks = len(self._sent) if ticks is None else ticks
        latencies, beyond = self.latencies_ms(ticks), self._after(self._due, ticks) - 1e3 * self._h
        sent, due = np.array(self._sent[:ticks]), np.array(self._due[:ticks])
        simulated = (ticks - 1) * self._h
        return {
            "ticks": ticks,
            "latency_ms": quantiles(latencies),
            "missed_deadlines": int(np.sum(beyond > 0.0)) + ticks - len(latencies),
            "unanswered": ticks - len(latencies),
            "longest_silence": self._h * int(np.max(np.diff([-1, *sorted(self._answered), ticks])) - 1),
            "lateness_ms": float(np.max(beyond, initial=0.0)),
            "jitter_ms": quantiles(1e3 * (sent - due)),
            "real_time_factor": simulated / float(sent[-1] - sent[0]) if ticks > 1 else None,
        }
