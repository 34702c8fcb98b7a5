"""`ortilo hil` in processes of its own, for the tests beside this file."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from command_line import Done, end, run_apart, start
from waiting import wait_for

HOVER = ("--set", "settle=0", "--set", "planner={kind: hover, duration: 4}")
PROJECTED = ("--set", "camera.kind=projected")
RENDERED = ("--set", "camera.kind=rendered", "--set", "settle=0", "--set", "planner={kind: hover, duration: 1}")
WAIT = ("--wait", "90")


def run_both(world: tuple[str, ...], onboard: tuple[str, ...], spaces: tuple[str, str] | None = None) -> list[Done]:
    """Run both halves beside each other, each in a network namespace if any; return what end does of each."""
    inside = [("ip", "netns", "exec", space) for space in spaces] if spaces else [(), ()]
    processes = [
        start("hil", half, *words, before=before)
        for half, words, before in zip(("onboard", "world"), (onboard, world), reversed(inside), strict=True)
    ]
    try:
        return [end(process) for process in reversed(processes)]
    finally:
        for process in processes:
            process.kill()


def checked(file: Path, *words: str) -> dict[str, Any]:
    """Return the report of `ortilo hil check`."""
    code, _, errors = run_apart("hil", "check", *words, "--json", str(file))
    assert code == 0, errors
    report: dict[str, Any] = json.loads(file.read_text())
    return report


def check_in_time(fly: Callable[[], dict[str, Any]], ticks: int) -> None:
    """Assert what a flight in real time keeps even where other programs take the processor.

    How many of its ticks are answered is a matter of the machine's load: it is flown again where none was.
    """

    def answered() -> dict[str, Any] | None:
        report = fly()
        assert report["ticks"] == ticks
        return report if report["unanswered"] < ticks else None

    report = wait_for(answered, "an answer in time")
    assert report
    assert report["rejected"] == 0
    assert 0.0 < report["latency_ms"]["median"] <= report["latency_ms"]["p99"] <= report["latency_ms"]["max"]
    assert 0.0 < report["real_time_factor"] < 1.05  # it cannot be faster but by the jitter of its ends
