"""The LQG gain through a link that loses commands without acknowledgement ("UDP-like"), where the state is measured.

x_{k+1} = A x_k + nu_k B u_k + w_k as in acknowledged.py, but the estimator does not know nu_k. With the probability
gamma the whole of x_k arrives, without noise; otherwise xhat_{k+1} = A xhat_k + nu B u_k, and the error of it grows by
nu (1 - nu) B u u^T B^T: a control that may be lost costs knowledge. In this case the optimum is still linear,
u_k = -L xhat_k with alpha = (1 - gamma)(1 - nu) and

    L = (B^T (S + alpha T) B + U)^-1 B^T S A,
    S = A^T S A + W - nu A^T S B L,      T = (1 - gamma) A^T T A + nu A^T S B L,

and the cost E[x^T W x + nu_k u^T U u] of a tick is tr (S + (1 - gamma) T) Q. In general, with measurement noise or part
of the state unseen, no linear law is the best.

L. Schenato, B. Sinopoli, M. Franceschetti, K. Poolla, S. S. Sastry, "Foundations of control and estimation over lossy
networks", Proc. IEEE 95(1), 2007, section VI.
"""

import numpy as np

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.theory.arrivals.arrivals import check_rate
from ortilo_drake.theory.lossy_control.acknowledged import check_reached
from ortilo_drake.theory.riccati.riccati_problem import real_matrices

SETTLED = 1e-9  # relative change of a step at which S and T count as steady
DIVERGED = 1e12  # of their size, over that of W
MOST_STEPS = 20_000


def critical_unacknowledged_rate(A: np.ndarray, gamma: float) -> float | None:
    """Return the least nu for which the cost stays bounded, None if no nu suffices.

    The state arrives with the probability gamma. With a > 1 the largest |eigenvalue| of A (n, n) it solves a^2 (nu +
    gamma - 2 nu gamma) = nu + gamma - nu gamma. It is necessary for every B, and sufficient where B is square and
    invertible. For a <= 1 it is 0.
    """
    gamma, a2 = check_rate(gamma, "gamma"), float(np.max(np.abs(np.linalg.eigvals(A)))) ** 2
    if a2 <= 1.0:
        return 0.0
    if a2 * (1.0 - gamma) >= 1.0:
        return None
    return gamma * (a2 - 1.0) / (a2 * (2.0 * gamma - 1.0) + 1.0 - gamma)


def unacknowledged_gain(
    A: np.ndarray, B: np.ndarray, W: np.ndarray, U: np.ndarray, nu: float, gamma: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return L (m, n), S and T (n, n), the limit of the recursion from S = T = 0, arguments as acknowledged_gain's.

    Commands arrive with the probability nu, the state with gamma. InputError if (A, B) is not stabilisable, or the cost
    grows without bound.
    """
    A, B, W, U = real_matrices(A=A, B=B, W=W, U=U)
    nu, gamma = check_rate(nu, "nu"), check_rate(gamma, "gamma")
    check_reached(A, B)
    S, T = np.zeros_like(W), np.zeros_like(W)
    for _ in range(MOST_STEPS):
        BSA = B.T @ S @ A
        L = np.linalg.solve(B.T @ (S + (1.0 - gamma) * (1.0 - nu) * T) @ B + U, BSA)
        steered = nu * BSA.T @ L
        after = A.T @ S @ A + W - steered, (1.0 - gamma) * A.T @ T @ A + steered
        change = max(np.max(np.abs(after[0] - S)), np.max(np.abs(after[1] - T)))
        S, T = ((M + M.T) / 2.0 for M in after)
        size = max(np.max(np.abs(S)), np.max(np.abs(T)))
        if change <= SETTLED * size:
            return L, S, T
        if size > DIVERGED * np.max(np.abs(W)):
            break
    raise InputError(
        f"nu: {nu:g}, gamma: {gamma:g}: too few arrivals: the cost grows without bound or settles too slowly"
    )
