"""Fly an estimator of your own as an element that the linear theory knows: a Kalman filter of ranges and angles.

    python examples/kalman_filter.py
    ortilo --plugin examples/kalman_filter.py analyze nominal_imu_uwb --set 'estimator={kind: own_kalman}'

`linear` gives the linear filter that it equals near hover. So `ortilo analyze` has its Riccati equations, margins,
arrival rates and lost commands, and the tube, the maps and the floor include it as well.
"""

from typing import Any, Literal

import numpy as np

import ortilo_drake as od
from ortilo_drake.model.white_noise import white_variances
from ortilo_drake.onboard.estimator.filter_model import filter_model, initial_covariance


class OwnKalman(od.Frozen):
    """An estimator's settings.

    Attributes:
        kind: 'own_kalman'.
        sd: of a position from ranges, as the filter believes [m].
    """

    kind: Literal["own_kalman"]
    sd: float = 0.1


def say(x: np.ndarray, P: np.ndarray, out: np.ndarray) -> None:
    """Write the estimate (12) and its covariance row by row (144)."""
    out[:12] = x
    out[12:] = P.ravel()


def step(
    n: Any, uwb: np.ndarray, imu: np.ndarray, control: np.ndarray, anchors: np.ndarray, V: np.ndarray,
    Phi: np.ndarray, Gamma: np.ndarray, W: np.ndarray, x: np.ndarray, P: np.ndarray,
) -> None:  # fmt: skip
    """Correct the state with the rows that arrived, one by one, and predict the next tick."""
    y, there, a = x[:6].copy(), np.zeros(6), len(anchors)
    if uwb[0] != 0.0 and uwb[2 + a :].sum() == a:  # the position by a step of Gauss and Newton
        J, away = np.zeros((a, 3)), np.zeros(a)
        for i in range(a):
            distance = np.sqrt(np.sum((x[:3] - anchors[i]) ** 2))
            J[i], away[i] = (x[:3] - anchors[i]) / distance, uwb[2 + i] - distance
        y[:3] += np.linalg.solve(J.T @ J, J.T @ away)
        there[:3] = 1.0
    if imu[0] != 0.0:
        y[3:], there[3:] = imu[2:5], 1.0
    for i in range(6):
        if there[i] != 0.0:
            k = P[:, i] / (P[i, i] + V[i])
            x += k * (y[i] - x[i])
            P -= np.outer(k, P[i].copy())
    u = control.copy()
    u[0] -= n.hover
    x[:] = Phi @ x + Gamma @ u
    P[:] = Phi @ P @ Phi.T + W


def variance_of(belief: Any) -> float:
    """Return the variance of a position from ranges [m^2]."""
    return float(belief.estimator.sd**2)


def linear(belief: od.Belief) -> od.IntermittentFilter:
    """Return the linear filter near hover; its integral is of the estimate, as it has twelve states."""
    return od.IntermittentFilter.model_validate({"V": {"uwb": (variance_of(belief),) * 3}, "integrator": "estimate"})


def make(belief: od.Belief, xbar_0: np.ndarray) -> od.Box:
    """Return the estimator of a scenario, which begins at the first estimate (15)."""
    its, room = linear(belief), belief.load_room()
    model = filter_model(its, belief.vehicle, its.integrator, belief.h, belief.yaw)
    V = np.append([variance_of(belief)] * 3, white_variances(its.V.imu, belief.imu_period))
    tables = {"V": V, "Phi": model.Phi, "Gamma": model.Gamma, "W": model.W, "anchors": room.anchor_positions}
    state = {"x": xbar_0[:12], "P": initial_covariance(its)[:12, :12]}
    return od.box(156, say, step, numbers={"hover": belief.vehicle.hover_thrust}, tables=tables, state=state)


od.register_estimator("own_kalman", OwnKalman, box=make, linear=linear)


if __name__ == "__main__":
    print(od.fly("nominal_imu_uwb", seed=1, estimator={"kind": "own_kalman"}, uwb__link__blackouts=[]))
