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

**What is approximate.** The vehicle is linear, at hover, and W and V are the filter's own. V_p, the possible fixes and
the blackouts are those on the planned path. Errors of successive fixes are taken as independent. A late measurement
enters as if it were current, in the filter and here. The filter that flies knows its arrivals, so its error is less
than X. The vehicle's deviation given its arrivals is wider at some times and narrower at others: it is a mixture, and
its tails are longer than those of the Gaussian that gives the tube.
"""

import numpy as np
from numba import njit

from ortilo_drake.onboard.estimator.intermittent_filter import (
    INTEGRATOR_ESTIMATE,
    INTEGRATOR_LITERAL,
    STATE_OF_ROW,
    augmented_dynamics,
    integrated_sensor,
    joseph,
    transposed_gain,
)

N_MODES = 8  # bit s of a mode: the chain of sensor s is bad


@njit(cache=True)
def transition(i: int, j: int, loss: np.ndarray) -> float:
    """Return pi_ij of the three chains together; loss (3, 4) as link.loss_parameters."""
    chance = 1.0
    for s in range(3):
        bad, after = (i >> s) & 1, (j >> s) & 1
        leaves = loss[s, 1] if bad else loss[s, 0]
        chance *= leaves if bad != after else 1.0 - leaves
    return chance


@njit(cache=True)
def pattern_chance(p: int, i: int, there: np.ndarray, loss: np.ndarray) -> float:
    """Return Pr(p | i); bit s of p: sensor s arrives, which it cannot where it is not there (3)."""
    chance = 1.0
    for s in range(3):
        arrives = 1.0 - loss[s, 3 if (i >> s) & 1 else 2] if there[s] else 0.0
        chance *= arrives if (p >> s) & 1 else 1.0 - arrives
    return chance


@njit(cache=True)
def add_driven(M: np.ndarray, X: np.ndarray, KT: np.ndarray, V2: np.ndarray, rows: np.ndarray) -> None:
    """Add K S K^T to M (15, 15), S = C X C^T + V of the rows that arrived. Arguments as transposed_gain."""
    m = rows.shape[0]
    for a in range(m):
        for b in range(m):
            S = X[STATE_OF_ROW[rows[a]], STATE_OF_ROW[rows[b]]]
            if rows[a] // 3 == rows[b] // 3:
                S += V2[rows[a] // 3, rows[a] % 3, rows[b] % 3]
            for i in range(15):
                for j in range(15):
                    M[i, j] += KT[a, i] * S * KT[b, j]


@njit(cache=True)
def sandwich(A: np.ndarray, M: np.ndarray) -> np.ndarray:
    """Return A M A^T (15, 15), exactly symmetric, of a symmetric M."""
    AM, out = np.zeros((15, 15)), np.zeros((15, 15))
    for i in range(15):
        for k in range(15):
            if A[i, k] != 0.0:
                for j in range(15):
                    AM[i, j] += A[i, k] * M[k, j]
    for i in range(15):
        for j in range(i, 15):
            for k in range(15):
                out[i, j] += AM[i, k] * A[j, k]
            out[j, i] = out[i, j]
    return out


@njit(cache=True)
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
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return E[s] (n, 15), E[s s^T] (n, 15, 15) and X = E[e e^T] (n, 12, 12) at every tick, the modes averaged.

    Args:
        Phi: (12, 12).
        Gamma: (12, 4).
        L: servo gain (4, 15).
        W: (12, 12).
        V: covariances of the three sensors at every tick (n, 3, 3, 3).
        there: whether a sensor's message can arrive in a tick (n, 3).
        loss: parameters of the three links' chains (3, 4).
        X_0: (15, 15), its integrator block 0.
        d: Phi x_ref + Gamma u_ff - x_ref+ (n, 12).
        r: reference position, which the integral takes (n, 3).
        r_servo: the position in x_ref: r, or 0 in the paper's form of the servo (n, 3).
        integrator: one of INTEGRATORS.
    """
    n = V.shape[0]
    means, moments, errors = np.zeros((n, 15)), np.zeros((n, 15, 15)), np.zeros((n, 12, 12))
    mu, m = np.zeros(N_MODES), np.zeros((N_MODES, 15))
    X, M = np.zeros((N_MODES, 15, 15)), np.zeros((N_MODES, 15, 15))
    mu[0], X[0] = 1.0, X_0
    GammaL = np.zeros((15, 15))
    GammaL[:12] = Gamma @ L
    delta, d_p = np.empty(3), np.zeros(15)
    for k in range(n):
        mu_next, m_next = np.zeros(N_MODES), np.zeros((N_MODES, 15))
        X_next, M_next = np.zeros((N_MODES, 15, 15)), np.zeros((N_MODES, 15, 15))
        for i in range(N_MODES):
            if mu[i] == 0.0:
                continue
            means[k] += mu[i] * m[i]
            moments[k] += mu[i] * M[i]
            errors[k] += mu[i] * X[i, :12, :12]
            X_i, M_i, m_i = np.zeros((15, 15)), np.zeros((15, 15)), np.zeros(15)
            for p in range(8):
                chance = pattern_chance(p, i, there[k], loss)
                if chance == 0.0:
                    continue
                count = 0
                for s in range(3):
                    delta[s] = float((p >> s) & 1)
                    count += 3 * ((p >> s) & 1)
                rows = np.empty(count, dtype=np.int64)
                at = 0
                for row in range(9):
                    if delta[row // 3] != 0.0:
                        rows[at] = row
                        at += 1
                chosen = integrated_sensor(delta, integrator)
                Phibar = augmented_dynamics(Phi, chosen)
                KT = transposed_gain(X[i], Phibar, V[k], rows, chosen)
                X_i += chance * joseph(X[i], Phibar, KT, W, V[k], rows, chosen)
                A = Phibar - GammaL
                d_p[:12] = d[k]
                for a in range(3):
                    if integrator == INTEGRATOR_ESTIMATE:
                        A[12 + a, a] = -1.0
                    d_p[12 + a] = 0.0
                    if integrator == INTEGRATOR_ESTIMATE or chosen >= 0:
                        d_p[12 + a] = r[k, a] - r_servo[k, a]
                    elif integrator == INTEGRATOR_LITERAL:
                        d_p[12 + a] = r[k, a]
                M_p = sandwich(A, M[i])
                Am = A @ m[i]
                for a in range(15):
                    for b in range(15):
                        M_p[a, b] += Am[a] * d_p[b] + d_p[a] * Am[b] + d_p[a] * d_p[b]
                add_driven(M_p, X[i], KT, V[k], rows)
                M_i += chance * M_p
                m_i += chance * (Am + d_p)
            for j in range(N_MODES):
                weight = mu[i] * transition(i, j, loss)
                if weight > 0.0:
                    mu_next[j] += weight
                    m_next[j] += weight * m_i
                    X_next[j] += weight * X_i
                    M_next[j] += weight * M_i
        for j in range(N_MODES):
            if mu_next[j] > 0.0:
                m_next[j] /= mu_next[j]
                X_next[j] = 0.5 * (X_next[j] + X_next[j].T) / mu_next[j]
                M_next[j] = 0.5 * (M_next[j] + M_next[j].T) / mu_next[j]
        mu, m, X, M = mu_next, m_next, X_next, M_next
    return means, moments, errors
