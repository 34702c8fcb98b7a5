"""Waiting for events without a fixed time: a busy machine may take long."""

import time
from collections.abc import Callable
from typing import Final, TypeVar

T = TypeVar("T")

HANGS: Final = 300.0  # time after which an event counts as never happening [s]


def wait_for(look: Callable[[], T], what: str) -> T:
    """Call `look` again and again; return the first result that is neither None nor False nor empty."""
    until = time.monotonic() + HANGS
    while not (found := look()):
        assert time.monotonic() < until, f"{what}: not in {HANGS:g} s"
        time.sleep(0.01)
    return found
