"""The common clock: every discrete system ticks at the control period h."""

from numbers import Real
from typing import Any, Final

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.input_error import InputError

SHORTEST: Final = 1e-3  # shortest tick [s]
LONGEST: Final = 0.2  # longest tick [s]


@cached_njit
def tick_of(time: float, h: float) -> int:
    """Return the number k of the tick at time t_k = k h."""
    return int(time / h + 0.5)


def history_ticks(horizon: float, h: float) -> int:
    """Return the number of ticks to keep: the present one and all with an age up to the horizon [s]."""
    return int(horizon / h + 1e-6) + 1  # an age equal to the horizon up to rounding counts as within the horizon


def check_tick(h: Any) -> None:
    """Check the tick h [s] of a part; InputError names the allowed range."""
    if not isinstance(h, Real) or not SHORTEST <= float(h) <= LONGEST:
        raise InputError(f"h: {h!r}: must be {SHORTEST:g} to {LONGEST:g} s")
