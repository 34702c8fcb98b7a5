"""A way in which a world may differ from what the onboard half believes, by one number."""

from collections.abc import Callable
from typing import Any, NamedTuple

Settings = tuple[tuple[str, Any], ...]  # keys of a scenario with their values


class Mismatch(NamedTuple):
    """A mismatch.

    Attributes:
        name: what it is, with the unit of its value.
        settings: the scenario's keys for a value.
        careful: the value that a careful team leaves.
        given: values that are flown.
        largest: value up to which a limit is searched; None for what is there or not.
        of_rates: whether it changes nothing unless the filter reads the body rates.
    """

    name: str
    settings: Callable[[float], Settings]
    careful: float
    given: tuple[float, ...]
    largest: float | None
    of_rates: bool = False


def of_truth(key: str, scale: float = 1.0, start: float = 0.0) -> Callable[[float], Settings]:
    """Return the settings of a value: an entry of `truth` at start + scale value."""
    return lambda value: ((f"truth.{key}", start + scale * value),)
