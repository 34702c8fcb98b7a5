"""The condition number of the discrete-time Riccati equation.

To first order, a change of A by dA, of G = B R^-1 B^T by dG and of Q by dQ changes X by

    dX = Omega^-1 (A_c^T X dA + dA^T X A_c - L dG L^T + dQ),   Omega Z = Z - A_c^T Z A_c,

with A_c = (I + G X)^-1 A the closed loop and L = A^T X (I + G X)^-1 = A_c^T X. The condition is the largest norm of dX
over that of X, for [dA / |A|, dG / |G|, dQ / |Q|] of norm 1, all in the Frobenius norm (Gudmundsson, Kenney and Laub,
IEEE TAC 37, 1992, pp. 513-518; the number that the DAREX collection prints).
"""

import numpy as np

from ortilo_drake.theory.riccati.riccati_problem import is_positive_definite

SEED = 1


def stein_powers(A_c: np.ndarray) -> list[np.ndarray]:
    """Return A_c, A_c^2, A_c^4, ... until they vanish; they solve Stein equations by squared Smith steps."""
    powers = [A_c]
    while np.linalg.norm(powers[-1]) > 1e-18 and len(powers) < 50:
        powers.append(powers[-1] @ powers[-1])
    return powers


def stein(powers: list[np.ndarray], Y: np.ndarray, adjoint: bool = False) -> np.ndarray:
    """Return Z with Z - A_c^T Z A_c = Y, or with adjoint Z - A_c Z A_c^T = Y."""
    Z = Y
    for P in powers:
        Z = Z + (P @ Z @ P.T if adjoint else P.T @ Z @ P)
    return Z


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
