"""The command `ortilo`, run in this process or in one of its own."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple
from unittest.mock import patch

import pytest
from waiting import HANGS

from ortilo_drake import cli

ORTILO = (sys.executable, "-m", "ortilo_drake.cli")


class Done(NamedTuple):
    """How a process ended, and what it said."""

    code: int
    stdout: str
    stderr: str


def run(*words: str) -> int:
    """Run `ortilo` in this process; return its exit code.

    Once ended by a signal it takes no second one before its process ends; this one goes on, and is to take them.
    """
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        with patch.object(sys, "argv", ["ortilo", *words]), pytest.raises(SystemExit) as end:
            cli.main()
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    return int(end.value.code or 0)


def start(*words: str, folder: Path | None = None, before: tuple[str, ...] = ()) -> "subprocess.Popen[str]":
    """Start `ortilo` in a process of its own, in a folder, in front of it a command that runs it elsewhere."""
    return subprocess.Popen(
        [*before, *ORTILO, *words],
        cwd=folder,
        env=os.environ | {"COLUMNS": "200", "TERM": "dumb"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def end(process: "subprocess.Popen[str]") -> Done:
    """Wait for a process."""
    try:
        said, errors = process.communicate(timeout=HANGS)
    finally:
        process.kill()
    return Done(process.returncode, said, errors)


def run_apart(*words: str, folder: Path | None = None) -> Done:
    """Run `ortilo` in a process of its own."""
    return end(start(*words, folder=folder))
