"""The command `ortilo`, run in this process or in a separate one."""

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
    """The exit code and the output of a process."""

    code: int
    stdout: str
    stderr: str


def run(*words: str) -> int:
    """Run `ortilo` in this process; return its exit code.

    After a signal, `ortilo` ignores further signals; this process goes on, so the handlers are restored.
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
    """Start `ortilo` in a separate process, in a folder; `before` is a command that runs it, such as a sandbox."""
    return subprocess.Popen(
        [*before, *ORTILO, *words],
        cwd=folder,
        env=os.environ | {"COLUMNS": "200", "TERM": "dumb"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def end(process: "subprocess.Popen[str]") -> Done:
    """Wait until a process ends, and return its exit code and output."""
    try:
        said, errors = process.communicate(timeout=HANGS)
    finally:
        process.kill()
    return Done(process.returncode, said, errors)


def run_apart(*words: str, folder: Path | None = None) -> Done:
    """Run `ortilo` in a separate process."""
    return end(start(*words, folder=folder))
