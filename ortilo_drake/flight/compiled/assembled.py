"""A scenario's flights by the loop that is assembled by hand: of scenarios that have a box which is no element yet."""

from functools import lru_cache
from typing import Any

import numpy as np
from numba import njit

from ortilo_drake.flight.compiled.constants import FlightConstants
from ortilo_drake.flight.compiled.constants_onboard import OwnConstants
from ortilo_drake.flight.compiled.loop import fly_one, start_one
from ortilo_drake.flight.compiled.prepare import constants_of
from ortilo_drake.flight.compiled.truth import constants_of_draw, normals_at_start
from ortilo_drake.scenario import Scenario
from ortilo_drake.world.drawn_truth import AtStart


class Assembled:
    """Flights of a scenario, as played.Played's.

    Args:
        scenario: the scenario.

    Attributes:
        ticks: of a flight, but for the first.
        reference: r at each tick [m] (ticks + 1, 3).
    """

    def __init__(self, scenario: Scenario):
        self._scenario, self._room, self._constants = scenario, scenario.load_room(), constants_of(scenario)
        self._start_one, self._fly_one = kernels_of(self._constants)
        self.reference, self.ticks = self._constants.reference[:, :3], len(self._constants.reference) - 1

    def fly(
        self, seeds: np.ndarray, draw: AtStart, trace: np.ndarray, arrived: np.ndarray, log: np.ndarray
    ) -> tuple[int, int]:
        """Fly once, see Played.fly."""
        own = _copied(self._constants)  # threads that share arrays wait for each other's reference counts
        h, reference, x_0, *parts = constants_of_draw(own, self._scenario, self._room, draw)
        kept = self._start_one(x_0, *parts[:-2])  # all but servo and bounds
        last, cause = self._fly_one(seeds, trace, arrived, log, *kept, h, reference, *parts)
        return int(last), int(cause)

    def normals_at_start(self) -> dict[str, int]:
        """Return how many standard normal numbers each stream gives to what is drawn at the start, by its name."""
        return normals_at_start(self._constants, self._scenario, self._room)


@lru_cache(maxsize=1)
def _uncached_kernels() -> tuple[Any, Any]:
    return njit(start_one.py_func), njit(nogil=True, error_model="numpy")(fly_one.py_func)


def kernels_of(constants: FlightConstants) -> tuple[Any, Any]:
    """Return start_one and fly_one, or both anew: numba's cache would not notice that a user's function has changed."""
    numbers = [other.numbers for other in constants.others]
    if isinstance(constants.filter, OwnConstants):
        numbers.append(constants.filter.numbers)
    modules = {type(its).__module__.partition(".")[0] for its in numbers}
    return (start_one, fly_one) if modules <= {"ortilo_drake"} else _uncached_kernels()


def _copied(constants: Any) -> Any:
    """Return constants with arrays of their own."""
    if isinstance(constants, np.ndarray):
        return constants.copy()
    if not isinstance(constants, tuple):
        return constants
    parts = [_copied(part) for part in constants]
    return type(constants)(*parts) if hasattr(constants, "_fields") else tuple(parts)
