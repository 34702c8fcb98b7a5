"""Arrival patterns: which rows of C arrive in a tick, and with which probability.

Pattern p keeps the rows `rows[p]` of (C, V): C_p = C[rows], V_p = V[rows, rows]. For the vehicle the rows are uwb,
camera, imu, then further sensors; the imu and the further sensors arrive in every tick.
"""

from typing import NamedTuple

import numpy as np

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.theory.modes.modes import Mode, unseen_modes
from ortilo_drake.theory.riccati.riccati_problem import real_matrices

# Rows of y that arrive in each pattern (4 x 9): none, uwb, camera, both, each with the imu.
PATTERN_ROWS = np.array([[u] * 3 + [c] * 3 + [True] * 3 for c in (False, True) for u in (False, True)])


class Model(NamedTuple):
    """A filter's model x_{k+1} = A x_k + w_k, y_k = C x_k + v_k; in pattern p rows[p] of y arrive (P, m), bool.

    A (n, n) is the dynamics, C (m, n) the output matrix, W (n, n) the covariance of w, and V > 0 (m, m) that of v.
    """

    A: np.ndarray
    C: np.ndarray
    W: np.ndarray
    V: np.ndarray
    rows: np.ndarray


def check_rate(rate: float, name: str) -> float:
    """Return an arrival rate per tick as a float; InputError unless it lies in [0, 1]."""
    if not 0.0 <= rate <= 1.0:  # NaN fails as well
        raise InputError(f"{name}: {rate}: an arrival rate must lie in [0, 1]")
    return float(rate)


def pattern_probabilities(uwb: float, camera: float) -> np.ndarray:
    """Return the probabilities of PATTERN_ROWS (4) for independent arrivals at these rates per tick.

    InputError if a rate lies outside [0, 1].
    """
    u, c = check_rate(uwb, "arrival rate of uwb"), check_rate(camera, "arrival rate of camera")
    return np.outer([1 - c, c], [1 - u, u]).ravel()


def check_model(model: Model) -> Model:
    """Return the model as contiguous floats; InputError if a matrix is complex, or if a shape, W or V is wrong."""
    A, C, W, V = map(np.ascontiguousarray, real_matrices(A=model.A, C=model.C, W=model.W, V=model.V))
    rows = np.ascontiguousarray(model.rows, dtype=bool)
    n, m = A.shape[0], C.shape[0]
    for name, M, shape in (("A", A, (n, n)), ("C", C, (m, n)), ("W", W, (n, n)), ("V", V, (m, m))):
        if M.shape != shape:
            raise InputError(f"{name}: shape {M.shape}: must be {shape}")
        if not np.all(np.isfinite(M)):
            raise InputError(f"{name}: must have finite entries")
    if rows.ndim != 2 or rows.shape[1] != m:
        raise InputError(f"rows: shape {rows.shape}: must be (patterns, {m})")
    for name, M, least in (("W", W, -1e-12), ("V", V, 0.0)):
        if not np.allclose(M, M.T, rtol=1e-9, atol=1e-300):
            raise InputError(f"{name}: must be symmetric")
        eigenvalues = np.linalg.eigvalsh(M) if M.size else np.ones(1)
        if not eigenvalues[0] > least * max(eigenvalues[-1], 1.0) and not (name == "W" and eigenvalues[0] >= 0.0):
            kind = "positive definite" if name == "V" else "positive semidefinite"
            raise InputError(f"{name}: smallest eigenvalue {eigenvalues[0]:.3g}: must be {kind}")
    return Model(A, C, W, V, rows)


def never_seen(model: Model, probabilities: np.ndarray, names: tuple[str, ...] | None = None) -> list[Mode]:
    """Return the modes of A with |eigenvalue| >= 1 that no pattern of positive probability sees.

    The probabilities are of the patterns (P), or of the patterns in each mode of a chain (M, P).
    """
    possible = np.atleast_2d(probabilities).max(axis=0) > 0.0
    seen = model.rows[possible].any(axis=0)
    return unseen_modes(model.A, model.C * seen[:, None], names)


def check_arrivals(model: Model, probabilities: np.ndarray, what: str) -> None:
    """Raise InputError, beginning with `what`, unless probabilities sum to 1 and the arriving rows detect A.

    The probabilities are (P) or, for each of several modes of a chain, (M, P).
    """
    each = np.atleast_2d(probabilities)
    if each.shape[1] != len(model.rows):
        raise InputError(f"{what}: {each.shape[1]} probabilities for {len(model.rows)} patterns")
    if not np.all(each >= 0.0) or not np.allclose(each.sum(axis=1), 1.0, rtol=0.0, atol=1e-9):
        raise InputError(f"{what}: the probabilities of the patterns must be at least 0 and sum to 1")
    unseen = never_seen(model, each)
    if unseen:
        raise InputError(
            f"{what}: nothing that ever arrives sees {'; '.join(map(str, unseen))}: the covariance grows without bound"
        )
