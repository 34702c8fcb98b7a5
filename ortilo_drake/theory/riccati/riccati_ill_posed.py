"""Behaviour of each solver on Riccati equations that have no solution to return."""

from dataclasses import dataclass

import numpy as np

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.theory.riccati.riccati import RAW, gain
from ortilo_drake.theory.riccati.riccati_check import residual
from ortilo_drake.theory.riccati.riccati_problem import require_well_posed

RECURSION_LIMIT = 2000  # steps; enough to see that it has no limit


def _column(*entries: float) -> np.ndarray:
    return np.array(entries)[:, None]


# Each is (A, B, Q, R). In 'hidden' cases the first state has no weight and no coupling. In 'stuck' cases no input moves
# it. The rotation by 90 degrees has its eigenvalues +-i on the unit circle.
ILL_POSED: dict[str, tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = {
    "hidden on the circle": (np.diag([1.0, 0.5]), _column(1.0, 1.0), np.diag([0.0, 1.0]), np.eye(1)),
    "hidden outside": (np.diag([2.0, 0.5]), _column(1.0, 1.0), np.diag([0.0, 1.0]), np.eye(1)),
    "stuck on the circle": (np.diag([1.0, 0.5]), _column(0.0, 1.0), np.eye(2), np.eye(1)),
    "stuck outside": (np.diag([2.0, 0.5]), _column(0.0, 1.0), np.eye(2), np.eye(1)),
    "unweighted turn": (np.array([[0.0, 1.0], [-1.0, 0.0]]), _column(0.0, 1.0), np.zeros((2, 2)), np.eye(1)),
    "Q indefinite": (0.5 * np.eye(2), _column(1.0, 1.0), np.diag([1.0, -1.0]), np.eye(1)),
    "R indefinite": (np.diag([0.5, 0.7]), np.eye(2), np.eye(2), np.diag([1.0, -1.0])),
    "Q not symmetric": (np.diag([0.5, 0.2]), np.eye(2), np.array([[1.0, 1.0], [0.0, 1.0]]), np.eye(2)),
    "B of another height": (np.diag([0.5, 0.2]), np.eye(3), np.eye(2), np.eye(2)),
    "NaN": (np.diag([0.5, np.nan]), np.eye(2), np.eye(2), np.eye(2)),
}


@dataclass(frozen=True)
class Outcome:
    """The behaviour of a raw solver on a problem, and the message of its error.

    outcome is 'ends the process', 'raises', 'returns a solution: ...', 'returns what is no solution' or 'returns NaN'.
    """

    outcome: str
    message: str


@dataclass(frozen=True)
class Returned(Outcome):
    """A returned X, with the spectral radius of its closed loop and the equation's residual."""

    spectral_radius: float
    residual: float
    X: np.ndarray


@dataclass(frozen=True)
class SolverOutcomes:
    """The error of require_well_posed, None if a problem is well-posed, and the outcome of each raw solver."""

    error: str | None
    drake: Outcome
    scipy: Outcome
    doubling: Outcome
    recursion: Outcome


def _try(solver: str, A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray) -> Outcome:
    limit = {"limit": RECURSION_LIMIT} if solver == "recursion" else {}
    try:
        X = RAW[solver](A, B, Q, R, **limit)
    except SystemExit as error:  # Drake's, which 'except Exception' would let through
        return Outcome("ends the process", str(error))
    except (InputError, ValueError, RuntimeError, np.linalg.LinAlgError) as error:
        return Outcome("raises", f"{type(error).__name__}: {error}")
    if not np.isfinite(X).all():
        return Outcome("returns NaN", "")
    with np.errstate(all="ignore"):  # X may be as large as a float can be
        radius = float(abs(np.linalg.eigvals(A - B @ gain(A, B, R, X))).max())
        definite = bool(np.linalg.eigvalsh(X)[0] >= -1e-12 * abs(X).max())
        left = residual(A, B, Q, R, X)
    kind = ("stabilising" if radius < 1.0 - 1e-9 else "not stabilising") + ("" if definite else ", indefinite")
    outcome = f"returns a solution: {kind}" if left < 1e-6 else "returns what is no solution"
    return Returned(outcome, "", radius, left, X)


def solver_outcomes(A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray) -> SolverOutcomes:
    """Return the outcome of each raw solver on a problem, and the error that solve raises."""
    try:
        require_well_posed(A, B, Q, R)
        error = None
    except InputError as problem:
        error = str(problem)
    return SolverOutcomes(error, **{solver: _try(solver, A, B, Q, R) for solver in RAW})
