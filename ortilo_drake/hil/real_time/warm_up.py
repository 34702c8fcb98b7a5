"""Preparation of a process for real time, so that nothing is compiled or garbage-collected in flight."""

import contextlib
import gc
from collections.abc import Iterator

from ortilo_drake.diagrams.closed_loop import make_closed_loop
from ortilo_drake.flight.simulator import make_simulator
from ortilo_drake.scenario import Scenario

TICKS = 12  # enough for every sensor to send, and every message to enter the filter


def warm_up(scenario: Scenario) -> None:
    """Fly a moment of the scenario in this process, so that numba compiles or loads all that either half calls."""
    flown = scenario.projected()
    make_simulator(make_closed_loop(flown), flown).AdvanceTo((TICKS + 0.5) * flown.h)


@contextlib.contextmanager
def no_collecting() -> Iterator[None]:
    """Keep Python from searching for reference cycles: a tick makes none, and the search takes many milliseconds."""
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
