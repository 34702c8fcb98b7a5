"""`ortilo hil` and `ortilo replay` as a user has them: the two halves in two processes on one machine.

Wall time is never tested, but within bounds that a loaded machine keeps.
"""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from command_line import end, run, run_apart, start
from halves_in_processes import HOVER, PROJECTED, RENDERED, WAIT, check_in_time, checked, run_both
from waiting import wait_for

from ortilo_drake.interop.log.reader import read_messages

pytestmark = pytest.mark.processes


def test_lockstep_is_the_flight_of_a_single_process(tmp_path: Path, bus: str) -> None:
    report = checked(tmp_path / "report.json", "nominal_imu_uwb_yolo", *HOVER, *PROJECTED, "--lockstep", "--url", bus)
    assert report["identical"] is True
    assert report["ticks"] == 121
    assert report["rejected"] == 0


@pytest.mark.egl
def test_lockstep_is_the_flight_of_a_single_process_with_pictures(tmp_path: Path, bus: str) -> None:
    report = checked(tmp_path / "report.json", "nominal_imu_uwb_yolo", *RENDERED, "--lockstep", "--url", bus)
    assert report["identical"] is True
    assert report["ticks"] == 31


@pytest.mark.real_time
def test_three_seconds_in_real_time_at_100_hz(tmp_path: Path, bus: str) -> None:
    words = ("nominal_imu_uwb_yolo", *PROJECTED, *HOVER, "--set", "control_rate=100", "--seconds", "3", "--url", bus)

    def fly() -> dict[str, Any]:
        report = checked(tmp_path / "report.json", *words, "--png", str(tmp_path / "latencies.png"))
        assert report["identical"] is None
        return report

    check_in_time(fly, 301)
    assert (tmp_path / "latencies.png").stat().st_size > 1000


def test_halves_of_two_flights_refuse_each_other(bus: str, capsys: pytest.CaptureFixture[str]) -> None:
    here = ("nominal_imu_uwb", *HOVER, "--url", bus, *WAIT)
    other_half = start("hil", "onboard", *here, "--set", "multilateration.method=nearest_three")
    try:
        code_here = run("hil", "world", *here)
        onboard = end(other_half)
    finally:
        other_half.kill()
    for code, errors, other in (
        (code_here, capsys.readouterr().err, "onboard half"),
        (onboard.code, onboard.stderr, "world"),
    ):
        assert code == 2
        assert errors.count("\n") == 1
        assert f"{other}: flies another scenario" in errors


@pytest.mark.parametrize(("half", "other"), [("world", "onboard"), ("onboard", "world")])
def test_without_the_other_half_a_line_says_how_to_start_it_and_no_log_is_left(
    tmp_path: Path, half: str, other: str, bus: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("hil", half, "nominal_imu_uwb", *HOVER, "--url", bus, "--wait", "1", "--log", str(tmp_path / "log")) == 2
    errors = capsys.readouterr().err
    assert errors.count("\n") == 1
    assert f"not heard in 1 s; start it with: ortilo hil {other}" in errors
    assert list(tmp_path.iterdir()) == []


def replayed(log: Path, file: Path) -> dict[str, Any]:
    """Return the report of `ortilo replay`, in this process: not in the one that flew."""
    assert run("replay", str(log), "--json", str(file)) == 0
    report: dict[str, Any] = json.loads(file.read_text())
    return report


def test_a_logged_flight_replays_identically(tmp_path: Path) -> None:
    log = tmp_path / "flight"
    code, _, errors = run_apart("fly", "nominal_imu_uwb_yolo", *PROJECTED, *HOVER, "--log", str(log))
    assert code == 0, errors
    report = replayed(log, tmp_path / "replay.json")
    assert report == {
        "ticks": 121,
        "identical": True,
        "first_difference": None,
        "largest_difference": 0.0,
        "references_from_log": 0,
        "state_from_log": False,
    }


@pytest.mark.real_time
def test_three_seconds_in_real_time_and_what_the_onboard_half_logged_replays_identically(
    tmp_path: Path, bus: str
) -> None:
    log, words = tmp_path / "onboard", ("nominal_imu_uwb_yolo", *PROJECTED, *HOVER, "--url", bus, *WAIT)
    flown = tmp_path / "world.json"

    def fly() -> dict[str, Any]:
        shutil.rmtree(log, ignore_errors=True)
        for code, _, errors in run_both((*words, "--seconds", "3", "--json", str(flown)), (*words, "--log", str(log))):
            assert code == 0, errors
        found: dict[str, Any] = json.loads(flown.read_text())
        return found

    check_in_time(fly, 91)
    report = replayed(log, tmp_path / "replay.json")
    assert report["identical"] is True
    assert report["ticks"] > 0  # how many is a matter of the load


@pytest.mark.real_time
@pytest.mark.egl
def test_in_real_time_pictures_are_drawn_and_looked_at_beside_the_ticks(tmp_path: Path, bus: str) -> None:
    log, words = tmp_path / "onboard", ("nominal_imu_uwb_yolo", *RENDERED, "--set", "camera.width=160", "--url", bus)
    wait = ("--wait", "120")

    def boxes() -> list[int]:
        shutil.rmtree(log, ignore_errors=True)
        for code, _, errors in run_both((*words, *wait, "--seconds", "3"), (*words, *wait, "--log", str(log))):
            assert code == 0, errors
        return [k for k, messages, _ in read_messages(log) if "detections" in messages]

    assert wait_for(boxes, "boxes in time")  # idle it is some 30; on a busy machine it is flown again
    report = replayed(log, tmp_path / "replay.json")
    assert report["identical"] is True
