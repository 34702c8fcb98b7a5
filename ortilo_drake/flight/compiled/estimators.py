"""Which estimator a compiled flight flies: numba takes the functions by the type of its constants.

    first(constants)                     what it keeps, arrays that are changed in place
    known_of(constants, memory)          belief of [x; i] (240) that was predicted for this tick
    force_of(constants, memory)          force that is believed to act (3) [N]
    handed_of(constants, memory, ...)    [y, delta, V2] of this tick, see estimate.handed_of
    go_on(constants, memory, ...)        to the next tick, see estimate.take

Constants are those of constants.py, memory a tuple of arrays that are changed in place.
"""

from collections.abc import Callable
from typing import Any

from numba.extending import overload

from ortilo_drake.flight.compiled import estimate, own, tight
from ortilo_drake.flight.compiled.constants_onboard import OwnConstants, TightConstants


def _by_estimator(
    name: str, paper: Callable[..., Any], of_tight: Callable[..., Any], of_own: Callable[..., Any]
) -> Callable[..., Any]:
    """Return a function, for compiled code alone, that is one of three by the type of its first argument."""
    others = {TightConstants: of_tight, OwnConstants: of_own}

    def chosen(*arguments: Any) -> Any:
        raise TypeError(f"{name}: for compiled functions alone")

    def choose(*types: Any) -> Callable[..., Any]:
        return others.get(types[0].instance_class, paper)

    overload(chosen, jit_options={"forceinline": True, "error_model": "numpy"}, strict=False)(choose)
    return chosen


first = _by_estimator("first", estimate.first_memory, tight.first_tight_memory, own.first_own_memory)
known_of = _by_estimator("known_of", estimate.known_of, tight.tight_known_of, own.own_known_of)
force_of = _by_estimator("force_of", estimate.force_of, tight.tight_force_of, own.own_force_of)
handed_of = _by_estimator("handed_of", estimate.handed_of, tight.tight_handed_of, own.own_handed_of)
go_on = _by_estimator("go_on", estimate.take, tight.tight_take, own.own_take)
