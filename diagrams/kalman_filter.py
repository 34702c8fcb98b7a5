"""The intermittent Kalman filter of any linear model, for Diagrams of one's own.

Its name is in capitals as those of Drake's functions that make a system, such as LinearQuadraticRegulator.
"""

from __future__ import annotations  # help() shows types by their names

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.framework import System

from ortilo_drake.loop.diagram import system_of
from ortilo_drake.loop.element import bundle, outside
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.onboard.estimator.linear_filter import linear_filter_box, linear_model

NAME = "kalman_filter"


def IntermittentKalmanFilter(
    Phi: ArrayLike,
    Gamma: ArrayLike,
    W: ArrayLike,
    sensors: Mapping[str, tuple[ArrayLike, ArrayLike]],
    h: float,
    P_0: ArrayLike,
    x_0: ArrayLike | None = None,
) -> System:
    """Return the Kalman filter of a linear model whose measurements arrive now and then, as a System.

        x_{k+1} = Phi x_k + Gamma u_k + w_k,   y_{j,k} = C_j x_k + v_j where sensor j arrived

    It is the paper's filter (section IV-C) without the integral, in its one-step-predictor form: the estimate in tick k
    is made of what arrived before tick k, so that a controller that reads it makes no algebraic loop. The quadrotor's
    filter calls the same functions. It converts to AutoDiffXd and keeps all that evolves in its Context.

    Ports:
        u (m): control that acts from this tick to the next, as behind a ZeroOrderHold of period h.
        a port of each sensor, by its name (1 + m_j): [arrived, y_j]; where arrived is 0 the values are ignored.
        estimate (n, output): xhat_{k|k-1}.
        covariance (n^2, output): P_k row by row.

    Args:
        Phi: discrete dynamics (n, n).
        Gamma: discrete control input (n, m).
        W: covariance of w (n, n).
        sensors: C_j (m_j, n) and the covariance V_j (m_j, m_j) of each sensor, by its name.
        h: tick [s].
        P_0: covariance of the estimate in tick 0 (n, n).
        x_0: that estimate (n); 0 by default.

    Raises:
        ValueError: if a shape does not fit, a number is not finite, or a covariance is not symmetric and positive
            (V_j definite).

    Example:
        >>> Phi, Gamma = [[1.0, 0.1], [0.0, 1.0]], [[0.005], [0.1]]
        >>> gps = ([[1.0, 0.0]], [[0.04]])
        >>> filter = IntermittentKalmanFilter(Phi, Gamma, 1e-4 * np.eye(2), {"gps": gps}, 0.1, np.eye(2))
        >>> [filter.get_input_port(i).get_name() for i in range(2)]
        ['u', 'gps']
    """
    Gamma = _matrix("Gamma", Gamma)
    n, m = Gamma.shape
    Phi, W = _matrix("Phi", Phi, (n, n)), _covariance("W", W, n)
    if not h > 0.0:
        raise ValueError(f"h: is {h}, must be positive")
    if not sensors:
        raise ValueError("sensors: is empty, must name at least one sensor")
    its = {}
    for name, pair in sensors.items():
        if not isinstance(pair, tuple | list) or len(pair) != 2:
            raise ValueError(f"sensors[{name!r}]: must be C and V, a pair of matrices")
        given_C, given_V = pair
        C = _matrix(f"sensors[{name!r}]: C", given_C, (*np.shape(given_C)[:1], n))
        its[name] = C, _covariance(f"sensors[{name!r}]: V", given_V, len(C), definite=True)
        if name in ("u", "estimate", "covariance", NAME, "messages"):
            raise ValueError(f"sensors: {name!r} is the name of another port")
    x = np.zeros(n) if x_0 is None else np.asarray(x_0, dtype=float)
    if x.shape != (n,):
        raise ValueError(f"x_0: has the shape {x.shape}, must have {(n,)}")
    messages = [outside(name, 1 + len(C)) for name, (C, _) in its.items()]
    box = linear_filter_box(NAME, linear_model(Phi, Gamma, W, its.values()), x, _covariance("P_0", P_0, n))
    return system_of(Wiring([outside("u", m), *messages, bundle("messages", messages), box]), h)


def _matrix(name: str, values: ArrayLike, shape: tuple[int, ...] | None = None) -> np.ndarray:
    found = np.asarray(values, dtype=float)
    if found.ndim != 2 or not np.all(np.isfinite(found)):
        raise ValueError(f"{name}: must be a matrix of finite numbers")
    if shape not in (None, found.shape):
        raise ValueError(f"{name}: has the shape {found.shape}, must have {shape}")
    return found


def _covariance(name: str, values: ArrayLike, n: int, definite: bool = False) -> np.ndarray:
    found = _matrix(name, values, (n, n))
    if not np.allclose(found, found.T, rtol=0.0, atol=1e-9 * np.abs(found).max()):
        raise ValueError(f"{name}: is not symmetric")
    least, most = np.linalg.eigvalsh(found)[[0, -1]]
    if least < -1e-12 * abs(most) or (definite and least <= 0.0):
        raise ValueError(
            f"{name}: has the eigenvalue {least:.3g}, must be positive {'' if definite else 'semi'}definite"
        )
    return found
