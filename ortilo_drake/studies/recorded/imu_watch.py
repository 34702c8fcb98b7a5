"""The recorded filter's watch over its IMU: take-off, and an accelerometer that fails.

Until take-off, and after a landing (landing.py), the vehicle may be known to rest: then no force is integrated and
nothing else is taken in. Take-off is where the force upward, less its mean so far and SLACK, has added up to RISE
(Page's cumulative sum, Biometrika 41, 1954). A take-off that is gentler shows in the single ranges: their squared
deviation from each anchor's mean so far, over its variance, is on average above CHANGED. Rotors show sooner: once the
force upward varies from sample to sample SHAKEN times as much as in the first second, the next single range is taken as
one in flight. A vehicle whose rotors turn on the floor then flies by its ranges, which is harmless. Differences of
ranges are metres wrong on the floor: for them the rotors are no take-off.

Where drag is given, an accelerometer is checked axis by axis: a sample farther than `doubted` from drag's force is not
used, and an axis with more than a share FAILS of such samples in a second is not used any more. Drag takes its place.
Where both agree, their mean difference over AVERAGED is a row: the force tells the velocity. They agree while that
row's squared innovation, divided by its variance, is on average below AGREES; a body that no rotor carries has no drag.

`watched` is State's; RESTS and so on are indices into it.
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
SLACK, RISE = 0.15, 0.2  # of the force upward at rest [m/s²], and of the speed upward that is no rest [m/s]
OFF = (0.05, 0.2)  # standard deviations of position and velocity that take-off adds [m], [m/s]
CHANGED, COUNTED, LATELY = 4.0, 50, 100  # mean square that shows it, over so many ranges; a mean is of so many
VARIES = 0.1  # standard deviation of ranges at rest, beside the white noise [m]
SHAKEN, LEAST_SHAKEN = 9.0, 0.05  # variance of the force over that at rest, which is no less than of so much [m/s²]
FIRST, SHORT = 1.0, 0.2  # the force varies at rest as it does at first, and now as it did lately, so long [s]
GONE = (1.0, 0.5)  # as OFF, of a take-off that the ranges show
USUAL, SETTLES = 0.5, 0.5  # a mean force at rest is no farther from gravity [m/s²], and is known after so long [s]
SPAN, FAILS = 1.0, 0.1  # share of doubted samples over so long [s] at which an axis has failed
UNKNOWN = 0.3  # standard deviation of what drag does not tell of the force then [m/s²]
AVERAGED, LONGEST = 0.1, 0.01  # force less drag is averaged over so long, a sample counts for no more than [s]
AGREES, AGREED_FOR, MOST = 2.0, 2.0, 9.0  # mean of e²/S up to which they agree, over so long [s]; no more of one counts


def watched_from(rests: bool) -> np.ndarray:
    """Return State's `watched` at the start: nothing is doubted, and drag has yet to agree with the force."""
    watched = np.zeros(WATCHED)
    watched[RESTS], watched[SINCE : SINCE + 2], watched[MISFIT : MISFIT + 2] = rests, np.inf, 2.0 * AGREES
    return watched


@register_jitable
def watch_rest(x: np.ndarray, C: np.ndarray, watched: np.ndarray, up: float, h: float) -> None:
    """Add up the force upward (up [m/s²], for h [s]) of a vehicle at rest, and let it take off."""
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
    if watched[ROSE] > RISE:  # off, as if the force had been one since the sum was 0
        watched[RESTS], x[V + 2] = 0.0, watched[ROSE] + (SLACK + usual - GRAVITY) * watched[LASTS]
        x[P + 2] += x[V + 2] * watched[LASTS] / 2.0
        _take_off(C, watched, OFF)


@register_jitable
def watch_range(e: float, variance: float, C: np.ndarray, watched: np.ndarray, usual: np.ndarray) -> None:
    """Let a vehicle at rest take off whose ranges change, or whose rotors turn.

    Args:
        e: a single range less the one expected where the vehicle rests [m].
        variance: of white noise [m²].
        C: the covariance (N, N), changed.
        watched: as State has it, changed.
        usual: of this anchor the mean of e [m] and how many it is of (2), changed.
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
    """Let the vehicle rest until its specific force, or its ranges' change from here on (n, 2), show the take-off."""
    watched[RESTS], watched[ROSE], watched[LASTS], watched[CHANGE] = 1.0, 0.0, 0.0, 0.0
    watched[DIFFERS : HELD + 2], watched[LAST_UP:] = 0.0, 0.0
    usual[:] = 0.0


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
        elif watched[SINCE + i] == np.inf:
            watched[DIFFERS + i] += min(h, LONGEST) * (f[i] - made)
            watched[HELD + i] += min(h, LONGEST)


@register_jitable
def force_row(x: np.ndarray, R: np.ndarray, i: int, watched: np.ndarray, where: np.ndarray, row: np.ndarray) -> float:
    """Write the row of b_a - k v_B along axis i, of eight entries, and return the mean of the force less it."""
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
    """Return whether force and drag along axis i agree so far; squared is e²/S of their row, which begins anew."""
    watched[MISFIT + i] += watched[HELD + i] / AGREED_FOR * (min(squared, MOST) - watched[MISFIT + i])
    watched[DIFFERS + i], watched[HELD + i] = 0.0, 0.0
    return bool(watched[MISFIT + i] < AGREES)
