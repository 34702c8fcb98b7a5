"""A process that keeps an onboard half in the air: when it is killed, the next one is there in a moment.

The parent has imported, compiled and planned all that a flight needs before it forks, so a child has only to open the
bus and build its diagram (with a rendered camera also to load the detector).
"""

import os
import signal
import sys
import time
import traceback
from collections.abc import Callable
from types import FrameType
from typing import Final

from ortilo_drake.model.typed_yaml import InputError

TOO_SOON: Final = 2.0  # a process that was killed within that long of its start did not come to fly [s]
TRIES: Final = 3  # how many such in a row are started again


def keep_alive(fly: Callable[[], None], say: Callable[[str], None]) -> int:
    """Call fly in a child process, again whenever a signal has killed it; return how many were killed.

    Args:
        fly: flies until the end of the flight. What it raises ends it all, told as the command `ortilo` tells it.
        say: told of every start, and of an InputError, in a line each.

    Raises:
        SystemExit: with the child's code if it ends with another than 0; on SIGTERM, after the child has had it too.
        InputError: if TRIES in a row were killed TOO_SOON.
        KeyboardInterrupt: on Ctrl-C, after the child has ended as well.
    """
    killed = in_a_row = 0
    before = signal.signal(signal.SIGTERM, _exit)
    try:
        while True:
            child, started = _fork(fly, say), time.monotonic()
            say(f"onboard half: process {child}")
            status = _wait(child)
            if os.WIFEXITED(status):
                if os.WEXITSTATUS(status):
                    raise SystemExit(os.WEXITSTATUS(status))
                return killed
            killed += 1
            name = signal.Signals(os.WTERMSIG(status)).name
            say(f"onboard half: process {child} was killed by {name}")
            in_a_row = in_a_row + 1 if time.monotonic() < started + TOO_SOON else 0
            if in_a_row == TRIES:
                raise InputError(f"onboard half: killed {TRIES} times within {TOO_SOON:g} s of its start, by {name}")
    finally:
        signal.signal(signal.SIGTERM, before)


def _exit(number: int, frame: FrameType | None) -> None:
    raise SystemExit(128 + number)


def _fork(fly: Callable[[], None], say: Callable[[str], None]) -> int:
    """Return the number of a new process, that calls fly and ends."""
    sys.stdout.flush()
    child = os.fork()
    if child:
        return child
    code = 1
    try:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        fly()
        code = 0
    except InputError as error:
        say(f"ortilo: {error}")
        code = 2
    except KeyboardInterrupt:
        code = 130
    except SystemExit as error:
        code = error.code if isinstance(error.code, int) else 1
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _wait(child: int) -> int:
    """Return a child's status once it has ended; if this process is to end, so does the child first."""
    try:
        return os.waitpid(child, 0)[1]
    except (KeyboardInterrupt, SystemExit) as error:
        os.kill(child, signal.SIGINT if isinstance(error, KeyboardInterrupt) else signal.SIGTERM)
        os.waitpid(child, 0)
        raise
