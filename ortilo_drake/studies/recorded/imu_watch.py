"""The recorded filter's watch over its IMU: take-off, and an accelerometer that fails.

Until take-off, and after a landing (landing.py), the vehicle may be known to rest: then the filter integrates no force
and takes nothing else in. Take-off is told once the upward force, less its mean so far and SLACK, has added up to RISE
(Page's cumulative sum, Biometrika 41, 1954). A gentler take-off shows in the single ranges: their squared deviation
from each anchor's mean so far, over its variance, is on average above CHANGED. Rotors show sooner: once the upward
force varies from sample to sample SHAKEN times as much as in the first second, the next single range is taken as one in
flight. A vehicle whose rotors turn on the floor then flies by its ranges, which is harmless. Differences of ranges are
metres wrong on the floor, so with differences the rotors do not tell a take-off.

Where drag is given, the accelerometer is checked axis by axis. A sample farther than `doubted` from drag's force is not
used; an axis with more than a share FAILS of such samples in a second is not used any more. Drag's force replaces it.
Where both agree, their mean difference over AVERAGED is a row: the force tells the velocity. They agree while that
row's squared innovation over its variance is on average below AGREES; a body that no rotor carries has no drag.

`watched` is State's; RESTS to SHAKES are indices into it.
"""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.onboard.estimator.tight.drag import along_body
from ortilo_drake.onboard.estimator.tight.inertial import matrix_of
from ortilo_drake.onboard.estimator.tight.layout import ACCEL, THETA, P, Q, V
from ortilo_drake.studies.recorded.filter_types import Aids

RESTS, ROSE, SHARE, SINCE, LASTS, DIFFERS, HELD, MISFIT, CHANGE = 0, 1, 2, 4, 6, 7, 9, 11, 13
LAST_UP, QUIET, SHAKES, WATCHED = 14, 15, 16, 17
SLACK, RISE = 0.15, 0.2  # excess of the upward force that still is rest [m/s²]; upward speed that tells take-off [m/s]
OFF = (0.05, 0.2)  # standard deviations of position and velocity that take-off adds [m], [m/s]
CHANGED, COUNTED, LATELY = 4.0, 50, 100  # mean square that tells take-off; ranges in it; ranges in an anchor's mean
VARIES = 0.1  # standard deviation of ranges at rest, beside the white noise [m]
SHAKEN, LEAST_SHAKEN = 9.0, 0.05  # rotors turn at so many times the variance at rest; its least deviation [m/s²]
FIRST, SHORT = 1.0, 0.2  # time in which the variance at rest is taken, and time constant of the present one [s]
GONE = (1.0, 0.5)  # as OFF, for a take-off that the ranges show
USUAL, SETTLES = 0.5, 0.5  # bound of the mean force at rest less gravity [m/s²]; that mean settles in this time [s]
SPAN, FAILS = 1.0, 0.1  # an axis fails at this share of doubted samples, averaged over so long [s]
UNKNOWN = 0.3  # standard deviation of the force that drag then does not explain [m/s²]
AVERAGED, LONGEST = 0.1, 0.01  # force less drag is averaged over this time; a sample counts for so long, at most [s]
AGREES, AGREED_FOR, MOST = 2.0, 2.0, 9.0  # they agree below this mean of e²/S, over so long [s]; bound of one e²/S


def watched_from(rests: bool) -> np.ndarray:
    """Return State's `watched` at the start: nothing is doubted, and drag does not yet agree with the force."""
    watched = np.zeros(WATCHED)
    watched[RESTS], watched[SINCE : SINCE + 2], watched[MISFIT : MISFIT + 2] = rests, np.inf, 2.0 * AGREES
    return watched


@register_jitable
def watch_rest(x: np.ndarray, C: np.ndarray, watched: np.ndarray, up: float, h: float) -> None:
    """Add up the upward force (up [m/s²], for h [s]) of a vehicle at rest, and tell its take-off."""
    if watched[HELD] > 0.0:
        varies = (up - watched[LAST_UP]) ** 2 / 2.0
        if watched[HELD] < FIRST:
            watched[QUIET] += h / (watched[HELD] + h) * (varies - watched[QUIET])
        watched[SHAKES] += min(1.0, h / SHORT) * (varies - watched[SHAKES])
    watched[LAST_UP] = up
    usual = GRAVITY + min(max(watched[DIFFERS] / (watched[HELD] + SETTLES), -USUAL), USUAL)
    watched[DIFFERS], watched[HELD] = watched[DIFFERS] + h * (up - GRAVITY), watched[HELD] + h
    watched[ROSE] = max(0.0, watched[ROSE] + h * (up - usual - SLACK))
    watched[LASTS] = watched[LASTS] + h if watched[ROSE] > 0.0 else 0.0
    if watched[ROSE] > RISE:  # take-off, as if the force had been constant since the sum was 0
        watched[RESTS], x[V + 2] = 0.0, watched[ROSE] + (SLACK + usual - GRAVITY) * watched[LASTS]
        x[P + 2] += x[V + 2] * watched[LASTS] / 2.0
        _take_off(C, watched, OFF)


@register_jitable
def watch_range(e: float, variance: float, C: np.ndarray, watched: np.ndarray, usual: np.ndarray) -> None:
    """Tell the take-off of a vehicle at rest if its ranges change or its rotors turn.

    Args:
        e: a single range less the range expected where the vehicle rests [m].
        variance: of the range's white noise [m²].
        C: the covariance (N, N); changed.
        watched: State's; changed.
        usual: the mean of this anchor's e [m] and the number of ranges in it (2); changed.
    """
    if usual[1] > 0.0:
        squared = (e - usual[0]) ** 2 / ((1.0 + 1.0 / usual[1]) * (variance + VARIES**2))
        watched[CHANGE] += (min(squared, MOST) - watched[CHANGE]) / COUNTED
    usual[1] = min(usual[1] + 1.0, LATELY)
    usual[0] += (e - usual[0]) / usual[1]
    turn = watched[HELD] > FIRST and watched[SHAKES] > SHAKEN * max(watched[QUIET], LEAST_SHAKEN**2)
    if turn or watched[CHANGE] > CHANGED:
        watched[RESTS] = 0.0
        _take_off(C, watched, OFF if turn else GONE)


@register_jitable
def _take_off(C: np.ndarray, watched: np.ndarray, sd: tuple[float, float]) -> None:
    for i in range(3):
        C[P + i, P + i] += sd[0] ** 2
        C[V + i, V + i] += sd[1] ** 2
    watched[DIFFERS], watched[HELD] = 0.0, 0.0


@register_jitable
def rest_again(watched: np.ndarray, usual: np.ndarray) -> None:
    """Let the vehicle rest until its force or its ranges show the take-off; `usual` (n, 2) is counted anew."""
    watched[RESTS], watched[ROSE], watched[LASTS], watched[CHANGE] = 1.0, 0.0, 0.0, 0.0
    watched[DIFFERS : HELD + 2], watched[LAST_UP:] = 0.0, 0.0
    usual[:] = 0.0


@register_jitable
def doubt_force(
    f: np.ndarray, x: np.ndarray, C: np.ndarray, watched: np.ndarray, t: float, h: float, aids: Aids
) -> None:
    """Replace the doubted axes of a force sample f (3) by drag's force, and count them; an axis may fail."""
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
        elif watched[SINCE + i] == np.inf:
            watched[DIFFERS + i] += min(h, LONGEST) * (f[i] - made)
            watched[HELD + i] += min(h, LONGEST)


@register_jitable
def force_row(x: np.ndarray, R: np.ndarray, i: int, watched: np.ndarray, where: np.ndarray, row: np.ndarray) -> float:
    """Write the row of b_a - k v_B along axis i (eight entries), and return its innovation, the mean force less it."""
    v, k, last = x[V : V + 3], x[-1], len(x) - 2
    a, b = (i + 1) % 3, (i + 2) % 3
    for j in range(3):
        where[j], row[j] = V + j, -k * R[j, i]
        where[3 + j], row[3 + j] = THETA + j, 0.0
    row[3 + a], row[3 + b] = k * along_body(R, v, b), -k * along_body(R, v, a)
    where[6], row[6] = ACCEL + i, 1.0
    where[7], row[7] = last, -along_body(R, v, i)
    return float(watched[DIFFERS + i] / watched[HELD + i])


@register_jitable
def force_agrees(watched: np.ndarray, i: int, squared: float) -> bool:
    """Return whether force and drag along axis i agree; squared: e²/S of their row, whose averaging begins anew."""
    watched[MISFIT + i] += watched[HELD + i] / AGREED_FOR * (min(squared, MOST) - watched[MISFIT + i])
    watched[DIFFERS + i], watched[HELD + i] = 0.0, 0.0
    return bool(watched[MISFIT + i] < AGREES)
