"""The discrete algebraic Riccati equation for your own matrices."""

from __future__ import annotations  # help() shows types by their names

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ortilo_drake.model.input_error import InputError
from ortilo_drake.theory.riccati import riccati
from ortilo_drake.theory.riccati.riccati_check import RiccatiCheck, assess
from ortilo_drake.theory.riccati.riccati_problem import real_matrices


class Dare(NamedTuple):
    """A solution of the discrete algebraic Riccati equation.

    Attributes:
        X: the stabilising solution (n, n).
        L: the gain of u = -L x (m, n).
        quality: residual, spectral radius of A - B L, distance to instability, condition number.
    """

    X: np.ndarray
    L: np.ndarray
    quality: RiccatiCheck


def solve_dare(
    A: ArrayLike, B: ArrayLike, Q: ArrayLike, R: ArrayLike, N: ArrayLike | None = None, *, solver: str = "scipy"
) -> Dare:
    """Solve A^T X A - X - (A^T X B + N) (R + B^T X B)^-1 (B^T X A + N^T) + Q = 0.

    With each solver the error of X_ij is at most 1e-8 sqrt(X_ii X_jj). The equation of a Kalman filter is the same with
    A = Phi^T, B = C^T, Q = W and R = V: then X is the filter's covariance before a measurement, L^T its predictor gain.

    The stabilising solution exists if (A, B) is stabilisable and all modes on the unit circle are observable from Q.
    With unobservable modes outside it, as for Q = 0 (minimum energy), only 'scipy' finds the solution: 'doubling' and
    'recursion' converge to the least cost, which does not stabilise, and 'drake' refuses what is not detectable.

    Args:
        A: dynamics (n, n).
        B: inputs (n, m).
        Q: weight of the states (n, n), symmetric, positive semidefinite.
        R: weight of the inputs (m, m), symmetric, positive semidefinite; positive definite for 'drake'.
        N: cross weight (n, m).
        solver: 'scipy', 'drake', 'doubling' (structured doubling) or 'recursion'.

    Raises:
        InputError: if there is no stabilising solution, or the solver does not reach it (the error names the modes that
            prevent it); or if a matrix is wrong.

    Example:
        >>> import ortilo_drake as od
        >>> found = od.solve_dare([[1.0]], [[1.0]], [[1.0]], [[1.0]])
        >>> round(float(found.X[0, 0]), 6), round(float(found.L[0, 0]), 6)  # the golden ratio, and 1 less
        (1.618034, 0.618034)
    """
    given = {"A": A, "B": B, "Q": Q, "R": R} | ({} if N is None else {"N": N})
    A, B, Q, R, *cross = real_matrices(**{name: _as_array(name, matrix) for name, matrix in given.items()})
    X = riccati.solve(A, B, Q, R, *cross, solver=solver, least_cost=solver != "scipy")
    return Dare(X, riccati.gain(A, B, R, X, *cross), assess(A, B, Q, R, X, *cross))


def _as_array(name: str, matrix: ArrayLike) -> np.ndarray:
    try:
        return np.asarray(matrix)
    except ValueError:
        raise InputError(f"{name}: its rows differ in length: must be a matrix of real numbers") from None
