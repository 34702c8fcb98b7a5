"""A process that keeps an onboard half in the air: when it is killed, the next one is there in a moment.

The parent has imported, compiled and planned all that a flight needs before it forks, so a child has only to open the
bus and build its diagram.
"""

import os
import signal
import sys
from collections.abc import Callable


def keep_alive(fly: Callable[[], None], say: Callable[[str], None]) -> int:
    """Call fly in a child process, again whenever a signal has killed it; return how many were killed.

    Args:
        fly: flies until the end of the flight.
        say: told of every start.

    Raises:
        SystemExit: with the child's code if it ends with another than 0.
        KeyboardInterrupt: on Ctrl-C, after the child has ended as well.
    """
    killed = 0
    while True:
        sys.stdout.flush()
        child = os.fork()
        if child == 0:
            code = 1
            try:
                fly()
                code = 0
            except SystemExit as error:
                code = error.code if isinstance(error.code, int) else 1
            finally:
                sys.stdout.flush()
                sys.stderr.flush()
                os._exit(code)
        say(f"onboard half: process {child}")
        try:
            _, status = os.waitpid(child, 0)
        except KeyboardInterrupt:
            os.kill(child, signal.SIGINT)
            os.waitpid(child, 0)
            raise
        if os.WIFEXITED(status):
            if os.WEXITSTATUS(status):
                raise SystemExit(os.WEXITSTATUS(status))
            return killed
        killed += 1
        say(f"onboard half: process {child} was killed by {signal.Signals(os.WTERMSIG(status)).name}")
