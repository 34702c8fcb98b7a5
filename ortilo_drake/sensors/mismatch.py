"""A way in which a world may differ from what the onboard half believes, by one number."""

from collections.abc import Callable
from typing import Any, NamedTuple

Settings = tuple[tuple[str, Any], ...]  # keys of a scenario with their values


class Mismatch(NamedTuple):
    """A mismatch."""

    name: str
    """what it is, with the unit of its value."""
    settings: Callable[[float], Settings]
    """the scenario's keys for a value."""
    careful: float
    """the value that a careful team leaves."""
    given: tuple[float, ...]
    """values that are flown."""
    largest: float | None
    """value up to which a limit is searched; None for what is there or not."""
    of_rates: bool = False
    """whether it changes nothing unless the filter reads the body rates."""


def of_truth(key: str, scale: float = 1.0, start: float = 0.0) -> Callable[[float], Settings]:
    """Return the settings of a value: an entry of `truth` at start + scale value."""
    return lambda value: ((f"truth.{key}", start + scale * value),)
