"""The recursion behind the tube: mean and covariance of the linear loop under intermittent measurements.

The loop, in deviations from hover, with random arrivals p at each tick (which messages of uwb, camera and imu come):

    x+ = Phi x + Gamma u + w,   u = u_ff - L s,   s = [xhat - x_ref; i]                          (vehicle, servo)
    xbarhat+ = Phibar_p xbarhat + Gammabar u + Ibar r + K_p nu_p,   nu_p = C_p e + v_p               (filter)

with e = x - xhat, the error of the prediction. K_p (15 rows) is the gain of the filter that flies, see
onboard/estimator/intermittent_filter.py; its last rows are -E_p, because the integral takes the measured position.
Hence

    e+ = (Phi - K_p C_p) e + w - K_p v_p,       s+ = A_p s + K_p nu_p + d_p,   A_p = Phibar_p - Gammabar L,

where d_p holds the plan's own error, Phi x_ref + Gamma u_ff - x_ref+, and the reference that the integral adds without
a fix ('literal'). With the integrator 'estimate', A_p has the rows -[I 0 0] for i, and K_p has no rows for i.

**The gains.** The filter's own P_k depends on the history of arrivals. Its gains are replaced by gains of the expected
Riccati recursion, with one X_j for each state j of the links' Markov chains (transitions pi, chance mu_j of state j):

    X_j+ = sum_i mu_i pi_ij sum_p Pr(p | i) [F X_i F^T + W + K_p V_p K_p^T] / mu_j+,   F = Phi - K_p C_p,
    K_p = Phi X_i C_p^T S_p^-1,   S_p = C_p X_i C_p^T + V_p.

For independent losses there is one state: X bounds E[P_k] from above (Sinopoli et al., "Kalman filtering with
intermittent observations", IEEE TAC, 2004); with Markov losses these are the coupled equations of Costa, Fragoso and
Marques, "Discrete-Time Markov Jump Linear Systems", 2005, chapter 5. A filter with these gains is linear in the
measurements, and X_j = E[e e^T | j] holds exactly for it.

**The split.** With these gains E[e s^T | j] = 0 stays 0, because its driving term is
E[((Phi - K_p C_p) e - K_p v_p) nu_p^T] K_p^T = (Phi X_i C_p^T - K_p S_p) K_p^T = 0. So

    M_j+ = sum_i mu_i pi_ij sum_p Pr(p | i) [A_p M_i A_p^T + A_p m_i d_p^T + d_p m_i^T A_p^T + d_p d_p^T
                                             + K_p S_p K_p^T] / mu_j+,     M_j = E[s s^T | j],  m_j = E[s | j],

and since x - x_ref = e + (xhat - x_ref), x - x_ref has the second moment X + M (12 x 12) and the mean m.

**How it is computed.** With C_j = M_j - m_j m_j^T and U_p = X_i - X_i C_p^T S_p^-1 C_p X_i, X of the vehicle's part
after the measurements,

    F X_i F^T + W + K_p V_p K_p^T = Phi U_p Phi^T + W,   K_p S_p K_p^T = Phi (X_i - U_p) Phi^T      (12 rows)

and U_p is computed sensor by sensor, three rows at a time. A_p and the integral's rows of K_p, -E_p, depend only on
whether a position arrives, which has the chance c. With J = [0; I] (15 x 15, a 1 in row 12 + a, column a),

    sum_p Pr(p | i) A_p C A_p^T = A C A^T - c (J C A^T + A C J^T - J C J^T),   with A for no arrival.

So a tick takes three products of sparse matrices for each mode, for any number of patterns. Cases that differ in their
losses or arrivals go through the recursion together, side by side in the last axis of every array (tube_kernel.py).

**Approximations.** The vehicle is linear, at hover, and W and V are the filter's own. V_p, the availability of fixes
and the blackouts are those on the planned path. Errors of successive fixes are taken as independent. A late measurement
enters as if it were current, in the filter and here. The filter that flies knows its arrivals and so does better than
X. But the vehicle's deviation, given the arrivals, is wider at times and narrower at others: it is a mixture, with
longer tails than the Gaussian from which the tube is drawn.
"""

import numpy as np

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.measurement import Layout
from ortilo_drake.onboard.estimator.intermittent_filter import INTEGRATOR_ESTIMATE, INTEGRATOR_LITERAL
from ortilo_drake.studies.tube.tube_kernel import (
    add_measured,
    add_product,
    arrival_chances,
    mean_update,
    mixture_moments,
    sandwich,
    transitions,
)


@cached_njit(nogil=True)
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
    kept: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return mean (n, m, B) and covariance (n, m, m, B) of s and X = E[e e^T] (n, m, m, B) at every tick in B cases.

    They are of the first m = `kept` states. The hover loop gives Phi (12, 12), Gamma (12, 4), W (12, 12), the servo's
    gain L (4, 15), the integrator and the layout of the measurement; X_0 (15, 15) has an integrator block of 0.
    V: the sensors' covariances at every tick, each in the corner of a block (n, s, M, M); there: whether a sensor's
    message can arrive at a tick (n, s, B); loss: the parameters of the links' chains (s, 4, B). The plan gives
    d = Phi x_ref + Gamma u_ff - x_ref+ (n, 12), the reference position r, which the integral takes (n, 3), and
    r_servo, the position in x_ref: r, or 0 in the paper's form of the servo (n, 3).
    """
    n, B = V.shape[0], loss.shape[2]
    measured = integrator != INTEGRATOR_ESTIMATE  # whether the integral takes the measured position
    D_Phi, D_A = Phi - np.eye(12), np.zeros((15, 15))  # Phi and A less I
    D_A[:12, :12] = D_Phi
    D_A[:12] -= Gamma @ L
    if not measured:
        D_A[12:, :3] = -np.eye(3)
    in_Phi, in_A, pi = np.nonzero(D_Phi), np.nonzero(D_A), transitions(loss)
    means, covs, errors = (
        np.empty((n, kept, B)),
        np.empty((n, kept, kept, B)),
        np.empty((n, min(kept, 12), min(kept, 12), B)),
    )
    modes = pi.shape[0]
    mu, weights = np.zeros((modes, B)), np.zeros((modes, B))
    m, C, X = np.zeros((modes, 15, B)), np.zeros((modes, 15, 15, B)), np.zeros((modes, 12, 12, B))
    m_next, C_next, X_next = np.zeros_like(m), np.zeros_like(C), np.zeros_like(X)
    AC, CA, PhiX, XPhi, driven, U = C[0].copy(), C[0].copy(), X[0].copy(), X[0].copy(), X[0].copy(), X[0].copy()
    is_position = layout[5]
    one_mode = np.all(pi[0, 0] == 1.0)  # no chain leaves its good state
    change = np.empty(3)
    mu[0] = 1.0
    for q in range(B):
        X[0, :, :, q] = X_0[:12, :12]
    for k in range(n):
        mixture_moments(mu, m, C, X, means[k], covs[k], errors[k])
        for i in range(modes):
            if not np.any(mu[i]):
                continue
            chances = arrival_chances(i, there[k], loss)
            mean_update(X[i], V[k], chances, layout, U, XPhi)
            sandwich(D_Phi, *in_Phi, U, PhiX, XPhi, X_next[i])
            sandwich(D_Phi, *in_Phi, X[i], PhiX, XPhi, driven)
            sandwich(D_A, *in_A, C[i], AC, CA, C_next[i])
            add_product(D_A, *in_A, m[i], m_next[i], False)
            for a in range(12):
                m_next[i, a] += d[k, a]
                for b in range(12):
                    for q in range(B):
                        C_next[i, a, b, q] += driven[a, b, q] - X_next[i, a, b, q]
                        X_next[i, a, b, q] += W[a, b]
            for a in range(3):  # d_p of the integral without an arrival, and its change by an arrival
                with_one = r[k, a] - r_servo[k, a]
                without = r[k, a] if integrator == INTEGRATOR_LITERAL else (0.0 if measured else with_one)
                m_next[i, 12 + a] += without
                change[a] = with_one - without
            if measured:
                before = m[i], C[i], X[i], AC, PhiX
                add_measured(*before, V[k], chances, is_position, change, m_next[i], C_next[i])
        if one_mode:
            m, C, X, m_next, C_next, X_next = m_next, C_next, X_next, m, C, X
            continue
        mu_before = mu.copy()
        mu[:] = 0.0
        for j in range(modes):
            for i in range(modes):
                mu[j] += mu_before[i] * pi[i, j]
        for j in range(modes):
            if not np.any(mu[j]):
                continue
            for i in range(modes):
                for q in range(B):
                    weights[i, q] = mu_before[i, q] * pi[i, j, q] / mu[j, q] if mu[j, q] > 0.0 else 0.0
            mixture_moments(weights, m_next, C_next, X_next, m[j], C[j], X[j])
    return means, covs, errors
