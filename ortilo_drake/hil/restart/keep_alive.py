"""A parent process that keeps an onboard half, or a bridge, going: when its child is killed, it forks the next at once.

The parent has imported, compiled and planned all that a flight needs before it forks, so a child has only to open the
bus and build its diagram (with a rendered camera also to load the detector).
"""

import os
import signal
import sys
import time
import traceback
from collections.abc import Callable
from functools import partial
from types import FrameType
from typing import Final

from ortilo_drake.model.typed_yaml import InputError

TOO_SOON: Final = 2.0  # [s]: a process killed sooner after its start is taken for one that never flew
TRIES: Final = 3  # how many such processes in a row are replaced
LOOK_EVERY: Final = 0.005  # between two looks at whether the process has ended, or is to end [s]
ENDING: Final = (signal.SIGTERM, signal.SIGINT)


class _Ending:
    """A handler of the signals that end parent and child: it notes the first, and passes each on to the child.

    It raises nothing: an exception of a handler while os.fork runs would be lost, and the child with it.
    """

    def __init__(self) -> None:
        self.number = self.child = 0  # of the signal, and of the process that flies; 0 while there is none

    def __call__(self, number: int, frame: FrameType | None) -> None:
        self.number = self.number or number
        if self.child:
            os.kill(self.child, number)


def keep_alive(fly: Callable[[int], None], say: Callable[[str], None], name: str = "onboard half") -> int:
    """Call fly in a child process, again whenever a signal has killed it; return how many were killed.

    It is called with the number of those killed before. What it raises ends child and parent, with the line of
    `ortilo`. Every start is told (by the child, before it flies), every end by a signal, and an InputError. SystemExit
    with the child's code if that is not 0, and on SIGTERM, after the child has received it too; KeyboardInterrupt on
    Ctrl-C, likewise; InputError if TRIES in a row were killed TOO_SOON.
    """
    killed = in_a_row = 0
    ending = _Ending()
    before = {number: signal.signal(number, ending) for number in ENDING}
    try:
        while True:
            started = time.monotonic()
            child, status = _fly_in_child(partial(fly, killed), say, ending, name)
            if ending.number == signal.SIGINT:
                raise KeyboardInterrupt
            if ending.number:
                raise SystemExit(128 + ending.number)
            if os.WIFEXITED(status):
                if os.WEXITSTATUS(status):
                    raise SystemExit(os.WEXITSTATUS(status))
                return killed
            killed += 1
            by = signal.Signals(os.WTERMSIG(status)).name
            say(f"{name}: process {child} was killed by {by}")
            in_a_row = in_a_row + 1 if time.monotonic() < started + TOO_SOON else 0
            if in_a_row == TRIES:
                raise InputError(f"{name}: killed {TRIES} times within {TOO_SOON:g} s of its start, by {by}")
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _fly_in_child(fly: Callable[[], None], say: Callable[[str], None], ending: _Ending, name: str) -> tuple[int, int]:
    """Call fly in a child process and wait for its end; return its number and its status."""
    sys.stdout.flush()
    sys.stderr.flush()
    unblocked = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)  # until the child has handlers of its own
    child = os.fork()
    if not child:
        code = 1
        try:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            signal.signal(signal.SIGINT, signal.default_int_handler)
            signal.pthread_sigmask(signal.SIG_SETMASK, unblocked)
            code = _exit_code(fly, say, name)
        finally:
            os._exit(code)
    ending.child = child
    signal.pthread_sigmask(signal.SIG_SETMASK, unblocked)
    if ending.number:  # the signal came before the child was there
        os.kill(child, ending.number)
    # With WNOWAIT no other process gets its number while we may send it signals. An endless wait would sleep through a
    # signal that another thread has taken, as one does while this one has them blocked.
    while os.waitid(os.P_PID, child, os.WEXITED | os.WNOWAIT | os.WNOHANG) is None:
        time.sleep(LOOK_EVERY)
    ending.child = 0
    return child, os.waitpid(child, 0)[1]


def _exit_code(fly: Callable[[], None], say: Callable[[str], None], name: str) -> int:
    """Call fly in the child; return the exit code for the child."""
    code = 1
    try:
        say(f"{name}: process {os.getpid()}")
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
    sys.stdout.flush()
    sys.stderr.flush()
    return code
