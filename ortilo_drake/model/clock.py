"""The one clock: every discrete system ticks at the control period h."""

from numba import njit


@njit(cache=True)
def tick_of(time: float, h: float) -> int:
    """Return the number k of the tick at time t_k = k h."""
    return int(time / h + 0.5)


def history_ticks(horizon: float, h: float) -> int:
    """Return N, the ticks to keep: the present one and all whose age does not exceed the horizon [s]."""
    return int(horizon / h + 1e-6) + 1  # an age that is the horizon up to rounding is within it
