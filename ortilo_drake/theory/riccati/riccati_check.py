"""Checks of a solution of the discrete-time algebraic Riccati equation."""

from dataclasses import dataclass

import numpy as np

from ortilo_drake.theory.riccati.riccati import gain
from ortilo_drake.theory.riccati.riccati_condition import condition
from ortilo_drake.theory.riccati.riccati_problem import real_matrices, symmetrise
from ortilo_drake.theory.riccati.stability_radius import stability_radius


@dataclass(frozen=True)
class RiccatiCheck:
    """Quality of a solution X of the DARE.

    Attributes:
        residual: Frobenius norm of the equation's left side over that of X.
        asymmetry: of X - X^T over that of X.
        least_eigenvalue: of X over the largest; negative beyond rounding where X is not >= 0.
        spectral_radius: of A - B L; below 1 where X stabilises.
        distance_to_instability: the least norm of a complex perturbation of A - B L that makes it unstable.
        condition: relative change of X per relative change of A, B R^-1 B^T and Q (riccati_condition), an estimate
            from below; None where R is singular or X does not stabilise.
    """

    residual: float
    asymmetry: float
    least_eigenvalue: float
    spectral_radius: float
    distance_to_instability: float
    condition: float | None


def residual(
    A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray, X: np.ndarray, N: np.ndarray | None = None
) -> float:
    """Return the Frobenius norm of the equation's left side over that of X (over 1 where X = 0)."""
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
