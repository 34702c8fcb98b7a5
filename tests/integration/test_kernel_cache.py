"""What numba has compiled is kept: a process that flies compiles nothing that another one had compiled."""

import os
import subprocess
import sys

import pytest

HOVER = "planner={kind: hover, duration: 0.5}"


def compiled_by(*words: str) -> list[str]:
    """Return what an `ortilo` process saves in numba's cache."""
    run = subprocess.run(
        [sys.executable, "-m", "ortilo_drake.cli", *words],
        env=os.environ | {"NUMBA_DEBUG_CACHE": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert "loaded from" in run.stdout
    return [line for line in run.stdout.splitlines() if "data saved" in line]


@pytest.mark.processes
@pytest.mark.parametrize("settings", [(), ("--set", "estimator.force=measured", "--set", "estimator.delay=replay")])
def test_a_second_process_compiles_nothing(settings: tuple[str, ...]) -> None:
    words = ("fly", "imu_uwb_yolo", "--camera", "projected", "--set", HOVER, *settings)
    compiled_by(*words)
    assert compiled_by(*words) == []
