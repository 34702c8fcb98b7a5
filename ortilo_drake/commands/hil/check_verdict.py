"""The verdict on a flight of both halves, in a sentence."""

from collections.abc import Mapping
from typing import Any


def check_verdict(report: Mapping[str, Any], h: float) -> str:
    """Return the verdict of `ortilo hil check`, for a reader who has not seen the figures yet.

    Args:
        report: what the command writes as JSON; 'identical' is None of a flight in real time.
        h: a tick [s].
    """
    lost, ticks = report["lost"], report["ticks"]
    end = f"lost at {lost['time']:.1f} s: {lost['cause']}" if lost else f"flew {(ticks - 1) * h:.1f} s, not lost"
    if report["identical"] is not None:
        same = "bit for bit" if report["identical"] else "NOT the same"
        return f"{end}; in lockstep its {ticks} ticks are {same} as in a single process"
    latency = report["latency_ms"]
    if latency["median"] is None:
        return f"{end}; none of {ticks} ticks was answered"
    return (
        f"{end}; commands came after {latency['median']:.2g} ms (99 % within {latency['p99']:.2g}) of a tick's "
        f"{1e3 * h:.3g}, and {report['missed_deadlines']} of {ticks} ticks missed their deadline"
    )
