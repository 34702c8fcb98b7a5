"""However `ortilo` ends: one line on stderr, the right code, and never a traceback."""

import contextlib
import errno
import io
import os
import signal
import subprocess
import sys

import pytest
from command_line import ORTILO, run

from ortilo_drake.commands.terminal import out

# Presses Ctrl-C when a module is first looked for, in a process that then runs `ortilo`.
INTERRUPTED_IMPORT = """
import os, signal, sys

module, sys.argv = sys.argv[1], ["ortilo", *sys.argv[2:]]

class Finder:
    pressed = False

    def find_spec(self, name, path, target=None):
        if name == module and not Finder.pressed:
            Finder.pressed = True
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Finder())
from ortilo_drake.cli import main
try:
    main()
finally:
    assert Finder.pressed, module
"""


@pytest.mark.processes
@pytest.mark.parametrize(
    "module",
    ["typer", "numpy", "pydrake.systems.framework", "xarray"],
)
def test_control_c_during_an_import_ends_with_code_130_and_one_line(module: str) -> None:
    words = (sys.executable, "-c", INTERRUPTED_IMPORT, module, "fly", "nominal_imu_uwb")
    done = subprocess.run(words, capture_output=True, text=True, timeout=300, check=False)
    assert done.stderr == "ortilo: interrupted; what is finished is kept\n"
    assert (done.returncode, done.stdout) == (130, "")


def test_an_interrupt_that_a_library_turns_into_another_error_is_still_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from ortilo_drake.commands import app

    def import_in_c() -> int:
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise ImportError("initialization failed") from None
        return 0

    monkeypatch.setattr(app, "run", import_in_c)
    assert run("scenario", "list") == 130
    assert capsys.readouterr().err == "ortilo: interrupted; what is finished is kept\n"


def test_sigterm_ends_like_control_c_with_its_own_code(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from ortilo_drake.commands import app

    monkeypatch.setattr(app, "run", lambda: signal.raise_signal(signal.SIGTERM))
    assert run("scenario", "list") == 143
    assert capsys.readouterr().err == "ortilo: ended by SIGTERM; what is finished is kept\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_command_that_is_ended_by_signals_says_what_it_did_and_ends_alike(
    number: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ctrl-C is the usual end of `hil relay` and `live`, which then print their counts."""
    from ortilo_drake.commands import app

    def run_until_ended() -> int:
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(number)
        print("counts")
        return 0

    monkeypatch.setattr(app, "run", run_until_ended)
    assert run("hil", "relay") == (0 if number == signal.SIGINT else 143)
    said = capsys.readouterr()
    assert said.out == "counts\n"
    assert said.err == ("" if number == signal.SIGINT else "ortilo: ended by SIGTERM; what is finished is kept\n")


@pytest.mark.processes
def test_a_reader_that_has_enough_is_no_error() -> None:
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "wb") as stdout:
        done = subprocess.run(
            (*ORTILO, "scenario", "list"), stdout=stdout, stderr=subprocess.PIPE, timeout=300, check=False
        )
    assert (done.returncode, done.stderr) == (1, b"")


class FullDisk(io.StringIO):
    """A stream to a file on a full disk."""

    def write(self, text: str) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_full_disk_for_what_is_printed_takes_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stdout", FullDisk())
    assert run("scenario", "show", "nominal_imu_uwb") == 2
    assert capsys.readouterr().err == "ortilo: No space left on device\n"
    monkeypatch.undo()
    out.print()  # what could not be printed was kept, and would come before what the next test prints


@pytest.mark.processes
def test_closed_streams_are_no_error() -> None:
    words = ("sh", "-c", f'exec "{sys.executable}" -m ortilo_drake.cli scenario list <&- >&- 2>&-')
    assert subprocess.run(words, timeout=300, check=False).returncode == 0


@pytest.mark.processes
def test_a_name_that_is_not_utf_8_is_shown_by_its_bytes() -> None:
    words = [word.encode() for word in (*ORTILO, "fly")] + [b"\xff\x1b[2J.yaml"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=300, check=False)
    assert done.stderr == "ortilo: \\udcff\\x1b[2J.yaml: cannot be read: No such file or directory\n"
    assert (done.returncode, done.stdout) == (2, "")
