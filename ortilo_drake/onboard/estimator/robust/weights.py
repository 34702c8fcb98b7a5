"""Outlier gate, weight, noise scale and re-acquisition of measurements, from their distance to the filter's prediction.

For a sensor's value y_j, with e = y_j - C_j xhat and S = C_j P C_j^T + lambda V_j over all states of the filter but the
integral, biases included,

    d^2 = e^T S^-1 e                                 chi-square with m degrees of freedom if the model is right
    refused                                          if d^2 exceeds a quantile of it
    V_j <- lambda w V_j                              w = max(1, d / c)                        (Huber)
                                                     w = max(1, (nu + d^2) / (nu + m))        (Student's t)

P. Huber, "Robust Statistics", 1981; M. Roth, E. Ozkan and F. Gustafsson, "A Student's t filter for heavy tailed process
and measurement noise", ICASSP 2013. lambda follows the innovations: a is the average of d^2 / m, with lambda = 1, over
the values that were used; lambda = a / a_0, limited to [1, lambda_max]. a_0 is the tolerated a; a is 1 for the right V.

A diverged estimate would refuse correct values for ever. So when a sensor was refused for some time, the filter trusts
the sensor: it adds variance to P ("opens" P). It does not do so if other sensors that were used in this time depend,
together, on all vehicle states on which the refused sensor depends: these sensors confirm the estimate.

The filter trusts a gyroscope more than the noisy angles, so a step of the gyroscope's bias passes the gate. If the
model is right, the angles' innovations are white, and their average with weights alpha (1 - alpha)^i has the covariance
alpha / (2 - alpha) S. If its squared distance exceeds the quantile, P of the angles and of the gyroscope's bias opens.
"""

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.loop.element import Box, Element, Values, parts_of
from ortilo_drake.loop.plain import generic_twin_of
from ortilo_drake.model.cholesky import squared_norm_in_place
from ortilo_drake.model.elementary import exp
from ortilo_drake.model.measurement import Measurement
from ortilo_drake.model.placing import put
from ortilo_drake.model.products import product, times
from ortilo_drake.model.scalars import values_of
from ortilo_drake.model.signals import N_I, N_X
from ortilo_drake.onboard.estimator.extra_states import C as GYROSCOPE
from ortilo_drake.onboard.gate import squared_gate
from ortilo_drake.scenario.estimator import HuberWeight, Opening, Robust

SINCE, AVERAGE, LAST = range(3)  # columns of `state`: refused since [s] or NEVER; a; time of the last change of a [s]
NEVER = -1.0
ROUNDING = 1e-9  # tolerance of times [s]
SHUT, OPEN_RATES, OPEN_ALL = range(3)  # part of P that opens: none, the angles and the gyroscope's bias, all


class Weighing(NamedTuple):
    """The settings of gate and weight, in arrays for compiled functions."""

    C: np.ndarray
    """measurement matrix over all states of the filter but the integral (p, N)."""
    first: np.ndarray
    """first row of each sensor, and p at the end (s + 1)."""
    block: np.ndarray
    """index in V2 at which each sensor's covariance begins, and q at the end (s + 1)."""
    gates: np.ndarray
    """largest d^2 of each sensor (s)."""
    sees: np.ndarray
    """whether each sensor depends on each state of the vehicle (s, 12)."""
    huber: float
    """constant c of Huber's weight; inf for Student's t."""
    dof: float
    """degrees of freedom nu of Student's t; inf for Huber's weight."""
    time: float
    """time constant of the average a [s]; inf keeps lambda at 1."""
    tolerates: float
    """tolerated average a_0."""
    most: float
    """largest noise scale lambda_max."""
    reacquire_after: float
    """time for which a sensor is refused before P opens [s]."""
    watched: int
    """index of the sensor whose mean innovation shows a step of the gyroscope's bias, -1 for none."""
    drift: float
    """time constant of this mean [s]."""


def weighing_of(settings: Robust, measurement: Measurement, sensors: int) -> Weighing:
    """Return the settings for the first `sensors` sensors of a measurement with rows over [x; e]."""
    layout, weight, adaptation = measurement.layout, settings.weight, settings.adaptation
    first, block = layout.first[: sensors + 1], layout.block[: sensors + 1]
    C = np.ascontiguousarray(layout.C[: first[-1]])
    sees = np.array([np.any(C[a:b, :N_X] != 0.0, axis=0) for a, b in pairwise(first)])
    is_huber = isinstance(weight, HuberWeight)
    return Weighing(
        C,
        first,
        block,
        np.array([squared_gate(settings.gate, int(m)) for m in np.diff(first)]),
        sees,
        weight.c if isinstance(weight, HuberWeight) else np.inf,
        np.inf if is_huber else getattr(weight, "dof", np.inf),
        np.inf if adaptation is None else adaptation.time,
        1.0 if adaptation is None else adaptation.tolerates,
        1.0 if adaptation is None else adaptation.most,
        settings.reacquire_after,
        measurement.inertial if "gyroscope" in measurement.sensors and settings.drift is not None else -1,
        np.inf if settings.drift is None else settings.drift,
    )


def initial_gate_state(sensors: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the arrays state (s, 3), seen (12) and mean (3) of judge_sensors before the first arrival."""
    return np.tile([NEVER, 1.0, 0.0], (sensors, 1)), np.full(N_X, NEVER), np.zeros(3)


@cached_njit
def squared_distances(e: np.ndarray, CPCt: np.ndarray, V: np.ndarray, scale: float) -> tuple[float, float]:
    """Return d^2 with V and d^2 with scale * V; inf or NaN, which no gate passes, if d^2 does not exist."""
    if not (
        np.all(np.isfinite(CPCt)) and np.all(np.isfinite(V)) and np.all(np.isfinite(e))
    ):  # an infinite S would give d^2 = 0
        return np.inf, np.inf
    plain = squared_norm_in_place(CPCt + V, e.copy())
    if scale == 1.0:
        return plain, plain
    return plain, squared_norm_in_place(CPCt + scale * V, e.copy())


@cached_njit
def judge_sensors(
    y: np.ndarray,
    delta: np.ndarray,
    V2: np.ndarray,
    beliefs: np.ndarray,
    state: np.ndarray,
    seen: np.ndarray,
    mean: np.ndarray,
    t: float,
    weighing: Weighing,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, int]:
    """Return the factors on the covariances (s), 0 for refused values, the next state, seen and mean, and what opens.

    y (p), arrivals delta (s) and covariances V2, each row by row (q), are the measurements at time t [s]. `beliefs`
    holds the belief [xhat, P row by row] for each sensor (s, n + n^2). `state` (s, 3) has the columns SINCE, AVERAGE,
    LAST; `seen` is the time at which each vehicle state was last measured [s] (12); `mean` is the mean innovation of
    the watched sensor (3). The last value returned is SHUT, OPEN_RATES or OPEN_ALL.
    """
    C, first, block, gates, sees, huber, dof, time, tolerates, most, reacquire_after, watched, drift = weighing
    s, N, n = delta.size, C.shape[1], C.shape[1] + 3
    factors, state, seen, mean, opens = np.zeros(s), state.copy(), seen.copy(), mean.copy(), SHUT
    for j in range(s):
        if delta[j] == 0.0:
            continue
        rows, m = C[first[j] : first[j + 1]], first[j + 1] - first[j]
        P = beliefs[j, n:].copy().reshape(n, n)[:N, :N].copy()
        V = V2[block[j] : block[j + 1]].copy().reshape(m, m)
        scale = min(max(1.0, state[j, AVERAGE] / tolerates), most)
        e = y[first[j] : first[j + 1]] - times(rows, beliefs[j, :N])
        CPCt = product(product(rows, P), rows.T)
        plain, squared = squared_distances(e, CPCt, V, scale)
        if squared <= gates[j]:
            w = np.sqrt(squared) / huber if huber < np.inf else (dof + squared) / (dof + m)
            factors[j] = scale * max(1.0, w)
            since = t - state[j, LAST]
            share = 1.0 - exp(-since / time)
            state[j, SINCE] = NEVER
            state[j, AVERAGE] += share * (plain / m - state[j, AVERAGE])
            state[j, LAST] = t
            for i in range(N_X):
                if sees[j, i]:
                    seen[i] = t
            if j == watched and since > 0.0:
                alpha = 1.0 - exp(-since / drift)
                mean += alpha * (e - mean)
                if squared_norm_in_place(CPCt + scale * V, mean.copy()) * (2.0 - alpha) / alpha > gates[j]:
                    mean, opens = np.zeros(3), OPEN_RATES
    for j in range(s):
        if delta[j] == 0.0 or factors[j] > 0.0:
            continue
        others = t  # time since which used sensors have measured all states on which sensor j depends
        for i in range(N_X):
            if sees[j, i]:
                others = min(others, seen[i])
        if state[j, SINCE] == NEVER or others >= state[j, SINCE]:
            state[j, SINCE] = t
        elif t - state[j, SINCE] >= reacquire_after - ROUNDING:
            state[j, SINCE], opens = t, OPEN_ALL
    return factors, state, seen, mean, opens


@generic_twin_of(judge_sensors)
def judge_values(*judged: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, int]:
    """Do judge_sensors with AutoDiffXd arguments: the decisions and factors are constants, without derivatives."""
    values = [values_of(one) if isinstance(one, np.ndarray) else one for one in judged]
    found: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, int] = judge_sensors(*values)
    return found


@cached_njit
def weighed(
    y: np.ndarray, delta: np.ndarray, V2: np.ndarray, factors: np.ndarray, first: np.ndarray, block: np.ndarray
) -> np.ndarray:
    """Return [y, delta, V2] of the used values, with each covariance times its factor (p + s + q).

    A refused value has rows of 0 and delta 0, as one that did not arrive; its covariance stays unchanged.
    """
    p, s, q = y.size, delta.size, V2.size
    out = np.zeros(p + s + q, y.dtype)
    out[p + s :] = V2
    for j in range(s):
        if factors[j] > 0.0:
            out[first[j] : first[j + 1]] = y[first[j] : first[j + 1]]
            out[p + j] = delta[j]
            out[p + s + block[j] : p + s + block[j + 1]] = factors[j] * V2[block[j] : block[j + 1]]
    return out


def opening_variances(opening: Opening, extra: tuple[str, ...]) -> np.ndarray:
    """Return the variances added to P's diagonal for SHUT, OPEN_RATES, OPEN_ALL (3, n); `extra` has the names of e."""
    none = np.zeros(3)
    angle, gyroscope = np.full(3, opening.angle), [opening.gyroscope if name in GYROSCOPE else 0.0 for name in extra]
    others = np.repeat([opening.velocity, opening.rate], 3)
    rates = np.concatenate((none, angle, none, none, gyroscope, np.zeros(N_I)))
    whole = np.concatenate((np.full(3, opening.position), angle, others, gyroscope, np.zeros(N_I)))
    return np.square(np.array([np.zeros(whole.size), rates, whole]))


def gate_out(
    n: Any,
    k: int,
    y: np.ndarray,
    delta: np.ndarray,
    V2: np.ndarray,
    belief: np.ndarray,
    past: np.ndarray,
    late: np.ndarray,
    weighing: Weighing,
    opening: np.ndarray,
    refusals: np.ndarray,
    seen: np.ndarray,
    mean: np.ndarray,
    beliefs: np.ndarray,
    out: np.ndarray,
) -> None:
    """Output [y, delta, V2] of the used values, the variances added to P, and the next state, seen and mean."""
    for j in range(delta.size):
        if delta[j] != 0.0:
            put(belief if late[j] < 0 else past[late[j] * belief.size :][: belief.size], beliefs[j])
    factors, next_refusals, next_seen, next_mean, opens = judge_sensors(
        y, delta, V2, beliefs, refusals, seen, mean, k * n.h, weighing
    )
    used = weighed(y, delta, V2, factors, weighing.first, weighing.block)
    put(used, out)
    at = used.size
    for said in (opening[opens], next_refusals.reshape(next_refusals.size), next_seen, next_mean):
        put(said, out, at)
        at += said.size


def gate_step(refusals: np.ndarray, seen: np.ndarray, mean: np.ndarray, out: np.ndarray) -> None:
    """Copy the next state, seen and mean from the output to the gate's states."""
    at = out.size - mean.size - seen.size - refusals.size
    for kept in (refusals.reshape(refusals.size), seen, mean):
        put(out[at : at + kept.size], kept)
        at += kept.size


GATE = Element("robust_gate", out=gate_out, step=gate_step, allocates=True)


def gate_box(weighing: Weighing, opening: np.ndarray, late: list[int], h: float) -> Box:
    """Return the gate's box; it reads y, delta, V2, the filter's whole `belief` and the beliefs of `past` ticks.

    `opening` comes from opening_variances (3, n); `late` holds, for each sensor, the index of the past belief that
    judges it, -1 for the present belief.
    """
    n, s, p, q = opening.shape[1], len(late), int(weighing.first[-1]), int(weighing.block[-1])
    refusals, seen, mean = initial_gate_state(s)
    parts = parts_of({"y": p, "delta": s, "V2": q, "opening": n})
    given = Values({"h": h}, {"refusals": refusals, "seen": seen, "mean": mean}, {"opening": opening, "late": late})
    size = p + s + q + n + refusals.size + seen.size + mean.size
    box = Box("robust_gate", GATE, size, given, {"beliefs": (s, n + n * n)}, parts=parts)
    return box.with_groups(weighing=weighing)
