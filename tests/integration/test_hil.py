"""`ortilo hil` and `ortilo replay` as a user has them: the two halves in two processes, and in two networks.

Wall time is never tested, but within bounds that a loaded machine keeps. Each test has a port of its own.
"""

import contextlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from ortilo_drake.hil.transport import MEND

HOVER = ("--set", "settle=0", "--set", "planner={kind: hover, duration: 4}")
PROJECTED = ("--set", "camera=projected")
RENDERED = ("--set", "camera=rendered", "--set", "settle=0", "--set", "planner={kind: hover, duration: 1}")
ORTILO = (sys.executable, "-m", "ortilo_drake.cli")
WAIT = ("--wait", "20")


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
        said, errors = process.communicate(timeout=90)
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
    assert report["unanswered"] <= 0.1 * ticks
    assert report["rejected"] == 0
    assert 0.0 < report["latency_ms"]["median"] <= report["latency_ms"]["p99"] <= report["latency_ms"]["max"]
    assert 0.5 < report["real_time_factor"] < 1.05  # it cannot be faster but by the jitter of its ends


# --- one machine ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("words", "port"), [(("imu_uwb", *HOVER), 7711), (("imu_uwb_yolo", *HOVER, *PROJECTED), 7712)])
def test_lockstep_is_the_flight_of_a_single_process(tmp_path: Path, words: tuple[str, ...], port: int) -> None:
    report = checked(tmp_path / "report.json", *words, "--lockstep", *bus(port))
    assert report["identical"] is True
    assert report["ticks"] == 121
    assert report["rejected"] == 0


@pytest.mark.egl
def test_lockstep_is_the_flight_of_a_single_process_with_pictures(tmp_path: Path) -> None:
    report = checked(tmp_path / "report.json", "imu_uwb_yolo", *RENDERED, "--lockstep", *bus(7713))
    assert report["identical"] is True
    assert report["ticks"] == 31


@pytest.mark.parametrize(("rate", "port"), [(30, 7714), (100, 7715)])
def test_three_seconds_in_real_time(tmp_path: Path, rate: int, port: int) -> None:
    words = ("imu_uwb_yolo", *PROJECTED, "--set", f"control_rate={rate}", "--seconds", "3", *bus(port))
    report = checked(tmp_path / "report.json", *words, "--png", str(tmp_path / "latencies.png"))
    assert report["identical"] is None
    check_in_time(report, 3 * rate + 1)
    assert (tmp_path / "latencies.png").stat().st_size > 1000


@pytest.mark.parametrize(("words", "port"), [(("imu_uwb", "--seed", "1"), 7716), (("imu_uwb_yolo", *PROJECTED), 7717)])
def test_halves_of_two_flights_refuse_each_other(words: tuple[str, ...], port: int) -> None:
    world, onboard = run_both(("imu_uwb", *bus(port), *WAIT), (*words, *bus(port), *WAIT))
    for (code, _, errors), other in ((world, "onboard half"), (onboard, "world")):
        assert code == 2
        assert errors.count("\n") == 1
        assert f"{other}: flies another scenario" in errors


@pytest.mark.parametrize(("half", "other", "port"), [("world", "onboard", 7718), ("onboard", "world", 7719)])
def test_without_the_other_half_a_line_says_how_to_start_it(half: str, other: str, port: int) -> None:
    code, _, errors = run("hil", half, "imu_uwb", *bus(port), "--wait", "1")
    assert code == 2
    assert errors.count("\n") == 1
    assert f"not heard in 1 s; start it with: ortilo hil {other}" in errors


def replayed(log: Path, file: Path) -> dict[str, Any]:
    """Return the report of `ortilo replay`."""
    code, _, errors = run("replay", str(log), "--json", str(file))
    assert code == 0, errors
    report: dict[str, Any] = json.loads(file.read_text())
    return report


def test_a_logged_flight_replays_identically(tmp_path: Path) -> None:
    log = tmp_path / "flight"
    code, _, errors = run("fly", "imu_uwb_yolo", *PROJECTED, *HOVER, "--log", str(log))
    assert code == 0, errors
    report = replayed(log, tmp_path / "replay.json")
    assert report == {"ticks": 121, "identical": True, "first_difference": None, "largest_difference": 0.0}


def test_what_the_onboard_half_logged_in_real_time_replays_identically(tmp_path: Path) -> None:
    log, words = tmp_path / "onboard", ("imu_uwb_yolo", *PROJECTED, *bus(7721), *WAIT)
    for code, _, errors in run_both((*words, "--seconds", "2"), (*words, "--log", str(log))):
        assert code == 0, errors
    report = replayed(log, tmp_path / "replay.json")
    assert report["identical"] is True
    assert report["ticks"] > 50


# --- networks -------------------------------------------------------------------------------------------------


def ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True, text=True)


def test_without_a_multicast_route_a_line_says_how_to_mend_it() -> None:
    if not shutil.which("unshare") or subprocess.run(["unshare", "-rn", "true"], capture_output=True).returncode:
        pytest.skip("`unshare -rn` is missing or not allowed: no network namespace to try in")
    if not shutil.which("ip"):
        pytest.skip("the command `ip` is missing (Debian: iproute2)")
    before = ("unshare", "-rn", "sh", "-c", 'ip link set lo up; exec "$@"', "sh")
    code, _, errors = end(start("hil", "world", "imu_uwb", *bus(7722), "--wait", "1", before=before))
    assert code == 2
    assert errors.count("\n") == 1
    assert "no multicast route" in errors
    assert MEND in errors
    # The command named mends it: what is missing then is the other half.
    mended = ("unshare", "-rn", "sh", "-c", f'{MEND}; exec "$@"', "sh")
    code, _, errors = end(start("hil", "world", "imu_uwb", *bus(7722), "--wait", "1", before=mended))
    assert code == 2
    assert "onboard half: not heard" in errors


@contextlib.contextmanager
def two_networks() -> Iterator[tuple[str, str]]:
    """Make two network namespaces with a cable between them, and take them away again; yield their names."""
    if not shutil.which("ip"):
        pytest.skip("the command `ip` is missing (Debian: iproute2)")
    spaces = f"ortilo-{os.getpid()}-w", f"ortilo-{os.getpid()}-o"
    made = []
    try:
        for space in spaces:
            try:
                ip("netns", "add", space)
            except subprocess.CalledProcessError as error:
                pytest.skip(f"`ip netns add` is not allowed (it needs root): {error.stderr.strip()}")
            made.append(space)
        try:
            ip("-n", spaces[0], "link", "add", "cable", "type", "veth", "peer", "cable", "netns", spaces[1])
        except subprocess.CalledProcessError as error:
            pytest.skip(f"a veth pair cannot be made: {error.stderr.strip()}")
        for number, space in enumerate(spaces, start=1):
            ip("-n", space, "link", "set", "lo", "up")
            ip("-n", space, "address", "add", f"10.76.67.{number}/24", "dev", "cable")
            ip("-n", space, "link", "set", "cable", "up")
            ip("-n", space, "route", "add", "224.0.0.0/4", "dev", "cable")
        yield spaces
    finally:
        for space in made:
            ip("netns", "delete", space)  # and with it the end of the cable in it


def test_each_half_in_a_network_of_its_own(tmp_path: Path) -> None:
    words, report = ("imu_uwb_yolo", *PROJECTED, *bus(7723, ttl=1), *WAIT), tmp_path / "world.json"
    with two_networks() as spaces:
        lockstep = (*words, *HOVER, "--lockstep", "--out", str(tmp_path / "link.nc"), "--json", str(report))
        for code, _, errors in run_both(lockstep, (*words, *HOVER), spaces):
            assert code == 0, errors
        assert json.loads(report.read_text())["ticks"] == 121
        real_time = (*words, "--seconds", "3", "--json", str(report))
        for code, _, errors in run_both(real_time, words, spaces):
            assert code == 0, errors
        check_in_time(json.loads(report.read_text()), 91)
    assert not any(space in subprocess.run(["ip", "netns"], capture_output=True, text=True).stdout for space in spaces)


def test_beyond_its_machine_a_packet_with_ttl_0_does_not_go() -> None:
    words = ("imu_uwb", *bus(7724), "--wait", "2")
    with two_networks() as spaces:
        for code, _, errors in run_both(words, words, spaces):
            assert code == 2
            assert "not heard in 2 s" in errors


def test_an_onboard_half_that_is_killed_twice_joins_the_flight_again(tmp_path: Path) -> None:
    here = (*bus(7731), "--set", "settle=0", "--set", "planner={kind: hover, duration: 10}")
    onboard = start("hil", "onboard", "imu_uwb", "--keep-alive", *here)
    world = start("hil", "world", "imu_uwb", *here, *WAIT, "--json", str(tmp_path / "w.json"))
    try:
        assert onboard.stderr is not None
        for wait in (4.0, 2.0):  # the first until it flies
            process = re.fullmatch(r"onboard half: process (\d+)\n", onboard.stderr.readline())
            assert process is not None
            time.sleep(wait)
            os.kill(int(process[1]), signal.SIGKILL)
            assert "was killed by SIGKILL" in onboard.stderr.readline()
        code, _, errors = end(world)
        assert code == 0, errors
        report = json.loads((tmp_path / "w.json").read_text())
        assert report["lost"] == "null"
        assert report["ticks"] == 301
        assert 0 < report["unanswered"] < 150
        assert end(onboard)[0] == 0
    finally:
        onboard.kill()
        world.kill()
