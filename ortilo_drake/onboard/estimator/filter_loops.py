"""The step of intermittent_filter.py with the kernel of kalman.py, faster than with whole matrices.

The integral i of xbar = [x; e; i] is known: P_ii starts at 0, so the printed equations give K_i = -E and P_ii = 0, and

    i_{k+1} = i_k + r_k - E y_k.

The rest is a Kalman filter of the N states [x; e], which measures and then predicts; Phibar K is the printed gain.
"""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.measurement import Layout
from ortilo_drake.model.signals import N_I, N_X
from ortilo_drake.onboard.estimator.intermittent_filter import (
    INTEGRATOR_ESTIMATE,
    INTEGRATOR_LITERAL,
    FilterModel,
    integrated_sensor,
    tilted_lift,
)
from ortilo_drake.onboard.estimator.kalman import measure, predict, propagate


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
