"""Newton's method on the discrete-time Riccati equation, with exact residuals.

With L = (R + B^T X B)^-1 (B^T X A + N^T) and A_c = A - B L stable, Newton's step dX solves

    dX - A_c^T dX A_c = A_c^T X A_c - X + Q - N L - L^T N^T + L^T R L - D^T (R + B^T X B)^-1 D,
    D = B^T X A + N^T - (R + B^T X B) L

(G. A. Hewer, IEEE TAC 16, 1971). D is 0 up to rounding; with D, the right side is the residual of the equation whatever
the rounding of L. The steps converge quadratically, and the first is the error of X. Near the solution the right side
cancels to rounding, so it is computed exactly, in integers: every double is an integer times a power of two. So the
step is right to some digits also where the equation is badly conditioned. A solver's X is then refined to full
precision, or Newton's method does not converge and X is refused.
"""

import numpy as np

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.theory.riccati.riccati_problem import ON_THE_CIRCLE, Balanced, is_positive_definite, symmetrise

RIGHT = 1e-11  # an X whose Newton step has a smaller share is returned as the solver found it
STEPS = 30


def as_integers(*matrices: np.ndarray) -> tuple[int, list[np.ndarray]]:
    """Return s and matrices of Python integers that are exactly 2^s times the given ones."""
    ratios = [[x.as_integer_ratio() for x in M.ravel().tolist()] for M in matrices]
    s = max(d.bit_length() - 1 for ratio in ratios for _, d in ratio)
    whole = [np.array([n * (2**s // d) for n, d in ratio], dtype=object) for ratio in ratios]
    return s, [integers.reshape(M.shape) for integers, M in zip(whole, matrices, strict=True)]


def exact_residuals(problem: Balanced, X: np.ndarray, L: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return A_c^T X A_c - X + Q - N L - L^T N^T + L^T R L, with A_c = A - B L, and D, each rounded once."""
    s, (A, B, Q, R, N, X, L) = as_integers(*problem[:5], X, L)
    unit = 1 << s
    A_c = A * unit - B @ L  # times 4^s; below, times 16^s and 32^s
    BX, NL = B.T @ X, N @ L
    D = (BX @ A + N.T * unit**2) * unit - (BX @ B + R * unit**2) @ L
    left = A_c.T @ X @ A_c + (((Q - X) * unit - NL - NL.T) * unit + L.T @ R @ L) * unit**2
    return np.array(left / unit**5, dtype=float), np.array(D / unit**4, dtype=float)


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


def share(dX: np.ndarray, X: np.ndarray) -> float:
    """Return the largest |dX_ij| / sqrt(X_ii X_jj), which units do not change.

    An X_ii below 1e-16 times the largest diagonal entry is replaced by this value.
    """
    diagonal = abs(X.diagonal())
    d = np.sqrt(np.maximum(diagonal, max(1e-16 * diagonal.max(), 1e-300)))
    return float((abs(dX) / d / d[:, None]).max())


def newton_step(problem: Balanced, X: np.ndarray) -> np.ndarray:
    """Return Newton's dX; InputError if R + B^T X B is numerically singular or the closed loop of X is not stable."""
    A, B, _, R, N, _ = problem
    M = symmetrise(R + B.T @ X @ B)
    if not (np.isfinite(M).all() and is_positive_definite(M)):
        raise InputError("R + B^T X B is numerically singular")
    L = np.linalg.solve(M, B.T @ X @ A + N.T)
    A_c = A - B @ L
    z = np.linalg.eigvals(A_c)
    if not abs(z).max() < 1.0 - ON_THE_CIRCLE:
        raise InputError(
            f"it leaves the closed loop an eigenvalue {z[abs(z).argmax()]:.9g}, not inside the unit circle"
        )
    left, D = exact_residuals(problem, X, L)
    return stein(stein_powers(A_c), symmetrise(left - D.T @ np.linalg.solve(M, D)))


def refine(problem: Balanced, X: np.ndarray) -> np.ndarray:
    """Return X (balanced units), refined by Newton's method until its error is at most RIGHT, or unchanged if it is.

    InputError as newton_step, or if Newton's method does not converge.
    """
    for _ in range(STEPS):
        dX = newton_step(problem, X)
        if (change := share(dX, X)) <= RIGHT:
            return X
        X = symmetrise(X + dX)
    raise InputError(f"it is right to {change:.1g} only, and Newton's method does not refine it")
