"""The discrete-time algebraic Riccati equation, solved by four independent solvers.

    A^T X A - X - (A^T X B + N) (R + B^T X B)^-1 (B^T X A + N^T) + Q = 0                                   (DARE)

The filter's equation is the same by duality: A = Phi^T, B = C^T, Q = W, R = V.

- drake: Schur method (DiscreteAlgebraicRiccatiEquation); it ends the process (SystemExit) on a problem it refuses, and
  gives up digits of small weights: with A = diag(0.5, 0.9), Q = diag(1, 1e-11) its X_22 is 0.1 % off.
- scipy: QZ of the extended pencil (solve_discrete_are); may return a solution that does not stabilise. The default.
- doubling: structured doubling; it has no pencil to order, and checks the other two independently.
- recursion: the paper's own, S <- Q + Phi^T S Phi - Phi^T S Gamma (Gamma^T S Gamma + R)^-1 Gamma^T S Phi.

RAW holds the bare solvers. SOLVERS wraps them, with one signature and the same errors: before the solver,
require_well_posed decides whether there is a solution; after it, refine measures the error of X. All refuse complex
matrices (InputError): the equation is that of real matrices.

tests/theory/test_riccati.py compares each with solutions of 120 digits, over weights and units far apart: X is right to
1e-8, or refused.
"""

import warnings
from collections.abc import Callable
from functools import partial

import numpy as np
from pydrake.math import DiscreteAlgebraicRiccatiEquation
from scipy.linalg import LinAlgWarning, solve_discrete_are

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.theory.riccati.refinement import refine
from ortilo_drake.theory.riccati.riccati_problem import (
    is_positive_definite,
    real_matrices,
    regularise,
    require_well_posed,
    riccati_step,
    symmetrise,
)

Solver = Callable[..., np.ndarray]


def by_drake(A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray, N: np.ndarray | None = None) -> np.ndarray:
    """Return X by Drake; SystemExit on a problem it refuses. R must be > 0 and Q >= 0 without any rounding error."""
    A, B, Q, R, *cross = real_matrices(A=A, B=B, Q=Q, R=R, **({} if N is None else {"N": N}))
    return DiscreteAlgebraicRiccatiEquation(A, B, Q, R, *cross)


def by_scipy(A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray, N: np.ndarray | None = None) -> np.ndarray:
    """Return X by SciPy; LinAlgError where it finds no finite solution."""
    A, B, Q, R, *cross = real_matrices(A=A, B=B, Q=Q, R=R, **({} if N is None else {"N": N}))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LinAlgWarning)  # riccati_check.assess measures the solution
        return solve_discrete_are(A, B, Q, R, s=cross[0] if cross else None)


def by_recursion(
    A: np.ndarray,
    B: np.ndarray,
    Q: np.ndarray,
    R: np.ndarray,
    N: np.ndarray | None = None,
    tolerance: float = 1e-14,
    limit: int = 100_000,
) -> np.ndarray:
    """Return X by the paper's recursion from 0; the closed loop's radius squared is the error's factor per step.

    It stops when a step changes X by less than the tolerance, relatively, or when rounding ends its progress. The limit
    is enough for closed loops of a radius up to about 1 - 1.5e-4. InputError if it has not converged after `limit`
    steps, or overflows.
    """
    A, B, Q, R, N = real_matrices(A=A, B=B, Q=Q, R=R, N=np.zeros(np.shape(B)) if N is None else N)
    X, least, waited = np.zeros(Q.shape), np.inf, 0
    if not is_positive_definite(R):
        X = regularise(A, B, Q, R, N).X_0
    with np.errstate(all="ignore"):
        for _ in range(limit):
            X_next = riccati_step(A, B, Q, R, N, X)
            change, size = float(np.linalg.norm(X_next - X)), float(np.linalg.norm(X_next))
            X = X_next
            if not np.isfinite(size):
                raise InputError("recursion: overflows")
            waited = 0 if change < least else waited + 1
            least = min(least, change)
            if change <= tolerance * size or (waited >= 100 and change <= 1e-11 * size):
                return X
    raise InputError(f"recursion: still changes X by {change / size:.2g} of itself after {limit} steps")


LIMIT = 60  # doublings; 2^60 steps of the recursion


def double(A: np.ndarray, G: np.ndarray, H: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return A_{k+1}, G_{k+1}, H_{k+1} of one doubling (Chu, Fan, Lin, Wang, Int. J. Control 77, 2004, SDA).

    With M = (I + G H)^-1:  A' = A M A,  G' = G + A M G A^T,  H' = H + A^T H M A.
    H after k doublings equals the recursion from 0 after 2^k steps.
    """
    M = np.linalg.solve(np.eye(len(A)) + G @ H, np.hstack([A, G]))
    MA, MG = M[:, : len(A)], M[:, len(A) :]
    return A @ MA, symmetrise(G + A @ MG @ A.T), symmetrise(H + A.T @ H @ MA)


def doubling(
    A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray, N: np.ndarray | None = None, limit: int = LIMIT
) -> np.ndarray:
    """Return X of the DARE by doubling A_0 = A - B R^-1 N^T, G_0 = B R^-1 B^T, H_0 = Q - N R^-1 N^T.

    Converges quadratically where the closed loop is stable. A nearly singular R is made regular first
    (riccati_problem). InputError if it does not converge within the limit, or overflows.
    """
    A, B, Q, R, N = real_matrices(A=A, B=B, Q=Q, R=R, N=np.zeros(np.shape(B)) if N is None else N)
    regular = regularise(A, B, Q, R, N)
    A_k, H = regular.A, regular.Q
    G = symmetrise(B @ np.linalg.solve(regular.R, B.T))
    with np.errstate(all="ignore"):
        for _ in range(limit):
            try:
                A_k, G, H_next = double(A_k, G, H)
            except np.linalg.LinAlgError:
                raise InputError("doubling: I + G H is singular") from None
            if not np.isfinite(H_next).all():
                raise InputError("doubling: overflows")
            change = np.linalg.norm(H_next - H)
            H = H_next
            if change <= 1e-16 * np.linalg.norm(H):
                return symmetrise(regular.X_0 + H)
    raise InputError(f"doubling: no limit within {limit} doublings")


RAW: dict[str, Solver] = {"drake": by_drake, "scipy": by_scipy, "doubling": doubling, "recursion": by_recursion}


def gain(A: np.ndarray, B: np.ndarray, R: np.ndarray, X: np.ndarray, N: np.ndarray | None = None) -> np.ndarray:
    """Return L = (R + B^T X B)^-1 (B^T X A + N^T) (m x n)."""
    return np.linalg.solve(R + B.T @ X @ B, B.T @ X @ A + (0.0 if N is None else N.T))


def solve(
    A: np.ndarray,
    B: np.ndarray,
    Q: np.ndarray,
    R: np.ndarray,
    N: np.ndarray | None = None,
    *,
    solver: str = "scipy",
    names: tuple[str, ...] | None = None,
    dual: bool = False,
    least_cost: bool = True,
) -> np.ndarray:
    """Return the stabilising solution X >= 0 (n x n) by one solver, right to 1e-8 of sqrt(X_ii X_jj) and better.

    The solver gets the equation in balanced units. If the error of its X is above 1e-11, X is refined (refinement.py).
    Matrices and solvers are those of api/riccati.py. Errors call the states by their names, and the matrices of a
    filter's equation (dual) Phi, C, W and V. Filter and servo take only an X that is the recursion's limit
    (least_cost). InputError before solving, the same for every solver, if the problem is ill-posed, naming the modes;
    or if the solver fails on a well-posed problem, or its X does not stabilise or cannot be refined.
    """
    if solver not in RAW:
        raise InputError(f"solver: {solver!r}: must be one of {', '.join(RAW)}")
    problem = require_well_posed(A, B, Q, R, N, names, dual, least_cost)
    if solver == "drake" and not is_positive_definite(problem.R):
        raise InputError("R: Drake takes positive definite ones only: use another solver")
    try:
        with np.errstate(all="ignore"):  # refine sees what overflows
            X = refine(problem, symmetrise(RAW[solver](*problem[:4], problem.N if problem.N.any() else None)))
    except (SystemExit, RuntimeError, ValueError) as error:  # InputError and LinAlgError are ValueErrors
        reason = str(error).removeprefix(f"{solver}: ")
        raise InputError(f"Riccati equation: {solver} fails on a well-posed problem: {reason}") from None
    return problem.in_given_units(X)


SOLVERS: dict[str, Solver] = {name: partial(solve, solver=name) for name in RAW}
