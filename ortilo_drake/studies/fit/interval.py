"""A number with the interval that holds it with 95 % probability."""

from typing import NamedTuple

import numpy as np

TIMES = 1.959964  # standard deviations of a normal number to either side


class Interval(NamedTuple):
    """A number, and the ends of its interval."""

    value: float
    low: float
    high: float

    def holds(self, value: float) -> bool:
        """Return whether a number lies in the interval."""
        return self.low <= value <= self.high


def normal_interval(value: float, sd: float) -> Interval:
    """Return the interval of a number whose error is normal."""
    return Interval(float(value), float(value - TIMES * sd), float(value + TIMES * sd))


def log_interval(log_value: float, sd: float) -> Interval:
    """Return the interval of a positive number whose logarithm's error is normal."""
    return Interval(*(float(np.exp(end)) for end in normal_interval(log_value, sd)))
