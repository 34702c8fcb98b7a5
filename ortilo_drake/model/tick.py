"""What a tick may be."""

from numbers import Real
from typing import Any, Final

from ortilo_drake.model.typed_yaml import InputError

SHORTEST: Final = 1e-3  # ticks [s]
LONGEST: Final = 0.2


def check_tick(h: Any) -> None:
    """Check the tick of a part [s]; InputError says what it may be."""
    if not isinstance(h, Real) or not SHORTEST <= float(h) <= LONGEST:
        raise InputError(f"h: {h!r}: must be {SHORTEST:g} to {LONGEST:g} s")
