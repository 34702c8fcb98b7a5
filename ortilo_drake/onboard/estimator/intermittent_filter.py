"""The Kalman filter's equations with intermittent, correlated measurements (paper, section IV-C).

State xbar = [x; i] (15): the vehicle's twelve states and the three integrals of the position error.

    xbar_{k+1} = Phibar xbar_k + Gammabar u_k + Ebar [w_k; v_k] + Ibar r_k,   y_k = H_k xbar_k + Delta_k v_k

with Phibar = [[Phi, 0], [-E C, I]], Gammabar = [Gamma; 0], Ebar = [[I, 0], [0, -E]], Cbar = [C, 0],
H_k = Delta_k Cbar, V1 = blkdiag(W, V2) and V12 = [0; V2], so that Ebar V12 = [0; -E V2]. The printed equations, with
two misprints corrected (Phibar and P_k throughout, V12^T Ebar^T in the last factor), are:

    K_k = (Phibar P_k H^T + Ebar V12) (H P_k H^T + V2)^-1                                       (gain)
    P_{k+1} = Phibar P_k Phibar^T + Ebar V1 Ebar^T - K_k (H P_k Phibar^T + V12^T Ebar^T)        (covariance)
    xhat_{k+1|k} = Phibar xhat_{k|k-1} + Gammabar u_k + Ibar r_k + K_k (y_k - H xhat_{k|k-1})   (prediction)

intermittent_step is these three lines in plain Python. Flights use step_in_place, which computes the same faster with
the kernel of kalman.py; a test compares the two.

The code leaves out rows that did not arrive. The result equals the full-size formula because V2 is block diagonal. The
integral is known without error: P_ii starts at 0, so the last three rows of K equal -E_k, P_ii stays 0, and

    i_{k+1} = i_k + r_k - E_k y_k.

The rest is a Kalman filter of [x; e], which measures and then predicts; Phibar K is the printed gain.

A filter that estimates more than the paper's, such as the disturbance force, has xbar = [x; e; i]. Its Phi, Gamma, W
and C are those over [x; e], see extra_states.py; the three lines are the same. Its prediction adds Gamma_a tilted_lift,
the acceleration of a tilted lift that the hover model leaves out.
"""

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.elementary import sin_cos
from ortilo_drake.model.equations import thrust_direction
from ortilo_drake.model.measurement import Layout
from ortilo_drake.model.signals import N_I, N_X
from ortilo_drake.model.triples import Triple
from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.onboard.estimator.kalman import (
    Structure,
    measure,
    predict,
    predicted_covariance,
    predictor_gain,
    propagate,
    structure_of,
)

# The integrator's law. 'literal' (the paper) and 'hold' integrate the measured position inside the filter's model:
# i_{k+1} = i_k + r_k - E_k y_k; 'hold' skips it where E_k = 0. 'estimate' (the authors' code) integrates the estimate,
# i_{k+1} = i_k + r_k - p_hat_k: the Kalman filter then has 12 states, and the integral is computed beside it.
INTEGRATOR_ESTIMATE, INTEGRATOR_LITERAL, INTEGRATOR_HOLD = 0, 1, 2
INTEGRATORS = {"estimate": INTEGRATOR_ESTIMATE, "literal": INTEGRATOR_LITERAL, "hold": INTEGRATOR_HOLD}


class FilterModel(NamedTuple):
    """The filter's model of the vehicle, with N = 12 states x or with N > 12 states [x; e]."""

    Phi: np.ndarray
    """discrete state matrix (N, N)."""
    Gamma: np.ndarray
    """discrete input matrix of the control (N, 4)."""
    W: np.ndarray
    """process noise covariance (N, N)."""
    integrator: int
    """INTEGRATOR_ESTIMATE, INTEGRATOR_LITERAL or INTEGRATOR_HOLD."""
    Gamma_a: np.ndarray
    """discrete input matrix of an acceleration in W (N, 3); used only with states e, as the paper's hover model does
    not tilt the lift."""
    mass: float
    """m [kg]; used only with states e."""
    yaw: float
    """heading of the hover about which the model is linearized [rad]; used only with states e."""
    structure: Structure
    """nonzero entries of Phi, computed by `of`."""

    @classmethod
    def of(
        cls,
        Phi: np.ndarray,
        Gamma: np.ndarray,
        W: np.ndarray,
        integrator: int,
        Gamma_a: np.ndarray = np.zeros((N_X, 3)),  # noqa: B008 - none writes to it
        mass: float = 1.0,
        yaw: float = 0.0,
    ) -> "FilterModel":
        """Return the model with these matrices and the computed structure of Phi."""
        return cls(Phi, Gamma, W, integrator, Gamma_a, mass, yaw, structure_of(Phi))


@register_jitable
def tilted_lift(xbar: np.ndarray, u: np.ndarray, mass: float, yaw: float) -> Triple:
    """Return the part of the lift's acceleration in W (3) that the hover model leaves out.

    The lift is l = (f_T + d_z) / m, with d_z the vertical disturbance force, which absorbs an error of mass or thrust.
    The lift acts along z_B; the hover model replaces l z_B by R_z(yaw) [g theta, -g phi, l]. xbar is [x; d; ...], u is
    the control less hover (4), m the mass [kg], and yaw the heading of the hover model [rad].
    """
    lift = GRAVITY + (u[0] + xbar[N_X + 2]) / mass
    z_B = thrust_direction(xbar[3], xbar[4], xbar[5])
    s, c = sin_cos(yaw)
    a_x, a_y = GRAVITY * (c * xbar[4] + s * xbar[3]), GRAVITY * (s * xbar[4] - c * xbar[3])
    return lift * z_B[0] - a_x, lift * z_B[1] - a_y, lift * (z_B[2] - 1.0)


@register_jitable
def integrated_sensor(delta: np.ndarray, is_position: np.ndarray, integrator: int) -> int:
    """Return the index of the sensor that E_k selects: the first position sensor that arrived, -1 if none did.

    With the paper's sensors, E_k = [Delta_1, not Delta_1 and Delta_2, 0].
    """
    if integrator != INTEGRATOR_ESTIMATE:
        for s in range(delta.shape[0]):
            if is_position[s] and delta[s] != 0.0:
                return s
    return -1


def intermittent_step(
    xhat: np.ndarray,
    P: np.ndarray,
    y: np.ndarray,
    delta: np.ndarray,
    V2_blocks: np.ndarray,
    u: np.ndarray,
    r: np.ndarray,
    model: FilterModel,
    layout: Layout,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return xhat_{k+1|k} (15), P_{k+1} (15, 15) and K_k (15, p); columns of K_k are 0 for rows that did not arrive.

    xhat and P are xhat_{k|k-1} and P_k; y holds the values (p), delta says which sensors arrived (s), V2_blocks holds
    each sensor's covariance row by row (q), u is the control less hover (4), r the reference, whose first three numbers
    are the position [m].
    """
    Phi, Gamma, W, integrator, Gamma_a, mass, yaw, _ = model
    first, sensors = layout.first, np.flatnonzero(delta != 0.0)
    arrived = np.repeat(delta != 0.0, np.diff(first))  # by row
    chosen = integrated_sensor(delta, layout.is_position, integrator)
    N, m = Phi.shape[0], np.count_nonzero(arrived)
    n = N + N_I

    H = np.zeros((m, n))
    H[:, :N] = layout.C[arrived]
    V2_all, E_all = np.zeros((y.size, y.size), V2_blocks.dtype), np.zeros((N_I, y.size))
    for s in sensors:
        own = slice(first[s], first[s + 1])
        V2_all[own, own] = V2_blocks[layout.block[s] : layout.block[s + 1]].reshape(own.stop - own.start, -1)
    if chosen >= 0:
        E_all[:, first[chosen] : first[chosen] + N_I] = np.eye(N_I)
    V2, E = V2_all[np.ix_(arrived, arrived)], E_all[:, arrived]

    Phibar = np.eye(n)
    Phibar[:N, :N] = Phi
    Phibar[N:, :] -= E @ H
    Gammabar = np.zeros((n, 4))
    Gammabar[:N] = Gamma
    Ebar_V1_EbarT = np.zeros((n, n), V2.dtype)
    Ebar_V1_EbarT[:N, :N] = W
    Ebar_V1_EbarT[N:, N:] = E @ V2 @ E.T
    Ebar_V12 = np.zeros((n, m), V2.dtype)
    Ebar_V12[N:] = -E @ V2
    Ibar_r = np.zeros(n, xhat.dtype)
    if integrator == INTEGRATOR_ESTIMATE:
        Ibar_r[N:] = r[:3] - xhat[:3]
    elif integrator == INTEGRATOR_LITERAL or chosen >= 0:
        Ibar_r[N:] = r[:3]

    Gammabar_a = np.zeros(n, xhat.dtype)
    if N > N_X:
        Gammabar_a[:N] = Gamma_a @ np.array(tilted_lift(xhat, u, mass, yaw))

    K = predictor_gain(Phibar, H, V2, P, Ebar_V12)
    P_next = predicted_covariance(Phibar, H, Ebar_V1_EbarT, P, K, Ebar_V12)
    xhat_next = Phibar @ xhat + Gammabar @ u + Gammabar_a + Ibar_r + K @ (y[arrived] - H @ xhat)

    gain = np.zeros((n, y.size), K.dtype)
    gain[:, arrived] = K
    return xhat_next, P_next, gain


def filter_gain(
    P: np.ndarray, delta: np.ndarray, V2: np.ndarray, Phi: np.ndarray, integrator: int, layout: Layout
) -> np.ndarray:
    """Return K_k (n x p), with columns of 0 for rows that did not arrive. Arguments as in intermittent_step."""
    N = len(Phi)
    model = FilterModel.of(Phi, np.zeros((N, 4)), np.zeros((N, N)), integrator, np.zeros((N, 3)))
    x, y, u, r = np.zeros(N + N_I), np.zeros(layout.first[-1]), np.zeros(4), np.zeros(3)
    return intermittent_step(x, P, y, delta, V2, u, r, model, layout)[2]


@register_jitable
def to_work_in(n: int, p: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the work arrays `rows` and `S` of step_in_place, for n states (with the integral) and p values."""
    return np.empty((max(n - N_I, p), n - N_I + 1)), np.empty((p, p))


@cached_njit(_nrt=False)
def step_in_place(
    rows: np.ndarray,
    S: np.ndarray,
    belief: np.ndarray,
    y: np.ndarray,
    delta: np.ndarray,
    V2: np.ndarray,
    u: np.ndarray,
    r: np.ndarray,
    model: FilterModel,
    layout: Layout,
) -> None:
    """Replace the belief [xhat_{k|k-1}, P_k row by row] (n + n^2), in which P_ii = 0, by the belief of tick k + 1.

    The step allocates nothing. rows and S are the work arrays of to_work_in; other arguments as in intermittent_step.
    """
    Phi, Gamma, W, integrator, Gamma_a, mass, yaw, structure = model
    _, states, weights, first, block, is_position = layout
    n = Phi.shape[0] + N_I
    P = belief[n:].reshape((n, n))
    N = W.shape[0]
    lift = tilted_lift(belief, u, mass, yaw) if N > N_X else (0.0, 0.0, 0.0)
    chosen = integrated_sensor(delta, is_position, integrator)
    for i in range(N_I):
        if integrator == INTEGRATOR_ESTIMATE:
            belief[N + i] += r[i] - belief[i]
        elif chosen >= 0:
            belief[N + i] += r[i] - y[first[chosen] + i]
        elif integrator == INTEGRATOR_LITERAL:
            belief[N + i] += r[i]

    for s in range(delta.size):
        if delta[s] != 0.0:
            measure(belief, P, y, V2[block[s] :], first[s + 1] - first[s], first[s], states, weights, S, rows)

    x = rows[0]
    predict(belief, u, Gamma, structure, x)
    for i in range(N):
        if N > N_X:
            x[i] += Gamma_a[i, 0] * lift[0] + Gamma_a[i, 1] * lift[1] + Gamma_a[i, 2] * lift[2]
        belief[i] = x[i]
    propagate(P, W, structure, rows)


@cached_njit
def filter_step(
    belief: np.ndarray,
    y: np.ndarray,
    delta: np.ndarray,
    V2: np.ndarray,
    u: np.ndarray,
    r: np.ndarray,
    model: FilterModel,
    layout: Layout,
) -> np.ndarray:
    """Return the belief [xhat_{k+1|k}, P_{k+1} row by row] (n + n^2), given the belief of tick k, in which P_ii = 0.

    Other arguments as in intermittent_step.
    """
    after = belief.copy()
    rows, S = to_work_in(model.Phi.shape[0] + N_I, layout.first[-1])
    step_in_place(rows, S, after, y, delta, V2, u, r, model, layout)
    return after
