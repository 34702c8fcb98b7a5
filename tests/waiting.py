"""Waiting for what happens in its own time: a busy machine takes as long as it takes."""

import time
from collections.abc import Callable
from typing import Final, TypeVar

T = TypeVar("T")

HANGS: Final = 300.0  # [s]: whatever takes longer never comes


def wait_for(look: Callable[[], T], what: str) -> T:
    """Look again and again; return the first that is neither None nor False nor empty."""
    until = time.monotonic() + HANGS
    while not (found := look()):
        assert time.monotonic() < until, f"{what}: not in {HANGS:g} s"
        time.sleep(0.01)
    return found
