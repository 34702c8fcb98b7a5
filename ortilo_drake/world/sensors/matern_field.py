"""A Matérn field in space, drawn by random features (Rahimi and Recht, NIPS 2007).

    f(p) = sd sqrt(2 / M) sum_m n_m cos(w_m . p + u_m),   covariance sd² (1 + d) exp(-d),   d = sqrt(3) |p - q| / length

with n_m standard normal and u_m uniform. The spectral density of the Matérn 3/2 kernel is that of Student's t with
three degrees of freedom, so w = z / length sqrt(3 / chi²_3) with z standard normal (3).
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.special import ndtr

FEATURES = 200
NUMBERS = 8  # that a feature is drawn by: three of z, three of chi², its phase, n


@njit(cache=True)
def field_at(w: np.ndarray, u: np.ndarray, amplitude: np.ndarray, p: np.ndarray) -> float:
    """Return a field at a place p (3), of its features (M, 3), (M) and (M)."""
    total = 0.0 * p[0]
    for m in range(u.size):
        total += amplitude[m] * np.cos(w[m, 0] * p[0] + w[m, 1] * p[1] + w[m, 2] * p[2] + u[m])
    return total


class MaternField(NamedTuple):
    """Frequencies (M, 3) [rad/m], phases (M) [rad], and the amplitude of each feature (M) [m]."""

    w: np.ndarray
    u: np.ndarray
    amplitude: np.ndarray

    def at(self, p: np.ndarray) -> np.ndarray:
        """Return the field at places (k, 3)."""
        return np.array([field_at(*self, place) for place in np.ascontiguousarray(p)])


def field_of(normals: np.ndarray, length: float, sd: float) -> MaternField:
    """Return the field of a length and a deviation [m] that belongs to standard normal numbers (8 M)."""
    z, chi, phase, n = np.split(normals.reshape(-1, NUMBERS).T, (3, 6, 7))
    w = z / length * np.sqrt(3.0 / np.sum(chi**2, axis=0))
    amplitude = sd * np.sqrt(2.0 / n.size) * n[0]
    return MaternField(np.ascontiguousarray(w.T), 2.0 * np.pi * ndtr(phase[0]), amplitude)
