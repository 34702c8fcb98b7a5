"""The errors of the imu's biases that remain after the vehicle stood still before take-off.

The vehicle rests on the floor for T seconds, and the imu takes N samples. Then gyroscope and accelerometer are zeroed:
their mean is subtracted from all samples in flight. From the accelerometer's mean, gravity is removed first, at the
imu's own mean roll and pitch, which have the error beta + nu_rpy. The remaining biases are

    c = -nu_g,    b = -R_z(psi) g [beta + nu_rpy]_(theta, -phi, 0) - nu_a

with each nu of variance V / N + q^2 T / 3. V is the variance of one sample; the mean over T of a bias that walks at the
rate q differs from the bias's last value by sd q sqrt(T / 3). So b is as uncertain as the imu's level. But a filter
that uses this level has its tilt wrong by -beta, and without fixes b less the acceleration of the tilt error moves the
position: in this difference beta cancels.
"""

from typing import NamedTuple

import numpy as np

from ortilo_drake.model.hover import hover_A
from ortilo_drake.scenario import Belief


class Rest(NamedTuple):
    """The vehicle's standstill before take-off."""

    samples: int
    """number of samples that the imu took."""
    time: float
    """duration [s]."""
    period: float
    """interval for which one sample's noise is given [s]."""

    def variance(self, of_sample: np.ndarray | float, rate: float) -> np.ndarray:
        """Return the variance of nu per axis (3), given one sample's variance and the rate of the bias's walk."""
        return np.broadcast_to(of_sample, 3) / self.samples + rate**2 * self.time / 3.0


def rest_of(belief: Belief) -> Rest | None:
    """Return the scenario's standstill before take-off; None if there is none."""
    samples = belief.samples_at_rest
    return Rest(samples, belief.imu.standstill, belief.imu_period) if samples else None


def zero_gyroscope(P: np.ndarray, c: int, variance: np.ndarray) -> None:
    """Set the gyroscope biases (from index c on) in the initial P (n, n) to the `variance` (3) of nu_g."""
    own = slice(c, c + 3)
    P[own], P[:, own] = 0.0, 0.0
    P[own, own] = np.diag(variance)


def zero_accelerometer(
    P: np.ndarray, b: int, beta: list[int], variance: np.ndarray, level_variance: np.ndarray, yaw: float = 0.0
) -> None:
    """Replace the accelerometer biases (from index b on) in the initial P (n, n) by those left after zeroing.

    beta holds the indices of the biases of roll, pitch and yaw, -1 for one assumed 0. `variance` is of nu_a (3),
    level_variance of nu_rpy (3). The yaw is psi [rad]; 0 gives the bias in B.
    """
    own, T, tilted = slice(b, b + 3), np.eye(len(P)), -hover_A(yaw)[6:9, 3:6]
    T[own] = 0.0
    for i, at in enumerate(beta):
        if at >= 0:
            T[own, at] = tilted[:, i]
    P[:] = T @ P @ T.T
    P[own, own] += tilted @ np.diag(level_variance) @ tilted.T + np.diag(variance)
