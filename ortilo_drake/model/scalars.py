"""Functions for both float and AutoDiffXd: values without derivatives, and linear equations with derivatives."""

import numpy as np
from numba.extending import overload


def values_of(v: np.ndarray) -> np.ndarray:
    """Return an array without derivatives; an array of floats is returned unchanged, also in compiled functions."""
    if v.dtype != object:
        return v
    return np.array([float(z.value()) if hasattr(z, "value") else float(z) for z in v.flat]).reshape(v.shape)


def solve(S: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Return S^-1 B (m, n), given S (m, m) and B (m, n); also in compiled functions.

    For AutoDiffXd the result is X_0 + S_0^-1 (B - S X_0), with X_0 and S_0 the values: one step of iterative
    refinement, which has the derivative of S^-1 B.
    """
    S_0 = values_of(S)
    X_0: np.ndarray = np.linalg.solve(S_0, values_of(B))
    if S.dtype != object and B.dtype != object:
        return X_0
    return np.asarray(X_0 + np.linalg.inv(S_0) @ (B - S @ X_0))


# In compiled functions; strict compares annotations, which a lambda does not have.
overload(values_of, strict=False)(lambda v: lambda v: v)
overload(solve, strict=False)(lambda S, B: lambda S, B: np.linalg.solve(S, B))
