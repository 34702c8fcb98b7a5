"""When a fault lasts."""

from typing import Final

from ortilo_drake.scenario.faults import Onset, end_of

EARLY: Final = 1e-6  # of a tick's time, which is a sum of floats [s]


def is_active(fault: Onset, t: float) -> bool:
    """Return whether a fault lasts at t [s]: from its start on, and before its end."""
    end = end_of(fault)
    return fault.start - EARLY <= t and (end is None or t < end - EARLY)
