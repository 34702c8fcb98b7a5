"""Half a flight that is killed: the onboard half comes back, the world's log stays."""

import json
import os
import re
import signal
import time
from pathlib import Path

import numpy as np
import pytest
from command_line import end, run_apart, start
from waiting import wait_for

from ortilo_drake.flight.saved_flight import load_flight
from ortilo_drake.hil.restart.keep_alive import TOO_SOON
from ortilo_drake.interop.log.reader import read_ticks
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Failsafe

pytestmark = pytest.mark.processes

GOAL = (3.0, 0.0)
LONG = ("--set", "planner={kind: hover, duration: 60}")
TO_THE_GOAL = ("--set", f"planner={{kind: gcs, goal: [{GOAL[0]}, {GOAL[1]}]}}", "--set", "uwb.link.blackouts=[]")


@pytest.mark.real_time
def test_killed_up_to_three_times_the_onboard_half_still_reaches_its_goal(tmp_path: Path, bus: str) -> None:
    here = ("nominal_imu_uwb", *TO_THE_GOAL, "--url", bus)
    checkpoint, flown, report = tmp_path / "state.npz", tmp_path / "flight.nc", tmp_path / "world.json"
    onboard = start("hil", "onboard", *here, "--keep-alive", "--checkpoint", str(checkpoint))
    world = start("hil", "world", *here, "--wait", "120", "--out", str(flown), "--json", str(report))
    try:
        assert onboard.stderr is not None
        kills = 0
        while kills < 3:
            process = re.fullmatch(r"onboard half: process (\d+)\n", onboard.stderr.readline())
            assert process is not None
            long_enough = time.monotonic() + TOO_SOON + 0.2  # else it counts as one that never flew
            checkpoint.unlink(missing_ok=True)
            wait_for(lambda: checkpoint.exists() or world.poll() is not None, "the onboard half flies")
            time.sleep(max(0.0, long_enough - time.monotonic()))
            if world.poll() is not None:
                break  # on a busy machine the flight may be over before the third
            os.kill(int(process[1]), signal.SIGKILL)
            assert "was killed by SIGKILL" in onboard.stderr.readline()
            kills += 1
        assert kills
        code, _, errors = end(world)
        assert code == 0, errors
        assert end(onboard)[0] == 0
    finally:
        onboard.kill()
        world.kill()
    found = json.loads(report.read_text())
    assert found["unanswered"] > 0
    assert found["longest_silence"] > 0.0
    if found["longest_silence"] < Failsafe().hold_for:  # else it comes down, as it should: idle it is half a second
        assert found["lost"] is None
        np.testing.assert_allclose(load_flight(flown)["truth"].values[-1, :2], GOAL, atol=0.3)


def ticks_in(log: Path) -> list[int]:
    """Return the ticks that a log holds so far; none before its file is begun."""
    try:
        return [tick for tick, *_ in read_ticks(log)]
    except InputError:
        return []


@pytest.mark.real_time
def test_the_log_of_a_killed_world_keeps_what_it_had(tmp_path: Path, bus: str) -> None:
    # That it loses half a second at most is held where the tick of the kill is known: test_log_reading.py.
    log, here = tmp_path / "log", ("nominal_imu_uwb", *LONG, "--url", bus, "--wait", "120")
    onboard = start("hil", "onboard", *here)
    world = start("hil", "world", *here, "--log", str(log))
    try:
        wait_for(lambda: len(ticks_in(log)) >= 45, "the world logs")
        kept = ticks_in(log)
        world.kill()
        world.communicate()
    finally:
        onboard.kill()
        onboard.communicate()
        world.kill()
    assert len(kept) >= 45
    ticks = ticks_in(log)
    assert ticks == list(range(len(ticks)))
    assert ticks[: len(kept)] == kept


def test_what_cannot_be_flown_is_told_in_one_line_under_keep_alive_too(tmp_path: Path, bus: str) -> None:
    code, _, errors = run_apart("hil", "onboard", "nominal_imu_uwb", *LONG, "--url", bus, "--keep-alive", "--wait", "1")
    assert code == 2
    assert [line for line in errors.splitlines() if line.startswith("ortilo:")] == [
        "ortilo: world: not heard in 1 s; start it with: ortilo hil world"
    ]
    assert len(errors.splitlines()) == 2  # and which process it was
