"""The tube about the planned path: where the linear theory expects the vehicle under intermittent measurements.

The loop, in deviations from hover, with the arrivals p of a tick (which of uwb, camera and imu are there) random:

    x+ = Phi x + Gamma u + w,   u = u_ff - L s,   s = [xhat - x_ref; i]                          (vehicle, servo)
    xbarhat+ = Phibar_p xbarhat + Gammabar u + Ibar r + K_p nu_p,   nu_p = C_p e + v_p               (filter)

with e = x - xhat, the error of the prediction. K_p (15 rows) is the gain of the filter that flies, see
onboard/intermittent_filter.py; its last rows are -E_p, because the integral takes the measured position. Hence

    e+ = (Phi - K_p C_p) e + w - K_p v_p,       s+ = A_p s + K_p nu_p + d_p,   A_p = Phibar_p - Gammabar L,

where d_p holds what the plan itself does wrong, Phi x_ref + Gamma u_ff - x_ref+, and the reference that
integrates without a fix ('literal'). With the integrator 'estimate', A_p has the row -[I 0 0] of i and K_p none.

**The gains.** The filter's own P_k depends on the arrivals' history. In their place stand gains of the expected
Riccati recursion, one X_j for each state j of the links' Markov chains (pi their transitions, mu_j the chance of j):

    X_j+ = sum_i mu_i pi_ij sum_p Pr(p | i) [F X_i F^T + W + K_p V_p K_p^T] / mu_j+,   F = Phi - K_p C_p,
    K_p = Phi X_i C_p^T S_p^-1,   S_p = C_p X_i C_p^T + V_p.

For independent losses there is one state: X bounds E[P_k] from above (Sinopoli et al., "Kalman filtering with
intermittent observations", IEEE TAC, 2004); with Markov losses these are the coupled equations of Costa, Fragoso and
Marques, "Discrete-Time Markov Jump Linear Systems", 2005, chapter 5. For a filter with these gains, linear in
the measurements, X_j = E[e e^T | j] exactly.

**The split.** With these very gains E[e s^T | j] = 0 stays 0, for its driving term is
E[((Phi - K_p C_p) e - K_p v_p) nu_p^T] K_p^T = (Phi X_i C_p^T - K_p S_p) K_p^T = 0. So

    M_j+ = sum_i mu_i pi_ij sum_p Pr(p | i) [A_p M_i A_p^T + A_p m_i d_p^T + d_p m_i^T A_p^T + d_p d_p^T
                                             + K_p S_p K_p^T] / mu_j+,     M_j = E[s s^T | j],  m_j = E[s | j],

and since x - x_ref = e + (xhat - x_ref), its second moment is X + M (12 x 12) and its mean m.

**What is approximate.** The vehicle is linear, at hover, and W and V are what the filter believes of both. V_p is that
of fixes on the planned path, and a fix is there where it would be there; blackouts likewise. Errors of successive fixes
are taken as independent. A measurement that comes late enters as if current, in the filter and here. The filter that
flies knows its arrivals and so does better than X, but the vehicle's deviation, given its arrivals, is wider at
times and narrower at others: a mixture, whose tails are longer than the Gaussian's that the tube is drawn from.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from ortilo_drake.analysis.course import Course, course_of
from ortilo_drake.analysis.disc_radius import THREE_SIGMA, disc_radii
from ortilo_drake.analysis.hover_loop import hover_loop
from ortilo_drake.model.signals import SENSORS
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.intermittent_filter import (
    INTEGRATOR_ESTIMATE,
    INTEGRATOR_LITERAL,
    INTEGRATORS,
    STATE_OF_ROW,
    augmented_dynamics,
    integrated_sensor,
    joseph,
    transposed_gain,
)
from ortilo_drake.onboard.kalman_filter import initial_covariance
from ortilo_drake.scenario import Scenario
from ortilo_drake.world.link import loss_parameters

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


class Tube(NamedTuple):
    """Where the vehicle is expected about r_k.

    Attributes:
        time: t_k [s] (n).
        r: the planned path [m] (n, 3).
        mean: expected deviation of the true position from r_k [m] (n, 3).
        covariance: of that deviation [m^2] (n, 3, 3).
        X: expected covariance of the filter's position error [m^2] (n, 3, 3).
        radius: of the horizontal disc about r_k that the vehicle is outside of with the probability of 3 sigma,
            0.27 % [m] (n).
        height: |mean| and 3 sigma of the vertical deviation [m] (n).
    """

    time: np.ndarray
    r: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray
    X: np.ndarray
    radius: np.ndarray
    height: np.ndarray


def horizontal_and_vertical(mean: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a tube's radius and height (n) from means (n, 3) and covariances (n, 3, 3) of the deviation."""
    plane = np.ascontiguousarray(mean[:, :2]), np.ascontiguousarray(covariance[:, :2, :2])
    return disc_radii(*plane, THREE_SIGMA), np.abs(mean[:, 2]) + 3.0 * np.sqrt(covariance[:, 2, 2])


def predict_tube(scenario: Scenario, course: Course | None = None) -> Tube:
    """Return the tube that the linear theory predicts for a scenario.

    Args:
        scenario: the scenario; its losses, gains and weights count.
        course: the path and its fixes, if at hand; it depends on anything but the losses and the servo's gains.

    Raises:
        InputError: where the theory has no answer (a servo fed true velocities, messages late at random), no path, or
            no gain.
    """
    course = course_of(scenario) if course is None else course
    mean, covariance, X = deviation(scenario, course)
    return Tube(course.time, course.r, mean, covariance, X, *horizontal_and_vertical(mean, covariance))


def deviation(scenario: Scenario, course: Course) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return mean (n, 3) and covariance (n, 3, 3) of the position's deviation from r_k, and X of the position.

    Where nothing is lost at random, so that the course's arrivals are *the* arrivals, X is the filter's own P_k.
    Arguments and errors as in predict_tube.
    """
    if scenario.servo.velocities == "truth":
        raise InputError("servo.velocities: 'truth': the tube is that of a servo fed by the filter, give 'estimate'")
    loop = hover_loop(scenario)
    x_ref, u_ff = course.x_ref, course.u_ff
    d = x_ref[:-1] @ loop.Phi.T + u_ff[:-1] @ loop.Gamma.T - x_ref[1:]
    d = np.vstack([d, np.zeros((1, d.shape[1]))])
    loss = np.array([loss_parameters(scenario.link_of(s).loss) for s in SENSORS])
    means, moments, errors = propagate(
        loop.Phi,
        loop.Gamma,
        loop.L,
        loop.W,
        course.V,
        course.there,
        loss,
        initial_covariance(scenario.filter),
        d,
        course.r,
        np.ascontiguousarray(x_ref[:, :3]),
        INTEGRATORS[loop.integrator],
    )
    X = errors[:, :3, :3]
    mean = means[:, :3] + x_ref[:, :3] - course.r
    return mean, moments[:, :3, :3] - means[:, :3, None] * means[:, None, :3] + X, X
