"""A parent process that keeps an onboard half or a bridge going: when its child is killed, it forks another at once.

Before it forks, the parent has imported, compiled and planned everything that a flight needs. So a child only has to
open the bus and build its diagram, and with a rendered camera to load the detector.
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

TOO_SOON: Final = 2.0  # a process killed sooner after its start counts as one that never flew [s]
TRIES: Final = 3  # number of such processes in a row after which the parent gives up
LOOK_EVERY: Final = 0.005  # period of checks whether the child has ended or must end [s]
ENDING: Final = (signal.SIGTERM, signal.SIGINT)


class _Ending:
    """A handler of the signals that end parent and child: it notes the first signal, and passes each on to the child.

    It raises no exception: an exception of a handler during os.fork would be lost, and the child with it.
    """

    def __init__(self) -> None:
        self.number = self.child = 0  # number of the signal, and of the child process; 0 while there is none

    def __call__(self, number: int, frame: FrameType | None) -> None:
        self.number = self.number or number
        if self.child:
            os.kill(self.child, number)


def keep_alive(fly: Callable[[int], None], say: Callable[[str], None], name: str = "onboard half") -> int:
    """Call `fly` in a child process, again whenever a signal has killed it; return the number of killed processes.

    `fly` is called with the number of processes killed before. If it raises an exception, child and parent end. `say`
    takes a line about each start (from the child, before it flies), each end by a signal, and an InputError. SystemExit
    with the child's code if the code is not 0, and on SIGTERM; KeyboardInterrupt on Ctrl-C. Both signals also go to the
    child first. InputError if TRIES processes in a row were killed within TOO_SOON.
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
    """Call `fly` in a child process and wait for its end; return the child's process number and status."""
    sys.stdout.flush()
    sys.stderr.flush()
    unblocked = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)  # until the child has its own handlers
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
    if ending.number:  # the signal came before ending.child was set
        os.kill(child, ending.number)
    # With WNOWAIT the child keeps its number while we may send it signals. A blocking wait would miss a signal that
    # another thread receives, as one does while this thread blocks the signals.
    while os.waitid(os.P_PID, child, os.WEXITED | os.WNOWAIT | os.WNOHANG) is None:
        time.sleep(LOOK_EVERY)
    ending.child = 0
    return child, os.waitpid(child, 0)[1]


def _exit_code(fly: Callable[[], None], say: Callable[[str], None], name: str) -> int:
    """Call `fly` in the child; return the exit code of the child."""
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
