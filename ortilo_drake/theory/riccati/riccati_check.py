"""Checks of a solution of the discrete-time algebraic Riccati equation, and the stability radius of its closed loop."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eig

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.theory.riccati.refinement import stein, stein_powers
from ortilo_drake.theory.riccati.riccati import gain
from ortilo_drake.theory.riccati.riccati_problem import is_positive_definite, real_matrices, symmetrise

SEED = 1  # of the condition number's first change


@dataclass(frozen=True)
class RiccatiCheck:
    """Quality of a solution X of the DARE."""

    residual: float
    """Frobenius norm of the equation's left side over the norm of X."""
    asymmetry: float
    """Frobenius norm of X - X^T over the norm of X."""
    least_eigenvalue: float
    """least eigenvalue of X over the largest; negative beyond rounding where X is not >= 0."""
    spectral_radius: float
    """spectral radius of A - B L; below 1 where X stabilises."""
    distance_to_instability: float
    """the least norm of a complex perturbation of A - B L that makes it unstable."""
    condition: float | None
    """relative change of X per relative change of A, B R^-1 B^T and Q (see condition), an estimate from below; None
    where R is singular or X does not stabilise."""


def residual(
    A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray, X: np.ndarray, N: np.ndarray | None = None
) -> float:
    """Return the Frobenius norm of the equation's left side over the norm of X (over 1 where X = 0)."""
    F = B.T @ X @ A + (0.0 if N is None else N.T)
    left = A.T @ X @ A - X - F.T @ np.linalg.solve(R + B.T @ X @ B, F) + Q
    return float(np.linalg.norm(left) / (np.linalg.norm(X) or 1.0))


def assess(
    A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray, X: np.ndarray, N: np.ndarray | None = None
) -> RiccatiCheck:
    """Return the quality of X as a solution of the DARE; InputError if a matrix is complex."""
    A, B, Q, R, X = real_matrices(A=A, B=B, Q=Q, R=R, X=X)
    if N is not None:
        (N,) = real_matrices(N=N)
    size = np.linalg.norm(X) or 1.0
    eigenvalues = np.linalg.eigvalsh(symmetrise(X))
    A_cl = A - B @ gain(A, B, R, X, N)
    radius = float(abs(np.linalg.eigvals(A_cl)).max())
    return RiccatiCheck(
        residual=residual(A, B, Q, R, X, N),
        asymmetry=float(np.linalg.norm(X - X.T) / size),
        least_eigenvalue=float(eigenvalues[0] / (abs(eigenvalues).max() or 1.0)),
        spectral_radius=radius,
        distance_to_instability=stability_radius(A_cl) if radius < 1.0 else 0.0,
        condition=condition(A, B, Q, R, X, N) if radius < 1.0 else None,
    )


def condition(
    A: np.ndarray,
    B: np.ndarray,
    Q: np.ndarray,
    R: np.ndarray,
    X: np.ndarray,
    N: np.ndarray | None = None,
    tolerance: float = 1e-7,
) -> float | None:
    """Return the condition number of X, from below by power iteration; None where R is singular or X is 0.

    To first order, a change of A by dA, of G = B R^-1 B^T by dG and of Q by dQ changes X by

        dX = Omega^-1 (A_c^T X dA + dA^T X A_c - L dG L^T + dQ),   Omega Z = Z - A_c^T Z A_c,

    with A_c = (I + G X)^-1 A the closed loop and L = A^T X (I + G X)^-1 = A_c^T X. The condition is the largest norm of
    dX over that of X, for [dA / |A|, dG / |G|, dQ / |Q|] of norm 1, all in the Frobenius norm (Gudmundsson, Kenney and
    Laub, IEEE TAC 37, 1992, pp. 513-518; the number that the DAREX collection prints).

    With a cross weight N, A stands for A - B R^-1 N^T and Q for Q - N R^-1 N^T. The iteration ends where the norm
    changes by less than the tolerance. Matrices as riccati.solve, X the stabilising solution (n x n).
    """
    if not is_positive_definite(R) or not X.any():
        return None
    if N is not None:
        A, Q = A - B @ np.linalg.solve(R, N.T), Q - N @ np.linalg.solve(R, N.T)
    G = B @ np.linalg.solve(R, B.T)
    A_c = np.linalg.solve(np.eye(len(A)) + G @ X, A)
    M = A_c.T @ X
    powers = stein_powers(A_c)
    a, g, q = np.linalg.norm(A), np.linalg.norm(G), np.linalg.norm(Q)
    dA, dG, dQ = np.random.default_rng(SEED).standard_normal((3, *A.shape))
    norm = 0.0
    for _ in range(500):
        size = np.sqrt(np.sum(dA**2) + np.sum(dG**2) + np.sum(dQ**2))
        dA, dG, dQ = dA / size, dG / size, dQ / size
        dX = stein(powers, a * (M @ dA + dA.T @ M.T) - g * M @ dG @ M.T + q * dQ)
        previous, norm = norm, float(np.linalg.norm(dX))
        Y = stein(powers, dX, adjoint=True)
        dA, dG, dQ = a * M.T @ (Y + Y.T), -g * M.T @ Y @ M, q * Y  # the adjoint of the map above
        if abs(norm - previous) <= tolerance * norm:
            break
    return norm / float(np.linalg.norm(X))


def least_singular_value(A: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Return sigma_min(e^{j omega} I - A) for every omega [rad] (k)."""
    z = np.exp(1j * np.asarray(omega))
    return np.linalg.svd(z[:, None, None] * np.eye(len(A)) - A, compute_uv=False)[:, -1]


def level_angles(A: np.ndarray, sigma: float) -> np.ndarray:
    """Return the angles [rad] in (-pi, pi] at which sigma is a singular value of e^{j omega} I - A, ascending.

    sigma is a singular value with vectors u, v where  z v - A v = sigma u  and  conj(z) u - A^H u = sigma v;  with
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

    It is the least 2-norm of a complex E that puts an eigenvalue of A + E on the unit circle; A is square, real or
    complex. The search starts at the least value on a grid that includes the angles of A's eigenvalues. level_angles
    then finds the arcs on which sigma_min is even less, and the search goes on from the least value at their midpoints,
    until no such arc is left. It converges quadratically and misses no narrow dip (Boyd and Balakrishnan, Systems and
    Control Letters 15, 1990, in discrete time). InputError if A has an eigenvalue on or outside the unit circle.
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
