"""A vehicle's landing, found afterwards by its IMU alone.

It rests where over a window body rates and force upward deviate by no more than STILL and the force is gravity's, if
it was jolted in the second before: a hover may be as still, but nothing jolts it. The force upward, less its mean at
rest, integrated from there back is the speed downward, and that again the height: the vehicle touched the floor when it
was last above TOUCHES.
"""

from typing import NamedTuple

import numpy as np

from ortilo_drake.interop.recorded.recording import GRAVITY, Imu

WINDOW = 0.2  # [s]
STILL = (0.075, 0.15)  # standard deviations over it: of the body rates [rad/s], of the force upward [m/s²]
OFF = 0.5  # of the force's mean from gravity: an accelerometer's bias [m/s²]
JOLT, SUDDEN, BEFORE = 4.0, 0.02, 1.0  # of the force [m/s²], within so short a time [s], so long before the window [s]
TOUCHES = 0.1  # height above the place of rest [m]
LONGEST = 5.0  # before the rest that the height is looked for [s]: it drifts


class Landing(NamedTuple):
    """The times at which the vehicle touched the floor, and at which its rest there is known [s]."""

    touched: float
    rests: float


def landings(imu: Imu) -> list[Landing]:
    """Return the landings in order; the vehicle flew before each."""
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
    for first in np.flatnonzero(still[1:] & ~still[:-1]) + 1:  # windows that begin with it
        rest = float(up[first : first + n].mean())
        touched = _touched(t[: first + 1], up[: first + 1] - rest)
        late = up[max(0, first - before) : first + 1]
        jolted = len(late) > sudden and np.abs(late[sudden:] - late[:-sudden]).max() > JOLT
        if jolted and touched is not None and (not found or touched > found[-1].rests):
            found.append(Landing(touched, float(t[first + n - 1])))
    return found


def _means(values: np.ndarray, n: int) -> np.ndarray:
    """Return the means over each n values in a row (m - n + 1, k) of m rows (m, k)."""
    sums = np.cumsum(np.vstack([np.zeros((1, values.shape[1])), values]), axis=0)
    return np.asarray((sums[n:] - sums[:-n]) / n)


def _touched(t: np.ndarray, force: np.ndarray) -> float | None:
    """Return the last time at which the height exceeded TOUCHES; None if it did not, as long as it can be followed."""
    late = t >= t[-1] - LONGEST
    back, force = t[late][::-1], force[late][::-1]
    steps = -np.diff(back)
    height = np.cumsum(np.cumsum(force[:-1] * steps) * steps)
    above = np.flatnonzero(height > TOUCHES)
    return float(back[above[0] + 1]) if len(above) else None
