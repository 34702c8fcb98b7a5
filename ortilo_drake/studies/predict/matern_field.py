"""A Matérn field in space, drawn by random features (Rahimi and Recht, NIPS 2007).

    f(p) = sd sqrt(2 / M) sum_m cos(w_m . p + u_m),   covariance sd² (1 + d) exp(-d),   d = sqrt(3) |p - q| / length

The spectral density of the Matérn 3/2 kernel is that of Student's t with three degrees of freedom, so w = z / length
sqrt(3 / chi²_3) with z standard normal (3).
"""

from typing import NamedTuple

import numpy as np

FEATURES = 200


class MaternField(NamedTuple):
    """Frequencies (M, 3) [rad/m] and phases (M) [rad], and the amplitude of each feature (M)."""

    w: np.ndarray
    u: np.ndarray
    amplitude: np.ndarray

    def at(self, p: np.ndarray) -> np.ndarray:
        """Return the field at places (k, 3)."""
        return np.asarray(np.cos(p @ self.w.T + self.u) @ self.amplitude)


def draw_frequencies(
    rng: np.random.Generator, length: float, features: int = FEATURES
) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies (M, 3) and phases (M) of a field of a length [m]."""
    z, chi = rng.standard_normal((features, 3)), rng.chisquare(3.0, features)
    return z / length * np.sqrt(3.0 / chi)[:, None], rng.uniform(0.0, 2.0 * np.pi, features)


def draw_field(rng: np.random.Generator, length: float, sd: float, features: int = FEATURES) -> MaternField:
    """Return a field drawn."""
    w, u = draw_frequencies(rng, length, features)
    amplitude = sd * np.sqrt(2.0 / features) * rng.standard_normal(features)
    return MaternField(w, u, amplitude)
