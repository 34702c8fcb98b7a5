"""The watch of the tight filter: it detects lasting contradictions to the model and adds variance to the cause's state.

- A message with the same payload as the last one is not used: noise never repeats.
- Innovations of roll, pitch and yaw that stay on one side contradict the body rates: the gyroscope's bias has stepped.
- Ranges that are refused on one side only have a common error: the error of the clock.

If the filter's model is right, a mean of normalized innovations over a time T has the standard deviation
sqrt(a / (2 - a)), a = 1 - exp(-h / T); the threshold is many times larger. To "open" a state adds variance to it, so
that the next measurements correct it.
"""

from typing import Final, NamedTuple

import numpy as np

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.signals import PAYLOAD
from ortilo_drake.onboard.estimator.tight.layout import GYRO, THETA, Layout

# Parts of `watched`: means of the normalized innovations of the angles (3), mean of the share of ranges refused as too
# long less the share refused as too short, and from LAST on the last payloads.
LEANING: Final = 0
SIDED: Final = 3
LAST: Final = 4
_FEWEST: Final = 3  # smallest number of ranges that can show a common error


class Watch(NamedTuple):
    """The settings of the watch."""

    share: float
    """weight a of a new value in the means [1]."""
    leans: float
    """threshold on the mean normalized innovation of an angle, above which the gyroscope's bias opens [1]."""
    sided: float
    """threshold on the mean share of ranges refused on one side, above which the common error opens [1]."""
    gyroscope: float
    """variance added to the gyroscope's bias [rad^2/s^2]."""
    attitude: float
    """variance added to the attitude with it [rad^2]."""
    offset: float
    """variance added to the common error of all ranges [m^2]."""


@cached_njit
def says_again(message: np.ndarray, last: np.ndarray) -> bool:
    """Return whether a message's payload equals `last` (m) and has a number above 0; copies the payload to `last`."""
    same, says = True, False
    for i in range(last.size):
        value = message[PAYLOAD + i]
        same = same and value == last[i]
        says = says or value > 0.0
        last[i] = value
    return same and says


@cached_njit
def watch_angles(C: np.ndarray, watched: np.ndarray, normalized: np.ndarray, watch: Watch) -> bool:
    """Open the gyroscope's bias and the attitude if the angles' innovations stay on one side; return whether they do.

    `normalized` is e / sqrt(S) of this tick's angles (3). C and `watched` are changed.
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
    """Open the common error of all ranges if they are refused on one side; return whether they are.

    `used`, `refused` and `longer` come from take_ranges in ranges.py. Other arguments as in watch_angles.
    """
    if used + refused < _FEWEST:
        return False
    watched[SIDED] += watch.share * (longer / (used + refused) - watched[SIDED])
    if abs(watched[SIDED]) <= watch.sided:
        return False
    C[layout.range_offset, layout.range_offset] += watch.offset
    watched[SIDED] = 0.0
    return True
