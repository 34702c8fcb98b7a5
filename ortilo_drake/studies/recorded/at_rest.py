"""The IMU at rest before a recorded motion: it tells the gyro's bias, and b_a + g x level error.

With R = R_0 exp([theta]x) and R_0 the believed level, the mean samples over `imu.standstill` seconds are

    w_0 = b_g + nu_g,   f_0 - R_0^T g e_z = b_a + (R_0^T g e_z) x theta + nu_a

to first order in theta. The first row is the gyro's bias. The second is the accelerometer's bias plus gravity turned by
a wrong level. Only this sum is known, and only this sum moves a body without ranges.
nu has the variance s^2 / M + q^2 T / 3. Here s is the spread of M means over half a second; noise that is correlated
for less time widens s as it should. q is the bias's random walk: its end deviates from its mean by q sqrt(T / 3) (sd).
"""

from dataclasses import dataclass

import numpy as np

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.recording import GRAVITY, Imu, Recording
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.estimator.kalman import measure
from ortilo_drake.onboard.estimator.tight.inertial import matrix_of, turn
from ortilo_drake.onboard.estimator.tight.layout import GYRO, THETA, Q

BLOCK = 0.5  # means over this time are compared [s]
TURNS, SHAKES = 0.02, 0.2  # a body moves if a block's mean is farther from the mean: of rates [rad/s], force [m/s²]
TILT, BIAS = 0.05, 0.3  # standard deviations of a tilt [rad] and of the accelerometer's bias [m/s²]
AT_REST = 1.0  # the samples of this first time tell the body's tilt [s]
FAST = 0.2  # larger mean rates mean that the body turns: no gyro has such a bias [rad/s]


@dataclass(frozen=True)
class AtRest:
    """The imu's means at rest, body axes.

    end: the end of the rest by the recording's clock [s]; samples: number of gyro samples; rates, force: the means w_0
    [rad/s] and f_0 [m/s²], and their standard deviations (3 each); strays: the largest distances of a mean over half a
    second from w_0 and f_0.
    """

    end: float
    samples: int
    rates: tuple[float, ...]
    rates_sd: tuple[float, ...]
    force: tuple[float, ...]
    force_sd: tuple[float, ...]
    strays: tuple[float, float]


def at_rest(recording: Recording, map_: Map) -> AtRest | None:
    """Return the imu's means while it stands still; None if the map gives no standstill.

    Raises:
        InputError: if a part of that time has no samples.
    """
    imu = recording.imu
    if imu is None or map_.imu is None or map_.imu.standstill == 0.0:
        return None
    begin, lasts = float(imu.t[0]), map_.imu.standstill
    rates, rates_sd, turns = _mean(imu.t, imu.rates, begin, lasts, map_.filter.rotation_bias)
    t, f = imu.accelerometer or (imu.t, imu.force)
    force, force_sd, shakes = _mean(t, f, begin, lasts, map_.filter.acceleration_bias)
    samples = int(np.sum(imu.t < begin + lasts))
    return AtRest(begin + lasts, samples, rates, rates_sd, force, force_sd, (turns, shakes))


def _mean(
    t: np.ndarray, its: np.ndarray, begin: float, lasts: float, walk: float
) -> tuple[tuple[float, ...], tuple[float, ...], float]:
    """Return the mean (3) of samples (n, 3), its standard deviation (3), and the farthest block mean's distance."""
    blocks = int(lasts / BLOCK)
    block = np.floor((t - begin) / lasts * blocks)
    inside = [its[block == i] for i in range(blocks)]
    if not all(len(part) for part in inside):
        raise InputError(
            f"imu.standstill: {lasts:g}: there are no samples of the imu for some of its first {lasts:g} s"
        )
    means = np.array([part.mean(axis=0) for part in inside])
    mean = means.mean(axis=0)
    variance = means.var(axis=0, ddof=1) / blocks + walk**2 * lasts / 3.0
    return tuple(mean.tolist()), tuple(np.sqrt(variance).tolist()), float(np.abs(means - mean).max())


def first_tilt(imu: Imu, rest: AtRest | None = None) -> np.ndarray:
    """Return the attitude R_WB with heading 0 (3, 3), by the unit's own tilt if it has one, else by the specific force.

    Both are means over the first second, or over the time at rest.
    """
    early = imu.t <= (imu.t[0] + AT_REST if rest is None else rest.end)
    up_B = imu.force[early].mean(axis=0) if imu.attitude is None else imu.attitude[early][:, 2, :].mean(axis=0)
    up_B = up_B / np.linalg.norm(up_B)
    forward = np.array([1.0, 0.0, 0.0]) - up_B[0] * up_B
    forward = forward / np.linalg.norm(forward)
    return np.vstack([forward, np.cross(up_B, forward), up_B])


def tilt_deviation(imu: Imu) -> float:
    """Return the standard deviation of the tilt of `first_tilt` [rad]; acceleration makes it larger.

    A horizontal acceleration a turns the specific force by a / G and makes its size sqrt(G² + a²); a bias may do both.
    """
    if imu.attitude is not None:
        return TILT
    force = float(np.linalg.norm(imu.force[imu.t <= imu.t[0] + AT_REST].mean(axis=0)))
    return max(TILT, float(np.sqrt(max(0.0, force**2 - (GRAVITY + BIAS) ** 2))) / GRAVITY)


def tilt_disagreement(imu: Imu) -> float | None:
    """Return the angle between the unit's own up and the specific force at the start [rad]; None without attitudes."""
    if imu.attitude is None:
        return None
    force = imu.force[imu.t <= imu.t[0] + AT_REST].mean(axis=0)
    return float(np.arccos(np.clip(first_tilt(imu)[2] @ force / np.linalg.norm(force), -1.0, 1.0)))


def unlevel(rest: AtRest, R: np.ndarray) -> np.ndarray:
    """Return b_a + g x level error [m/s²] (3), body axes, for the believed attitude R_WB (3, 3)."""
    return np.asarray(rest.force) - GRAVITY * R[2]


def correct_by_rest(rest: AtRest, x: np.ndarray, C: np.ndarray) -> None:
    """Correct a filter's first nominal state x and its covariance C (both changed) by the means at rest."""
    R = matrix_of(x[Q : Q + 4])
    states = np.array([[at, THETA, THETA + 1, THETA + 2] for at in range(GYRO, GYRO + 6)])  # ACCEL comes after GYRO
    weights = np.zeros((6, 4))
    weights[:, 0] = 1.0
    weights[3:, 1:] = np.cross(np.eye(3), GRAVITY * R[2])  # theta -> (R^T g e_z) x theta
    e = np.concatenate([np.asarray(rest.rates) - x[Q + 4 : Q + 7], unlevel(rest, R) - x[Q + 7 : Q + 10]])
    V = np.diag(np.square([*rest.rates_sd, *rest.force_sd])).ravel()
    by = np.zeros(len(C))
    measure(by, C, e, V, 6, 0, states, weights, np.empty((6, 6)), np.empty((6, len(C) + 1)))
    x[Q + 4 : Q + 10] += by[GYRO : GYRO + 6]
    turn(x[Q : Q + 4], *by[THETA : THETA + 3])


def at_rest_text(rest: AtRest, imu: Imu, on_floor: bool) -> str:
    """Return a sentence on the gyro's bias and the force at rest, given the believed level."""
    R = np.eye(3) if on_floor else first_tilt(imu, rest)
    by = "the floor" if on_floor else "the force itself" if imu.attitude is None else "the unit's attitude"
    rates, off = (", ".join(f"{value:.5f}" for value in values) for values in (rest.rates, unlevel(rest, R)))
    rates_sd, sd = (", ".join(f"{value:.2g}" for value in values) for values in (rest.rates_sd, rest.force_sd))
    return (
        f"Standing still, {rest.samples} samples: gyro bias ({rates}) rad/s, sd ({rates_sd}); accelerometer bias and "
        f"what a wrong level makes of gravity, together ({off}) m/s², sd ({sd}), body axes, level by {by}"
    )


def standstill_doubts(rest: AtRest | None) -> list[str]:
    """Return a doubt if the imu moves while it should stand still."""
    if rest is None:
        return []
    turns, shakes = rest.strays
    if turns <= TURNS and shakes <= SHAKES and max(map(abs, rest.rates)) <= FAST:
        return []
    return [
        f"imu.standstill: it does not stand still until {rest.end:.1f} s: means over {BLOCK:g} s of the body rates "
        f"differ by up to {turns:.2g} rad/s from ({', '.join(f'{rate:.2g}' for rate in rest.rates)}), of the force by "
        f"{shakes:.2g} m/s²: a shorter time?"
    ]
