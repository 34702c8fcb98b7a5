"""The structured doubling algorithm for the discrete-time Riccati equation."""

import numpy as np

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.theory.riccati.riccati_problem import real_matrices, regularise, symmetrise

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
    (riccati_problem).

    Raises:
        InputError: if it does not converge within the limit, or overflows.
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
