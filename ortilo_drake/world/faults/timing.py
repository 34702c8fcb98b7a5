"""The times at which a fault lasts."""

from typing import Final

from numba.extending import register_jitable

from ortilo_drake.world.faults.table import FaultTable

EARLY: Final = 1e-6  # of a tick's time, which is a sum of floats [s]


@register_jitable
def is_ahead(faults: FaultTable, i: int, t: float) -> bool:
    """Return whether fault i begins after t [s]."""
    return t < faults.starts[i] - EARLY


@register_jitable
def is_active(faults: FaultTable, i: int, t: float) -> bool:
    """Return whether fault i lasts at t [s]: from its start on, and before its end."""
    return not is_ahead(faults, i, t) and t < faults.ends[i] - EARLY
