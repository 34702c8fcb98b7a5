"""A vehicle's landing, found afterwards by its IMU alone.

The vehicle rests if, over a window, body rates and upward force deviate by at most STILL, the force is gravity's, and
a jolt came in the second before: a hover may be as still, but has no jolt. The upward force less its mean at rest,
integrated backwards from there, is the downward speed, and integrated again the height. The vehicle touched the floor
when that height was last above TOUCHES.
"""

from typing import NamedTuple

import numpy as np

from ortilo_drake.interop.recorded.recording import GRAVITY, Imu

WINDOW = 0.2  # duration of the window [s]
STILL = (0.075, 0.15)  # largest standard deviations in a window: body rates [rad/s], upward force [m/s²]
OFF = 0.5  # largest difference of the mean force from gravity, for an accelerometer's bias [m/s²]
JOLT, SUDDEN, BEFORE = 4.0, 0.02, 1.0  # change of force [m/s²] within this time [s], so long before a window [s]
TOUCHES = 0.1  # height above the place of rest [m]
LONGEST = 5.0  # the height is followed back so long: it drifts [s]


class Landing(NamedTuple):
    """The time at which the vehicle touched the floor, and the time from which its rest there is known [s]."""

    touched: float
    rests: float


def landings(imu: Imu) -> list[Landing]:
    """Return the landings in order of time; the vehicle flew before each landing."""
    t, up = imu.t, imu.force[:, 2]
    step = float(np.median(np.diff(t)))
    n, before, sudden = max(3, round(WINDOW / step)), round(BEFORE / step), max(1, round(SUDDEN / step))
    if len(t) <= n + before:
        return []
    seen = np.column_stack([imu.rates, up - GRAVITY])
    mean = _means(seen, n)
    variance = np.maximum(_means(seen**2, n) - mean**2, 0.0)
    rates_sd, up_sd = np.sqrt(variance[:, :3].sum(axis=1)), np.sqrt(variance[:, 3])
    still = (rates_sd < STILL[0]) & (up_sd < STILL[1]) & (np.abs(mean[:, 3]) < OFF)
    found: list[Landing] = []
    for first in np.flatnonzero(still[1:] & ~still[:-1]) + 1:  # the first window of each rest
        rest = float(up[first : first + n].mean())
        touched = _touched(t[: first + 1], up[: first + 1] - rest)
        late = up[max(0, first - before) : first + 1]
        jolted = len(late) > sudden and np.abs(late[sudden:] - late[:-sudden]).max() > JOLT
        if jolted and touched is not None and (not found or touched > found[-1].rests):
            found.append(Landing(touched, float(t[first + n - 1])))
    return found


def _means(values: np.ndarray, n: int) -> np.ndarray:
    """Return the moving means over n rows (m - n + 1, k) of values (m, k)."""
    sums = np.cumsum(np.vstack([np.zeros((1, values.shape[1])), values]), axis=0)
    return np.asarray((sums[n:] - sums[:-n]) / n)


def _touched(t: np.ndarray, force: np.ndarray) -> float | None:
    """Return the last time at which the height exceeded TOUCHES [s]; None if it did not in the last LONGEST seconds."""
    late = t >= t[-1] - LONGEST
    back, force = t[late][::-1], force[late][::-1]
    steps = -np.diff(back)
    height = np.cumsum(np.cumsum(force[:-1] * steps) * steps)
    above = np.flatnonzero(height > TOUCHES)
    return float(back[above[0] + 1]) if len(above) else None
