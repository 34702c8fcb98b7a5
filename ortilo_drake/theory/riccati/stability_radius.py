"""The stability radius: the distance from a stable matrix to the nearest unstable one."""

import numpy as np
from scipy.linalg import eig

from ortilo_drake.model.typed_yaml import InputError


def least_singular_value(A: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Return sigma_min(e^{j omega} I - A) for every omega [rad] (k)."""
    z = np.exp(1j * np.asarray(omega))
    return np.linalg.svd(z[:, None, None] * np.eye(len(A)) - A, compute_uv=False)[:, -1]


def level_angles(A: np.ndarray, sigma: float) -> np.ndarray:
    """Return the angles [rad] in (-pi, pi] at which sigma is a singular value of e^{j omega} I - A, ascending.

    sigma is one with singular vectors u, v where  z v - A v = sigma u  and  conj(z) u - A^H u = sigma v;  with
    conj(z) = 1 / z on the circle they make the pencil  [[A, sigma I], [0, I]] - z [[I, 0], [sigma I, A^H]],  whose
    eigenvalues of modulus 1 are those e^{j omega} (Byers, SIAM J. Sci. Stat. Comput. 9, 1988, in discrete time).
    """
    n = len(A)
    eye, zero = np.eye(n), np.zeros((n, n))
    z = eig(np.block([[A, sigma * eye], [zero, eye]]), np.block([[eye, zero], [sigma * eye, A.conj().T]]), right=False)
    z = z[np.isfinite(z)]
    return np.sort(np.angle(z[abs(abs(z) - 1.0) < 1e-6]))


def stability_radius(A: np.ndarray) -> float:
    """Return min over omega of sigma_min(e^{j omega} I - A), the complex stability radius of a stable A, to 1e-10.

    It is the least 2-norm of a complex E that puts an eigenvalue of A + E on the unit circle. The search starts at the
    least value on a grid. level_angles then finds the arcs on which sigma_min is less still, and the least value at
    their midpoints is taken, until no such arc is left. It converges quadratically and misses no narrow dip (Boyd and
    Balakrishnan, Systems and Control Letters 15, 1990, in discrete time).

    Args:
        A: a square matrix, real or complex; its eigenvalues' angles are on the grid.

    Raises:
        InputError: if A has an eigenvalue on or outside the unit circle.
    """
    z = np.linalg.eigvals(A)
    if not abs(z).max() < 1.0:
        raise InputError(f"stability radius: eigenvalue {z[abs(z).argmax()]:.6g}: must lie inside the unit circle")
    radius = least_singular_value(A, np.concatenate([np.linspace(-np.pi, np.pi, 65), np.angle(z)])).min()
    for _ in range(30):
        level = radius * (1.0 - 1e-10)
        angles = level_angles(A, level)
        if len(angles) == 0:
            break
        around = np.append(angles, angles[0] + 2.0 * np.pi)
        least = least_singular_value(A, np.concatenate([(around[1:] + around[:-1]) / 2.0, angles])).min()
        if least >= level:
            break
        radius = least
    return float(radius)
