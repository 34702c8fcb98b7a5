"""The watch over a recorded IMU: take-off, an accelerometer that fails, and a landing, found afterwards.

Until take-off, and after a landing, the vehicle may be known to rest: then no force is integrated and
nothing else is taken in. Take-off is where the force upward, less gravity and SLACK, has added up to RISE (Page's
cumulative sum, Biometrika 41, 1954).

Where drag is given, an accelerometer is checked axis by axis: a sample farther than `doubted` from drag's force is not
used, and an axis with more than a share FAILS of such samples in a second is not used any more. Drag takes its place.

`watched` is State's; RESTS and so on are indices into it.

A vehicle has landed where over a window body rates and force upward deviate by no more than STILL and the force is
gravity's, if it was jolted in the second before: a hover may be as still, but nothing jolts it. The force upward, less
its mean at rest, integrated from there back is the speed downward, and that again the height: the vehicle touched the
floor when it was last above TOUCHES.
"""

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.interop.recorded.recording import Imu
from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.onboard.estimator.tight.drag import along_body
from ortilo_drake.onboard.estimator.tight.inertial import matrix_of
from ortilo_drake.onboard.estimator.tight.layout import ACCEL, P, Q, V
from ortilo_drake.studies.recorded.filter_types import Aids

RESTS, ROSE, SHARE, SINCE, LASTS = 0, 1, 2, 4, 6
SLACK, RISE = 0.15, 0.2  # of the force upward at rest [m/s²], and of the speed upward that is no rest [m/s]
LIFTED = (0.05, 0.2)  # standard deviations of position and velocity that take-off adds [m], [m/s]
SPAN, FAILS = 1.0, 0.1  # share of doubted samples over so long [s] at which an axis has failed
UNKNOWN = 0.3  # standard deviation of what drag does not tell of the force then [m/s²]
WINDOW = 0.2  # [s]
STILL = (0.075, 0.15)  # standard deviations over it: of the body rates [rad/s], of the force upward [m/s²]
OFF = 0.5  # of the force's mean from gravity: an accelerometer's bias [m/s²]
JOLT, SUDDEN, BEFORE = 4.0, 0.02, 1.0  # of the force [m/s²], within so short a time [s], so long before the window [s]
TOUCHES = 0.1  # height above the place of rest [m]
LONGEST = 5.0  # before the rest that the height is looked for [s]: it drifts


@register_jitable
def watch_rest(x: np.ndarray, C: np.ndarray, watched: np.ndarray, up: float, h: float) -> None:
    """Add up the force upward (up [m/s²], for h [s]) of a vehicle at rest, and let it take off."""
    watched[ROSE] = max(0.0, watched[ROSE] + h * (up - GRAVITY - SLACK))
    watched[LASTS] = watched[LASTS] + h if watched[ROSE] > 0.0 else 0.0
    if watched[ROSE] > RISE:  # off, as if the force had been one since the sum was 0
        watched[RESTS], x[V + 2] = 0.0, watched[ROSE] + SLACK * watched[LASTS]
        x[P + 2] += x[V + 2] * watched[LASTS] / 2.0
        for i in range(3):
            C[P + i, P + i] += LIFTED[0] ** 2
            C[V + i, V + i] += LIFTED[1] ** 2


@register_jitable
def rest_again(watched: np.ndarray) -> None:
    """Let the vehicle rest until its specific force shows the take-off."""
    watched[RESTS], watched[ROSE], watched[LASTS] = 1.0, 0.0, 0.0


@register_jitable
def doubt_force(
    f: np.ndarray, x: np.ndarray, C: np.ndarray, watched: np.ndarray, t: float, h: float, aids: Aids
) -> None:
    """Replace a doubted sample's axis by drag's force (3), and count it; an axis may fail."""
    R = matrix_of(x[Q : Q + 4])
    for i in range(2):
        made = x[Q + 7 + i] - x[-1] * along_body(R, x[V : V + 3], i)
        doubted = not abs(f[i] - made) <= aids.doubted
        if watched[SINCE + i] == np.inf:
            watched[SHARE + i] += min(1.0, h / SPAN) * (doubted - watched[SHARE + i])
            if watched[SHARE + i] > FAILS:
                watched[SINCE + i] = t
                x[Q + 7 + i] = 0.0
                C[ACCEL + i, ACCEL + i] += UNKNOWN**2
        if doubted:
            f[i] = made


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
