"""Preparation of a process before its first tick in real time: nothing is compiled or collected in flight."""

import contextlib
import gc
from collections.abc import Iterator

from ortilo_drake.diagrams.closed_loop import make_closed_loop
from ortilo_drake.flight.simulator import make_simulator
from ortilo_drake.scenario import Scenario

TICKS = 12  # every sensor has sent, and every message entered the filter


def warm_up(scenario: Scenario) -> None:
    """Fly a moment of the scenario in this process, which has numba compile or load all that either half calls."""
    flown = scenario.projected()
    make_simulator(make_closed_loop(flown), flown).AdvanceTo((TICKS + 0.5) * flown.h)


@contextlib.contextmanager
def no_collecting() -> Iterator[None]:
    """Within it Python does not search for reference cycles: a tick makes none, and looking takes many milliseconds."""
    gc.collect()
    gc.freeze()
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()
        gc.unfreeze()
