"""The unobservable subspace, found without eigenvalues.

Staircase. The unobservable subspace is the largest Phi-invariant subspace in the kernel of C (R. E. Kalman, 1963). It
is found by N_0 = ker C, N_{k+1} = {v in N_k: Phi v in N_k}, one orthogonal step after another (P. Van Dooren, IEEE TAC
26, 1981).

Scaling. In the units of tick_scaling the vehicle's Phi - I has the entries 1, 1/2, 1/6, 1/24 for every h.
"""

import numpy as np
from scipy.linalg import null_space, svdvals

from ortilo_drake.model.vehicle import GRAVITY

RANK = 1e-10  # singular values below this, of matrices of norm about 1, count as 0
NOTHING = 1e-12  # rows of C shorter than this, against the longest, count as 0: rounding, not a sensor


def tick_scaling(h: float) -> np.ndarray:
    """Return the units (12) of the states in which Phi contains neither h nor g.

    1 m for a position, 1 / h for a velocity, 1 / (g h^2) for an angle, 1 / (g h^3) for an Euler rate. Such a tilt or
    rate moves the vehicle by about a metre within a tick.
    """
    return np.repeat([1.0, 1.0 / (GRAVITY * h**2), 1.0 / h, 1.0 / (GRAVITY * h**3)], 3)


def rescale(A: np.ndarray, C: np.ndarray, scale: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Return T^-1 A T and the rows of C T at unit length, T = diag(scale)."""
    T = np.ones(len(A)) if scale is None else scale
    rows = C * T
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    is_row = length > NOTHING * np.max(length, initial=0.0)
    return A * T / T[:, None], np.divide(rows, length, out=np.zeros_like(rows), where=is_row)


def rank(M: np.ndarray) -> int:
    """Return the number of singular values above RANK times the largest, or times 1 if that is less."""
    s = svdvals(M) if M.size else np.zeros(0)
    return int(np.sum(s > RANK * max(1.0, s[0] if len(s) else 0.0)))


def unobservable_subspace(A: np.ndarray, C: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis N (n x k) of the largest A-invariant subspace in the kernel of C."""
    N = null_space(C, rcond=RANK) if rank(C) else np.eye(len(A))
    size = max(1.0, float(np.linalg.norm(A, 2)))
    while N.shape[1]:
        image = A @ N
        _, s, right = np.linalg.svd(image - N @ (N.T @ image))
        leaving = int(np.sum(s > RANK * size))
        if leaving == 0:
            break
        N = N @ right[leaving:].T
    return N
