"""LQG gains through a link that loses commands, with acknowledgement of those that arrive ("TCP-like") and without.

x_{k+1} = A x_k + nu_k B u_k + w_k, nu_k = 1 with the probability nu, else 0: the plant gets no control. Q is the
covariance of w_k; the cost is E[x^T W x + nu_k u^T U u].

Acknowledged: the estimator knows nu_{k-1}, so its error does not depend on the controls and separation holds. The cost
is least with u_k = -L xhat_k,

    L = (B^T S B + U)^-1 B^T S A,      S = A^T S A + W - nu A^T S B (B^T S B + U)^-1 B^T S A,

the expected Riccati equation of (A^T, B^T), see theory/arrivals. Where x_k is known the cost of a tick is tr S Q. S is
no mean of random matrices, unlike E[P_k]: a gain exists for every nu above the probability at which the equation begins
to have a solution, and for none below.

Unacknowledged ("UDP-like"), where the state is measured: with the probability gamma the whole of x_k arrives, without
noise; otherwise xhat_{k+1} = A xhat_k + nu B u_k, and the covariance of its error grows by nu (1 - nu) B u u^T B^T: a
control that may be lost costs knowledge. In this case the optimum is still linear, with alpha = (1 - gamma)(1 - nu) and

    L = (B^T (S + alpha T) B + U)^-1 B^T S A,
    S = A^T S A + W - nu A^T S B L,      T = (1 - gamma) A^T T A + nu A^T S B L,

and the cost of a tick is tr (S + (1 - gamma) T) Q. In general, with measurement noise or part of the state unseen, no
linear law is the best.

L. Schenato, B. Sinopoli, M. Franceschetti, K. Poolla, S. S. Sastry, "Foundations of control and estimation over lossy
networks", Proc. IEEE 95(1), 2007, sections V and VI.
"""

import numpy as np

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.theory.arrivals.arrivals import Model, check_model, check_rate
from ortilo_drake.theory.arrivals.critical_rate import mare_critical_rate, unstable_part
from ortilo_drake.theory.arrivals.expected_riccati import upper_bound
from ortilo_drake.theory.modes.modes import listed, unreached_modes, unseen_modes
from ortilo_drake.theory.riccati.riccati import gain
from ortilo_drake.theory.riccati.riccati_problem import real_matrices


def check_reached(A: np.ndarray, B: np.ndarray) -> None:
    """Raise InputError naming the modes of A that do not decay and that no control reaches, if there are any."""
    if modes := unreached_modes(A, B):
        raise InputError(f"(A, B) is not stabilisable: no control reaches {listed(modes)}")


def critical_command_rate(A: np.ndarray, B: np.ndarray) -> float:
    """Return the arrival probability, to 1e-6, below which no gain keeps E[x x^T] bounded and above which one does.

    It is 0 if no eigenvalue lies outside the unit circle; for one control it is 1 - 1 / prod |s_u|^2 over those
    outside. InputError if (A, B) is not stabilisable; it names the modes.
    """
    check_reached(A, B)
    A_u, B_u = unstable_part(A.T, B.T)
    return mare_critical_rate(A_u, B_u) if len(A_u) else 0.0


def acknowledged_gain(
    A: np.ndarray, B: np.ndarray, W: np.ndarray, U: np.ndarray, nu: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return L (m, n) and S (n, n) for A (n, n) and B (n, m), where commands arrive with the probability nu.

    The weights are W >= 0 of the state (n, n) and U > 0 of the control (m, m). InputError if (A, B) is not stabilisable
    or (A, W^1/2) not detectable, or if nu is not above the critical rate.
    """
    nothing_or_all = np.repeat([[False], [True]], B.shape[1], axis=1)
    dual = check_model(Model(A.T, B.T, W, U, nothing_or_all))
    nu, critical = check_rate(nu, "nu"), critical_command_rate(A, B)
    if unseen := unseen_modes(A, W):
        raise InputError(f"(A, W^1/2) is not detectable: no weight sees {listed(unseen)}")
    if nu <= critical:
        raise InputError(f"nu: {nu:g}: must be above {critical:.6g}, at which no gain keeps the state bounded any more")
    S = upper_bound(dual, np.array([1.0 - nu, nu]))
    return gain(A, B, U, S), S


SETTLED = 1e-9  # relative change of a step at which S and T count as steady
DIVERGED = 1e12  # size of S and T, relative to W, that counts as unbounded
MOST_STEPS = 20_000


def critical_unacknowledged_rate(A: np.ndarray, gamma: float) -> float | None:
    """Return the least nu for which the cost stays bounded, None if no nu suffices.

    The state arrives with probability gamma. Let a be the largest |eigenvalue| of A (n, n). If a <= 1, the least nu is
    0. If a > 1, it solves a^2 (nu + gamma - 2 nu gamma) = nu + gamma - nu gamma, which is necessary for every B, and
    sufficient where B is square and invertible.
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
    """Return L (m, n), S and T (n, n), the limits of the recursion from S = T = 0. Arguments as for acknowledged_gain.

    Commands arrive with probability nu, the state with gamma. InputError if (A, B) is not stabilisable, or if the cost
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
