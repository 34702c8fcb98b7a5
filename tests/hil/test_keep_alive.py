"""The process that keeps an onboard half in the air."""

import os
import signal
import sys
import time
from pathlib import Path

import pytest

from ortilo_drake.hil.keep_alive import keep_alive
from ortilo_drake.model.typed_yaml import InputError


def test_a_process_that_dies_at_once_is_given_up() -> None:
    said: list[str] = []
    with pytest.raises(InputError, match="killed 3 times within 2 s of its start, by SIGKILL"):
        keep_alive(lambda: os.kill(os.getpid(), signal.SIGKILL), said.append)
    assert sum("was killed by SIGKILL" in line for line in said) == 3


def test_what_a_process_cannot_fly_is_told_in_one_line(capfd: pytest.CaptureFixture[str]) -> None:
    def refuse() -> None:
        raise InputError("world: not heard")

    with pytest.raises(SystemExit) as ended:
        keep_alive(refuse, lambda line: print(line, file=sys.stderr))
    assert ended.value.code == 2
    assert capfd.readouterr().err.splitlines()[-1] == "ortilo: world: not heard"


def test_sigterm_ends_the_process_that_flies_too(tmp_path: Path) -> None:
    def fly_on() -> None:
        (tmp_path / "child").write_text(str(os.getpid()))
        os.kill(os.getppid(), signal.SIGTERM)
        time.sleep(60.0)

    with pytest.raises(SystemExit) as ended:
        keep_alive(fly_on, lambda line: None)
    assert ended.value.code == 128 + signal.SIGTERM
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "child").read_text()), 0)
