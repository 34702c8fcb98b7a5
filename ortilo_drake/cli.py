"""The command `ortilo`: it reports every error, and an end by a signal, in one line.

Only the standard library is imported at the top, so that Ctrl-C during any other import is caught below.
"""

import contextlib
import os
import signal
import sys
from types import FrameType
from typing import NoReturn, TextIO

_ENDING = (signal.SIGINT, signal.SIGTERM)
_TERMINATED = 128 + signal.SIGTERM  # exit code after SIGTERM, by the shells' convention


def main() -> None:
    """Run the command.

    Bad input ends the command with one line and exit code 2, a broken pipe with exit code 1, Ctrl-C with a line and
    exit code 130, and SIGTERM (sent by `kill`, or when a service is stopped) with a line and exit code 143.
    """
    interrupted = 0  # number of the signal
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")  # our matrices are small: threads would wait longer than they compute

    def interrupt(number: int, frame: FrameType | None) -> NoReturn:
        nonlocal interrupted
        interrupted = number
        raise KeyboardInterrupt

    _open_streams()
    handled = [number for number in _ENDING if signal.getsignal(number) != signal.SIG_IGN]
    before = {number: signal.signal(number, interrupt) for number in handled}
    try:
        from ortilo_drake.model.input_error import InputError, one_line

        try:
            from ortilo_drake.commands.app import run

            code = run()
            sys.stdout.flush()
            if interrupted == signal.SIGTERM:  # for commands that usually end with Ctrl-C
                raise KeyboardInterrupt
        except InputError as error:
            if interrupted:
                raise KeyboardInterrupt from None
            code = _say(str(error), 2)
        except BrokenPipeError:  # the reader of our output has closed it
            _silence(sys.stdout)
            code = 1
        except OSError as error:
            if interrupted:
                raise KeyboardInterrupt from None
            _silence(sys.stdout)
            what = "" if error.filename is None else f"{os.fsdecode(error.filename)}: "
            code = _say(one_line(f"{what}{error.strerror or error}"), 2)
        except ValueError as error:
            from ortilo_drake.loop.raised import ElementError  # whoever raises it has loaded it

            if not isinstance(error, ElementError) or interrupted:
                raise
            code = _say(one_line(f"{error}"), 2)
        except MemoryError:
            code = _say("out of memory", 2)
        except ModuleNotFoundError as error:
            from ortilo_drake.model.optional import EXTRAS, missing

            package = (error.name or "").partition(".")[0]
            if package not in EXTRAS or interrupted:
                raise
            code = _say(str(missing(package, EXTRAS[package])), 2)
    except BaseException as error:
        # A C module raises an ImportError, or another error, if its import is interrupted.
        if isinstance(error, SystemExit) and error.code == _TERMINATED:  # from keep_alive, which handles SIGTERM
            interrupted = signal.SIGTERM
        if not interrupted and not isinstance(error, KeyboardInterrupt):
            raise
        for number in before:
            signal.signal(number, signal.SIG_IGN)  # a second signal must not interrupt the end
        before = {}
        if interrupted == signal.SIGTERM:
            code = _say("ended by SIGTERM; what is finished is kept", _TERMINATED)
        else:
            code = _say("interrupted; what is finished is kept", 128 + signal.SIGINT)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    sys.exit(code)


def _open_streams() -> None:
    """Open /dev/null for standard streams that are closed; print characters that cannot be encoded as escapes."""
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "r" if name == "stdin" else "w", encoding="utf-8"))  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(AttributeError):  # a stream that a test put there
            stream.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]


def _say(line: str, code: int) -> int:
    with contextlib.suppress(OSError):
        print(f"ortilo: {line}", file=sys.stderr, flush=True)
    return code


def _silence(stream: TextIO) -> None:
    """Redirect a stream that cannot be written to /dev/null, so that closing the stream at the end does not fail."""
    with contextlib.suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


if __name__ == "__main__":
    main()
