"""The recorded filter's watch over its IMU: take-off, and an accelerometer that fails.

Until take-off, and after a landing (landing.py), the vehicle may be known to rest: then no force is integrated and
nothing else is taken in. Take-off is where the force upward, less gravity and SLACK, has added up to RISE (Page's
cumulative sum, Biometrika 41, 1954).

Where drag is given, an accelerometer is checked axis by axis: a sample farther than `doubted` from drag's force is not
used, and an axis with more than a share FAILS of such samples in a second is not used any more. Drag takes its place.

`watched` is State's; RESTS and so on are indices into it.
"""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.onboard.estimator.tight.drag import along_body
from ortilo_drake.onboard.estimator.tight.inertial import matrix_of
from ortilo_drake.onboard.estimator.tight.layout import ACCEL, P, Q, V
from ortilo_drake.studies.recorded.filter_types import Aids

RESTS, ROSE, SHARE, SINCE, LASTS = 0, 1, 2, 4, 6
SLACK, RISE = 0.15, 0.2  # of the force upward at rest [m/s²], and of the speed upward that is no rest [m/s]
OFF = (0.05, 0.2)  # standard deviations of position and velocity that take-off adds [m], [m/s]
SPAN, FAILS = 1.0, 0.1  # share of doubted samples over so long [s] at which an axis has failed
UNKNOWN = 0.3  # standard deviation of what drag does not tell of the force then [m/s²]


@register_jitable
def watch_rest(x: np.ndarray, C: np.ndarray, watched: np.ndarray, up: float, h: float) -> None:
    """Add up the force upward (up [m/s²], for h [s]) of a vehicle at rest, and let it take off."""
    watched[ROSE] = max(0.0, watched[ROSE] + h * (up - GRAVITY - SLACK))
    watched[LASTS] = watched[LASTS] + h if watched[ROSE] > 0.0 else 0.0
    if watched[ROSE] > RISE:  # off, as if the force had been one since the sum was 0
        watched[RESTS], x[V + 2] = 0.0, watched[ROSE] + SLACK * watched[LASTS]
        x[P + 2] += x[V + 2] * watched[LASTS] / 2.0
        for i in range(3):
            C[P + i, P + i] += OFF[0] ** 2
            C[V + i, V + i] += OFF[1] ** 2


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
