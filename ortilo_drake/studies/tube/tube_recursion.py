"""The recursion behind the tube: mean and covariance of the linear loop under intermittent measurements.

The loop, in deviations from hover, with the arrivals p of a tick (which of uwb, camera and imu are there) random:

    x+ = Phi x + Gamma u + w,   u = u_ff - L s,   s = [xhat - x_ref; i]                          (vehicle, servo)
    xbarhat+ = Phibar_p xbarhat + Gammabar u + Ibar r + K_p nu_p,   nu_p = C_p e + v_p               (filter)

with e = x - xhat, the error of the prediction. K_p (15 rows) is the gain of the filter that flies, see
onboard/estimator/intermittent_filter.py; its last rows are -E_p, because the integral takes the measured position.
Hence

    e+ = (Phi - K_p C_p) e + w - K_p v_p,       s+ = A_p s + K_p nu_p + d_p,   A_p = Phibar_p - Gammabar L,

where d_p holds the error of the plan itself, Phi x_ref + Gamma u_ff - x_ref+, and the reference, which the integrator
'literal' adds also without a fix. With the integrator 'estimate', A_p has the row -[I 0 0] of i and K_p none.

**The gains.** The filter's own P_k depends on the arrivals' history. Its gains are replaced by those of the expected
Riccati recursion, with one X_j for each state j of the links' Markov chains (pi their transitions, mu_j the chance
of j):

    X_j+ = sum_i mu_i pi_ij sum_p Pr(p | i) [F X_i F^T + W + K_p V_p K_p^T] / mu_j+,   F = Phi - K_p C_p,
    K_p = Phi X_i C_p^T S_p^-1,   S_p = C_p X_i C_p^T + V_p.

For independent losses there is one state: X bounds E[P_k] from above (Sinopoli et al., "Kalman filtering with
intermittent observations", IEEE TAC, 2004); with Markov losses these are the coupled equations of Costa, Fragoso and
Marques, "Discrete-Time Markov Jump Linear Systems", 2005, chapter 5. For a filter with these gains, linear in
the measurements, X_j = E[e e^T | j] exactly.

**The split.** With these gains E[e s^T | j] stays 0, because its driving term is
E[((Phi - K_p C_p) e - K_p v_p) nu_p^T] K_p^T = (Phi X_i C_p^T - K_p S_p) K_p^T = 0. So

    M_j+ = sum_i mu_i pi_ij sum_p Pr(p | i) [A_p M_i A_p^T + A_p m_i d_p^T + d_p m_i^T A_p^T + d_p d_p^T
                                             + K_p S_p K_p^T] / mu_j+,     M_j = E[s s^T | j],  m_j = E[s | j],

and since x - x_ref = e + (xhat - x_ref), its second moment is X + M (12 x 12) and its mean m.

**How it is computed.** With C_j = M_j - m_j m_j^T and U_p = X_i - X_i C_p^T S_p^-1 C_p X_i, the X of the vehicle's part
after the measurements,

    F X_i F^T + W + K_p V_p K_p^T = Phi U_p Phi^T + W,   K_p S_p K_p^T = Phi (X_i - U_p) Phi^T      (12 rows)

and U_p is updated sensor by sensor. A_p and the integral's rows of K_p, -E_p, depend only on whether a position
arrives. The chance of that is c. With J = [0; I] (15 x 15, a 1 in row 12 + a, column a) and A that of no arrival,

    sum_p Pr(p | i) A_p C A_p^T = A C A^T - c (J C A^T + A C J^T - J C J^T).

So a tick takes three products of sparse matrices a mode, however many patterns there are.

**What is approximate.** The vehicle is linear, at hover, and W and V are the filter's own. V_p, the possible fixes and
the blackouts are those on the planned path. Errors of successive fixes are taken as independent. A late measurement
enters as if it were current, in the filter and here. The filter that flies knows its arrivals, so its error is less
than X. The vehicle's deviation given its arrivals is wider at some times and narrower at others: it is a mixture, and
its tails are longer than those of the Gaussian that gives the tube.
"""

import numpy as np
from numba import njit

from ortilo_drake.model.measurement import Layout
from ortilo_drake.onboard.estimator.intermittent_filter import INTEGRATOR_ESTIMATE, INTEGRATOR_LITERAL
from ortilo_drake.studies.tube.tube_kernel import (
    mean_update,
    mixture_moments,
    position_chances,
    sandwich,
    sparse_times,
    transitions,
)


@njit(cache=True, nogil=True)
def propagate(
    Phi: np.ndarray,
    Gamma: np.ndarray,
    L: np.ndarray,
    W: np.ndarray,
    V: np.ndarray,
    there: np.ndarray,
    loss: np.ndarray,
    X_0: np.ndarray,
    d: np.ndarray,
    r: np.ndarray,
    r_servo: np.ndarray,
    integrator: int,
    layout: Layout,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return mean (n, 15) and covariance (n, 15, 15) of s and X = E[e e^T] (n, 12, 12) at every tick, over all modes.

    Args:
        Phi: (12, 12).
        Gamma: (12, 4).
        L: servo gain (4, 15).
        W: (12, 12).
        V: covariances of the sensors at every tick, each in the corner of a block (n, s, M, M).
        there: whether a sensor's message can arrive in a tick (n, s).
        loss: parameters of the links' chains (s, 4).
        X_0: (15, 15), its integrator block 0.
        d: Phi x_ref + Gamma u_ff - x_ref+ (n, 12).
        r: reference position, which the integral takes (n, 3).
        r_servo: the position in x_ref: r, or 0 in the paper's form of the servo (n, 3).
        integrator: one of INTEGRATORS.
        layout: of the measurement.
    """
    n, sensors, most = V.shape[:3]
    modes = 2**sensors
    means, covariances, errors = np.zeros((n, 15)), np.zeros((n, 15, 15)), np.zeros((n, 12, 12))
    mu, pi = np.zeros(modes), transitions(loss)
    m, C, X = np.zeros((modes, 15)), np.zeros((modes, 15, 15)), np.zeros((modes, 12, 12))
    m_next, C_next, X_next = np.zeros_like(m), np.zeros_like(C), np.zeros_like(X)
    mu[0], X[0] = 1.0, X_0[:12, :12]
    measured = integrator != INTEGRATOR_ESTIMATE  # whether the integral takes the measured position
    A = np.eye(15)
    A[:12, :12] = Phi
    A[:12] -= Gamma @ L
    if not measured:
        A[12:, :3] = -np.eye(3)
    AC, CA, PhiX, XPhi, driven = A.copy(), A.copy(), Phi.copy(), Phi.copy(), Phi.copy()
    U, P, S, Y = Phi.copy(), Phi.copy(), np.empty((most, most)), np.empty((most, 12))
    arrives, without, change = np.empty(sensors), np.zeros(3), np.zeros(3)
    for k in range(n):
        mixture_moments(mu, m, C, X, means[k], covariances[k], errors[k])
        for a in range(3):  # d_p of the integral without an arrival, and what an arrival changes of it
            with_one = r[k, a] - r_servo[k, a]
            without[a] = r[k, a] if integrator == INTEGRATOR_LITERAL else (0.0 if measured else with_one)
            change[a] = with_one - without[a]
        for i in range(modes):
            if mu[i] == 0.0:
                continue
            for s in range(sensors):
                arrives[s] = 1.0 - loss[s, 3 if (i >> s) & 1 else 2] if there[k, s] else 0.0
            mean_update(X[i], V[k], arrives, layout, U, P, S, Y)
            sandwich(A, C[i], AC, CA, C_next[i])
            m_next[i] = A @ m[i]
            m_next[i, :12] += d[k]
            m_next[i, 12:] += without
            sandwich(Phi, U, PhiX, XPhi, X_next[i])
            X_next[i] += W
            U[:] = X[i] - U
            sandwich(Phi, U, PhiX, XPhi, driven)
            C_next[i, :12, :12] += driven
            if measured:
                sparse_times(Phi, X[i], PhiX)
                chances = position_chances(arrives, layout[5])
                c = chances.sum()
                for a in range(3):
                    jump = change[a] - m[i, a]  # what an arrival adds to the integral's mean
                    m_next[i, 12 + a] += c * jump
                    for b in range(12):
                        cross = c * (AC[b, a] + PhiX[b, a])
                        C_next[i, b, 12 + a] -= cross
                        C_next[i, 12 + a, b] -= cross
                    for b in range(3):
                        noise = c * (1.0 - c) * jump * (change[b] - m[i, b])
                        for s in range(sensors):
                            noise += chances[s] * V[k, s, a, b] if chances[s] > 0.0 else 0.0
                        C_next[i, 12 + a, 12 + b] += (
                            c * (C[i, a, b] + X[i, a, b] - AC[12 + a, b] - AC[12 + b, a]) + noise
                        )
        mu_next = mu @ pi
        for j in range(modes):
            if mu_next[j] > 0.0:
                mixture_moments(mu * pi[:, j] / mu_next[j], m_next, C_next, X_next, m[j], C[j], X[j])
        mu = mu_next
    return means, covariances, errors
