"""`python -m ortilo_drake` where the command `ortilo` is not on the path."""

import subprocess
import sys

import pytest


@pytest.mark.processes
def test_the_package_is_the_command() -> None:
    said = subprocess.run([sys.executable, "-m", "ortilo_drake", "hover"], capture_output=True, text=True, timeout=120)
    assert said.returncode == 2
    assert said.stderr.startswith("ortilo: No such command 'hover'")
