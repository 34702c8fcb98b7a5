"""The one clock: every discrete system ticks at the control period h."""

from numba import njit


@njit(cache=True)
def tick_of(time: float, h: float) -> int:
    """Return the number k of the tick at time t_k = k h."""
    return int(time / h + 0.5)
