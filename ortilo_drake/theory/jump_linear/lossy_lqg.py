"""LQG control when measurements and control packets are both lost: what the arrival rates allow.

L. Schenato, B. Sinopoli, M. Franceschetti, K. Poolla and S. S. Sastry, "Foundations of control and estimation over
lossy networks", Proceedings of the IEEE 95 (2007) 163-187. The plant and the cost are

    x_{k+1} = A x_k + nu_k B u_k + w_k,   y_k = C x_k + v_k where gamma_k = 1,   J = lim E[x^T W x + nu u^T U u]

with nu_k and gamma_k independent, 1 at the rates nu and gamma, w and v white of covariances Q and R. A lost command
is 0.

TCP-like: the sender learns nu_{k-1} before it decides u_k. Separation holds; estimation and control each obey a
modified algebraic Riccati equation, dual to each other. UDP-like: it never learns. The best control is then not linear
in general; it is with C invertible and R = 0, by the coupled pair (S, T) below.

This is the best that control made for the losses can do; the servo that flies is not, see command_loss.py.
"""

from typing import NamedTuple

import numpy as np

from ortilo_drake.model.typed_yaml import InputError

CONVERGED = 1e-12  # relative change of a recursion at its fixed point
DIVERGED = 1e14  # a recursion that has grown by this factor has no fixed point
MOST_STEPS = 200_000


class UdpSolution(NamedTuple):
    """The control of the UDP-like case, C invertible and R = 0: u = -L xhat, of cost J.

    E[cost to go] = xhat^T S xhat + tr(T P) + constant, P the covariance of xhat's error after the measurement.
    """

    S: np.ndarray
    T: np.ndarray
    L: np.ndarray
    J: float


def check_rate(name: str, rate: float) -> None:
    """Raise InputError unless an arrival rate lies in [0, 1]."""
    if not 0.0 <= rate <= 1.0:
        raise InputError(f"{name}: {rate}: must be in [0, 1]")


def modified_riccati(
    P: np.ndarray, A: np.ndarray, C: np.ndarray, Q: np.ndarray, R: np.ndarray, rate: float
) -> np.ndarray:
    """Return A P A^T + Q - rate A P C^T (C P C^T + R)^-1 C P A^T, one step of the MARE of estimation.

    With (A^T, B^T, W, U, nu) in the place of (A, C, Q, R, gamma) it is that of control, S.
    """
    APC = A @ P @ C.T
    return A @ P @ A.T + Q - rate * APC @ np.linalg.solve(C @ P @ C.T + R, APC.T)


def udp_step(
    S: np.ndarray,
    T: np.ndarray,
    A: np.ndarray,
    B: np.ndarray,
    W: np.ndarray,
    U: np.ndarray,
    gamma: float,
    nu: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return S and T one step earlier in the UDP-like case, C invertible and R = 0.

    S' = A^T S A + W - nu A^T S B N^-1 B^T S A,   T' = A^T (gamma S + (1 - gamma) T) A + W,
    N = U + B^T ((1 - alpha) S + alpha T) B,   alpha = (1 - gamma) (1 - nu).
    """
    BSA = B.T @ S @ A
    N = _udp_weight(S, T, B, U, gamma, nu)
    return (
        A.T @ S @ A + W - nu * BSA.T @ np.linalg.solve(N, BSA),
        A.T @ (gamma * S + (1.0 - gamma) * T) @ A + W,
    )


def _udp_weight(S: np.ndarray, T: np.ndarray, B: np.ndarray, U: np.ndarray, gamma: float, nu: float) -> np.ndarray:
    alpha = (1.0 - gamma) * (1.0 - nu)
    return np.asarray(U + B.T @ ((1.0 - alpha) * S + alpha * T) @ B)


def steady_modified_riccati(
    A: np.ndarray, C: np.ndarray, Q: np.ndarray, R: np.ndarray, rate: float
) -> np.ndarray | None:
    """Return the fixed point of modified_riccati reached from 0, or None where the recursion diverges.

    Raises:
        InputError: if the rate is not in [0, 1], or the recursion neither settles nor diverges in MOST_STEPS.
    """
    check_rate("arrival rate", rate)
    P = Q
    for _ in range(MOST_STEPS):
        before, P = P, modified_riccati(P, A, C, Q, R, rate)
        P = (P + P.T) / 2.0
        if np.max(np.abs(P)) > DIVERGED * np.max(np.abs(Q)):
            return None
        if np.max(np.abs(P - before)) <= CONVERGED * np.max(np.abs(P)):
            return P
    raise InputError(f"arrival rate: {rate}: too close to the critical one to tell in {MOST_STEPS} steps")


def tcp_cost(
    A: np.ndarray,
    B: np.ndarray,
    C: np.ndarray,
    Q: np.ndarray,
    R: np.ndarray,
    W: np.ndarray,
    U: np.ndarray,
    gamma: float,
    nu: float,
) -> tuple[float, float] | None:
    """Return bounds (J_min, J_max) of the least cost in the TCP-like case, None where it is not bounded above.

        J = tr(S Q) + tr((A^T S A + W - S) E[P_{k|k}])

    with S the MARE of control and E[P_{k|k}] between (1 - gamma) P_min, P_min = (1 - gamma) A P_min A^T + Q, and
    P - gamma P C^T (C P C^T + R)^-1 C P, P the MARE of estimation. With C invertible and R = 0 both are the cost.
    """
    check_rate("gamma", gamma)
    check_rate("nu", nu)
    S = steady_modified_riccati(A.T, B.T, W, U, nu)
    P = steady_modified_riccati(A, C, Q, R, gamma)
    if S is None or P is None:
        return None
    P_min = steady_modified_riccati(np.sqrt(1.0 - gamma) * A, C, Q, R, 0.0)
    if P_min is None:  # cannot be where P exists, which bounds it
        return None
    weight = A.T @ S @ A + W - S
    largest = P - gamma * P @ C.T @ np.linalg.solve(C @ P @ C.T + R, C @ P)
    base = np.trace(S @ Q)
    return float(base + (1.0 - gamma) * np.trace(weight @ P_min)), float(base + np.trace(weight @ largest))


def udp_solution(
    A: np.ndarray, B: np.ndarray, Q: np.ndarray, W: np.ndarray, U: np.ndarray, gamma: float, nu: float
) -> UdpSolution | None:
    """Return the best control of the UDP-like case with C invertible and R = 0, None where its cost is not bounded.

    L = N^-1 B^T S A, J = tr((gamma S + (1 - gamma) T) Q). The estimate is x itself where it arrived and
    A xhat + nu B u where not.
    """
    check_rate("gamma", gamma)
    check_rate("nu", nu)
    S = T = W
    for _ in range(MOST_STEPS):
        before = S, T
        S, T = udp_step(S, T, A, B, W, U, gamma, nu)
        S = (S + S.T) / 2.0  # else rounding grows with A
        if max(np.max(np.abs(S)), np.max(np.abs(T))) > DIVERGED * np.max(np.abs(W)):
            return None
        change = max(np.max(np.abs(S - before[0])), np.max(np.abs(T - before[1])))
        if change <= CONVERGED * max(np.max(np.abs(S)), np.max(np.abs(T))):
            L = np.linalg.solve(_udp_weight(S, T, B, U, gamma, nu), B.T @ S @ A)
            return UdpSolution(S, T, L, float(np.trace((gamma * S + (1.0 - gamma) * T) @ Q)))
    raise InputError(f"gamma, nu: {gamma}, {nu}: too close to the critical ones to tell in {MOST_STEPS} steps")


def tcp_is_stable(a: float, gamma: float, nu: float) -> bool:
    """Return whether a scalar plant, |a| >= 1, can be kept in mean square: gamma and nu each above 1 - 1 / a^2."""
    return gamma > 1.0 - 1.0 / a**2 and nu > 1.0 - 1.0 / a**2


def udp_is_stable(a: float, gamma: float, nu: float) -> bool:
    """Return the same of the UDP-like case, c invertible, R = 0: a^2 (gamma + nu - 2 gamma nu) < gamma + nu - gamma nu.

    That is 1 / (1 / gamma + 1 / nu - 1) > 1 - 1 / a^2: losses on both links add up, where with TCP each counts alone.
    """
    return a**2 * (gamma + nu - 2.0 * gamma * nu) < gamma + nu - gamma * nu
