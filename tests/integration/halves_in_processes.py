"""`ortilo hil` in processes of its own, for the tests beside this file. Each test has a port of its own."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

HOVER = ("--set", "settle=0", "--set", "planner={kind: hover, duration: 4}")
PROJECTED = ("--set", "camera=projected")
RENDERED = ("--set", "camera=rendered", "--set", "settle=0", "--set", "planner={kind: hover, duration: 1}")
ORTILO = (sys.executable, "-m", "ortilo_drake.cli")
WAIT = ("--wait", "90")


def bus(port: int, ttl: int = 0) -> tuple[str, str]:
    return "--url", f"udpm://239.255.76.67:{port}?ttl={ttl}"


def start(*words: str, before: tuple[str, ...] = ()) -> "subprocess.Popen[str]":
    """Start `ortilo` in a process of its own, in front of it a command that runs it elsewhere."""
    return subprocess.Popen(
        [*before, *ORTILO, *words],
        env=os.environ | {"COLUMNS": "200", "TERM": "dumb"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def end(process: "subprocess.Popen[str]") -> tuple[int, str, str]:
    """Wait for it; return its exit code and what it said on stdout and stderr."""
    try:
        said, errors = process.communicate(timeout=240)
    finally:
        process.kill()
    return process.returncode, said, errors


def run(*words: str) -> tuple[int, str, str]:
    return end(start(*words))


def run_both(world: tuple[str, ...], onboard: tuple[str, ...], spaces: tuple[str, str] | None = None) -> list[Any]:
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
    code, _, errors = run("hil", "check", *words, "--json", str(file))
    assert code == 0, errors
    report: dict[str, Any] = json.loads(file.read_text())
    return report


def check_in_time(report: dict[str, Any], ticks: int) -> None:
    """Assert what a flight in real time keeps even where other programs take the processor."""
    assert report["ticks"] == ticks
    assert report["unanswered"] < ticks  # how many is a matter of the machine's load
    assert report["rejected"] == 0
    assert 0.0 < report["latency_ms"]["median"] <= report["latency_ms"]["p99"] <= report["latency_ms"]["max"]
    assert 0.5 < report["real_time_factor"] < 1.05  # it cannot be faster but by the jitter of its ends
