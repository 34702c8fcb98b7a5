"""The two halves in two networks, and in none: skipped where network namespaces are not allowed."""

import contextlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import xarray as xr
from command_line import run
from halves_in_processes import HOVER, PROJECTED, WAIT, check_in_time, run_both
from waiting import HANGS

from ortilo_drake.flight.flight import fly
from ortilo_drake.flight.saved_flight import load_flight
from ortilo_drake.scenario import load_scenario

pytestmark = pytest.mark.processes


def at(host: str, bus: str) -> str:
    """Return the URL of a bus at another host."""
    return bus.replace("127.0.0.1", host)


def ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True, text=True)


PROGRAM = """
import contextlib, io, json, subprocess, sys
from command_line import run
before, ended = json.loads(sys.argv[1]), []
for command, words in before:
    if command:
        subprocess.run(command, shell=True, check=True)
    with contextlib.redirect_stderr(io.StringIO()) as errors:
        ended.append((run(*words), errors.getvalue()))
print(json.dumps(ended))
"""


def run_alone(*steps: tuple[str, tuple[str, ...]]) -> list[tuple[int, str]]:
    """Run `ortilo` time after time in one process in a network of its own; return exit codes and standard errors.

    Each step is a command of the shell that goes before, if any, and the words of `ortilo`.
    """
    done = subprocess.run(
        ["unshare", "-rn", sys.executable, "-c", PROGRAM, json.dumps(steps)],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "COLUMNS": "200", "TERM": "dumb"},
        capture_output=True,
        text=True,
        timeout=HANGS,
    )
    assert done.returncode == 0, done.stderr
    return [(code, errors) for code, errors in json.loads(done.stdout.splitlines()[-1])]


def test_without_a_route_the_loopback_interface_is_enough_and_else_a_line_says_why(bus: str) -> None:
    if not shutil.which("unshare") or subprocess.run(["unshare", "-rn", "true"], capture_output=True).returncode:
        pytest.skip("`unshare -rn` is missing or not allowed: no network namespace to try in")
    if not shutil.which("ip"):
        pytest.skip("the command `ip` is missing (Debian: iproute2)")
    world = ("hil", "world", "nominal_imu_uwb", *HOVER, "--wait", "1")
    cases = (
        ("ip link set lo up", ("--url", bus), "onboard half: not heard in 1 s; start it with: ortilo hil onboard\n"),
        ("", ("--url", at("0.0.0.0", bus)), "which `ortilo hil key FILE` makes, or --insecure\n"),
        ("", ("--url", at("10.76.67.1", bus), "--insecure"), "or tcp://0.0.0.0:PORT\n"),
    )
    ended = run_alone(*((command, (*world, *words)) for command, words, _ in cases))
    for (code, errors), (*_, said) in zip(ended, cases, strict=True):
        assert code == 2
        assert errors.count("\n") == 1
        assert errors.endswith(said), errors


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
        yield spaces
    finally:
        for space in made:
            ip("netns", "delete", space)  # and with it the end of the cable in it


SETTINGS = tuple(word for word in (*PROJECTED, *HOVER) if word != "--set")


@pytest.mark.real_time
def test_each_half_in_a_network_of_its_own(tmp_path: Path, bus: str) -> None:
    assert run("hil", "key", str(tmp_path / "key")) == 0
    words = ("nominal_imu_uwb_yolo", *PROJECTED, *HOVER, "--key", str(tmp_path / "key"), *WAIT)
    serves, joins = (*words, "--url", at("0.0.0.0", bus)), (*words, "--url", at("10.76.67.1", bus))
    report = tmp_path / "world.json"
    with two_networks() as spaces:
        lockstep = (*serves, "--lockstep", "--out", str(tmp_path / "link.nc"), "--json", str(report))
        for code, _, errors in run_both(lockstep, joins, spaces):
            assert code == 0, errors
        alone, apart = fly(load_scenario("nominal_imu_uwb_yolo", SETTINGS)), load_flight(tmp_path / "link.nc")
        xr.testing.assert_equal(apart, alone)
        real_time = (*serves, "--seconds", "3", "--json", str(report))

        def fly_in_real_time() -> dict[str, Any]:
            for code, _, errors in run_both(real_time, joins, spaces):
                assert code == 0, errors
            found: dict[str, Any] = json.loads(report.read_text())
            return found

        check_in_time(fly_in_real_time, 91)
    assert not any(space in subprocess.run(["ip", "netns"], capture_output=True, text=True).stdout for space in spaces)


def test_a_world_on_the_loopback_interface_is_not_reached_from_elsewhere(tmp_path: Path, bus: str) -> None:
    assert run("hil", "key", str(tmp_path / "key")) == 0
    words = ("nominal_imu_uwb", *HOVER, "--key", str(tmp_path / "key"), "--wait", "2")
    with two_networks() as spaces:
        for code, _, errors in run_both((*words, "--url", bus), (*words, "--url", at("10.76.67.1", bus)), spaces):
            assert code == 2
            assert "not heard in 2 s" in errors
