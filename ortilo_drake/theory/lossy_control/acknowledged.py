"""The LQG gain through a link that loses commands and acknowledges those that arrive ("TCP-like").

x_{k+1} = A x_k + nu_k B u_k + w_k, nu_k = 1 with the probability nu, else 0: the plant gets no control. The estimator
knows nu_{k-1}, so its error does not depend on the controls and separation holds. The cost E[x^T W x + nu_k u^T U u] is
least with u_k = -L xhat_k,

    L = (B^T S B + U)^-1 B^T S A,      S = A^T S A + W - nu A^T S B (B^T S B + U)^-1 B^T S A,

the expected Riccati equation of (A^T, B^T), see theory/arrivals. Where x_k is known the cost of a tick is tr S Q, Q the
covariance of w_k. S is no mean of random matrices, unlike E[P_k]: a gain exists for every nu above the probability at
which the equation begins to have a solution, and for none below.

L. Schenato, B. Sinopoli, M. Franceschetti, K. Poolla, S. S. Sastry, "Foundations of control and estimation over lossy
networks", Proc. IEEE 95(1), 2007, section V.
"""

import numpy as np

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.theory.arrivals.arrivals import Model, check_model, check_rate
from ortilo_drake.theory.arrivals.critical_rate import mare_critical_rate, unstable_part
from ortilo_drake.theory.arrivals.expected_riccati import upper_bound
from ortilo_drake.theory.modes.modes import listed, unreached_modes, unseen_modes


def check_reached(A: np.ndarray, B: np.ndarray) -> None:
    """Raise InputError naming the modes of A that do not decay and that no control reaches, if there are any."""
    if modes := unreached_modes(A, B):
        raise InputError(f"(A, B) is not stabilisable: no control reaches {listed(modes)}")


def critical_command_rate(A: np.ndarray, B: np.ndarray) -> float:
    """Return the probability of arrival, to 1e-6, below which no gain keeps E[x x^T] bounded and above which one does.

    0 without an eigenvalue outside the unit circle; for one control, 1 - 1 / prod |s_u|^2 over those outside.
    InputError if (A, B) is not stabilisable; its modes are named.
    """
    check_reached(A, B)
    A_u, B_u = unstable_part(A.T, B.T)
    return mare_critical_rate(A_u, B_u) if len(A_u) else 0.0


def acknowledged_gain(
    A: np.ndarray, B: np.ndarray, W: np.ndarray, U: np.ndarray, nu: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return L (m, n) and S (n, n) for A (n, n) and B (n, m), where commands arrive with the probability nu.

    The weights are W >= 0 of the state (n, n) and U > 0 of the control (m, m). InputError if (A, B) is not stabilisable
    or (A, W^1/2) not detectable, or if nu is no more than critical.
    """
    nothing_or_all = np.repeat([[False], [True]], B.shape[1], axis=1)
    dual = check_model(Model(A.T, B.T, W, U, nothing_or_all))
    nu, critical = check_rate(nu, "nu"), critical_command_rate(A, B)
    if unseen := unseen_modes(A, W):
        raise InputError(f"(A, W^1/2) is not detectable: no weight sees {listed(unseen)}")
    if nu <= critical:
        raise InputError(f"nu: {nu:g}: must be above {critical:.6g}, at which no gain keeps the state bounded any more")
    S = upper_bound(dual, np.array([1.0 - nu, nu]))
    return np.linalg.solve(B.T @ S @ B + U, B.T @ S @ A), S
