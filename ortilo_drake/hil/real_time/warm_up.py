"""Preparation of a process for real time, so that no code is compiled and no garbage collected in flight."""

import contextlib
import gc
from collections.abc import Iterator

from ortilo_drake.flight.stepped_halves import OnboardHalf, WorldHalf
from ortilo_drake.scenario import Scenario

TICKS = 12  # enough ticks for every sensor to send, and for every message to enter the filter


def warm_up(scenario: Scenario) -> None:
    """Fly both halves briefly in this process, so that numba compiles or loads all functions of the onboard half.

    Meanwhile the boxes of a rendered camera are projected: nothing is drawn.
    """
    flown = scenario.projected()
    world, onboard = WorldHalf(flown), OnboardHalf(flown)
    for _ in range(TICKS):
        onboard.receive(world.sample())
        control = onboard.answer()
        onboard.outputs()
        onboard.advance()
        world.advance(control)
    if scenario.is_rendered:  # in flight its onboard half takes detections, which is different code
        onboard = OnboardHalf(scenario, detects=False)
        onboard.receive({})
        onboard.answer()
        onboard.outputs()
        onboard.advance()


@contextlib.contextmanager
def no_collecting() -> Iterator[None]:
    """Keep Python from searching for reference cycles: a tick makes none, and a search takes many milliseconds."""
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
