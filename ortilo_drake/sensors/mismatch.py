"""A mismatch between the world and the onboard model, given by one number."""

from collections.abc import Callable
from typing import Any, NamedTuple

Settings = tuple[tuple[str, Any], ...]  # keys of a scenario with their values


class Mismatch(NamedTuple):
    """A way in which the world may differ from the onboard model."""

    name: str
    """name of the mismatch with the unit of its value."""
    settings: Callable[[float], Settings]
    """value -> keys and values of the scenario."""
    careful: float
    """value that remains after careful work of a team."""
    given: tuple[float, ...]
    """values for which flights are run."""
    largest: float | None
    """largest value in the search for a limit; None for a mismatch that is either present or not."""
    of_rates: bool = False
    """whether the mismatch has an effect only if the filter reads the body rates."""


def of_truth(key: str, scale: float = 1.0, start: float = 0.0) -> Callable[[float], Settings]:
    """Return the function from a value to settings: the key of `truth` gets start + scale * value."""
    return lambda value: ((f"truth.{key}", start + scale * value),)
