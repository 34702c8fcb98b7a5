"""The imu's biases that are still unknown after standing still before take-off.

While the vehicle rests on the floor for T seconds the imu takes N samples. Gyroscope and accelerometer are then zeroed:
what they said on average is taken off all that they say in flight, but for gravity as it stands by the imu's own roll
and pitch, whose average errs by beta + nu_rpy. What is left of the biases is

    c = -nu_g,    b = -R_z(psi) g [beta + nu_rpy]_(theta, -phi, 0) - nu_a

each nu of variance V / N + q^2 T / 3: V is that of a sample, and the average over T of a bias that walks at the rate q
ends sd q sqrt(T / 3) beside its last value. So b is as unknown as the imu's level; but a filter that goes by that level
has the tilt wrong by -beta, and b less the acceleration of a tilt is what moves its position without a fix: of that
beta is gone.
"""

from typing import NamedTuple

import numpy as np

from ortilo_drake.model.hover import hover_A
from ortilo_drake.scenario import Belief


class Rest(NamedTuple):
    """A vehicle's rest before take-off."""

    samples: int
    """how many the imu took."""
    time: float
    """for how long [s]."""
    period: float
    """of how long a sample has the noise [s]."""

    def variance(self, of_sample: np.ndarray | float, rate: float) -> np.ndarray:
        """Return the variance of nu per axis (3), from that of a sample and the rate of the bias's random walk."""
        return np.broadcast_to(of_sample, 3) / self.samples + rate**2 * self.time / 3.0


def rest_of(belief: Belief) -> Rest | None:
    """Return the standstill of a scenario before take-off; None if there is none."""
    samples = belief.samples_at_rest
    return Rest(samples, belief.imu.standstill, belief.imu_period) if samples else None


def zero_gyroscope(P: np.ndarray, c: int, variance: np.ndarray) -> None:
    """Change a first covariance P (n, n), biases from c on, to that after zeroing; nu_g has that variance (3)."""
    own = slice(c, c + 3)
    P[own], P[:, own] = 0.0, 0.0
    P[own, own] = np.diag(variance)


def zero_accelerometer(
    P: np.ndarray, b: int, beta: list[int], variance: np.ndarray, level_variance: np.ndarray, yaw: float = 0.0
) -> None:
    """Change a first covariance P (n, n), biases from b on, to that after the accelerometer was zeroed.

    beta is where the biases of roll, pitch and yaw stand, -1 for one that is believed to be 0. The variances are of
    nu_a (3) and nu_rpy (3), the yaw is psi [rad], 0 for a bias in B.
    """
    own, T, tilted = slice(b, b + 3), np.eye(len(P)), -hover_A(yaw)[6:9, 3:6]
    T[own] = 0.0
    for i, at in enumerate(beta):
        if at >= 0:
            T[own, at] = tilted[:, i]
    P[:] = T @ P @ T.T
    P[own, own] += tilted @ np.diag(level_variance) @ tilted.T + np.diag(variance)
