"""The watch of the tight filter: it notices what contradicts its model for long, and opens the state to blame.

- A message whose payload is the last one's again says nothing: noise never repeats itself.
- Roll, pitch and yaw whose innovations lean to one side contradict the body rates: their bias may have stepped.
- Ranges that are refused all on one side have an error in common: the clock's.

A mean over a time T of normalized innovations of a filter that is right has the standard deviation
sqrt(a / (2 - a)), a = 1 - exp(-h / T): the threshold is many times that. What is opened is a variance, added to that of
the state: the measurements decide what has become of it.
"""

from typing import Final, NamedTuple

import numpy as np

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.signals import PAYLOAD
from ortilo_drake.onboard.estimator.tight.layout import GYRO, THETA, Layout

# What is kept: means of the normalized angles (3) and of the share of ranges that is refused on one side, and then the
# payloads that came last.
LEANING: Final = 0
SIDED: Final = 3
LAST: Final = 4
_FEWEST: Final = 3  # ranges that can have an error in common


class Watch(NamedTuple):
    """The settings of the watch."""

    share: float
    """of a new value in the means, a [1]."""
    leans: float
    """mean of normalized angles from which on the body rates are doubted [1]."""
    sided: float
    """mean share of refused ranges on one side from which on their clock is doubted [1]."""
    gyroscope: float
    """variance that the gyroscope's bias gets then [rad^2/s^2]."""
    attitude: float
    """variance that the attitude gets then [rad^2]."""
    offset: float
    """variance that the error of all ranges gets [m^2]."""


@cached_njit
def says_again(message: np.ndarray, last: np.ndarray) -> bool:
    """Return whether a message's payload, not all of it 0 or less, is the last one's (m); that becomes this one's."""
    same, says = True, False
    for i in range(last.size):
        value = message[PAYLOAD + i]
        same = same and value == last[i]
        says = says or value > 0.0
        last[i] = value
    return same and says


@cached_njit
def watch_angles(C: np.ndarray, watched: np.ndarray, normalized: np.ndarray, watch: Watch) -> bool:
    """Open the gyroscope's bias if the angles lean to one side; return whether they did.

    `normalized` is e / sqrt(S) of this tick's angles (3). C and what is kept, watched, are changed.
    """
    doubted = False
    for i in range(3):
        watched[LEANING + i] += watch.share * (normalized[i] - watched[LEANING + i])
        doubted = doubted or abs(watched[LEANING + i]) > watch.leans
    if doubted:
        for i in range(3):
            C[GYRO + i, GYRO + i] += watch.gyroscope
            C[THETA + i, THETA + i] += watch.attitude
            watched[LEANING + i] = 0.0
    return doubted


@cached_njit
def watch_ranges(
    C: np.ndarray, watched: np.ndarray, layout: Layout, used: int, refused: int, longer: int, watch: Watch
) -> bool:
    """Open the error that all ranges have in common if they are refused on one side; return whether they are.

    Arguments as watch_angles, with what take_ranges in ranges.py returned of a message.
    """
    if used + refused < _FEWEST:
        return False
    watched[SIDED] += watch.share * (longer / (used + refused) - watched[SIDED])
    if abs(watched[SIDED]) <= watch.sided:
        return False
    C[layout.range_offset, layout.range_offset] += watch.offset
    watched[SIDED] = 0.0
    return True
