"""The intermittent measurements handler (paper, section IV-B).

It stacks what arrived in this tick into y_k, says by delta_k which of it is there, and gives each sensor's
noise covariance (model/measurement.py). The filter forms H_k = Delta_k Cbar and E_k from the arrivals.

What becomes of a measurement that comes late is the scenario's to say (estimator.delay). With 'ignore' it enters as if
it were current and its stamp is not used; with 'drop' it must not be older than MAX_AGE ticks, and then enters as if it
were current; with 'replay' the stamps go to the filter, see late_measurements.py, and what is older than the ticks that
it keeps does not count as arrived.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numba.extending import register_jitable

from ortilo_drake.loop.element import Array, Box, Element, Number, Values
from ortilo_drake.model.cholesky import squared_norm_in_place
from ortilo_drake.model.clock import history_ticks, tick_of
from ortilo_drake.model.measurement import Layout, Measurement
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.scalars import values_of
from ortilo_drake.model.signals import N_XBAR
from ortilo_drake.onboard.gate import squared_gate

MAX_AGE = 1  # of a measurement that 'drop' still uses [ticks]: a detector takes one, so none would leave no camera
NEVER = -1  # the tick for a handler that drops nothing


class Incoming(NamedTuple):
    """The layout of the sensors' messages in one vector.

    Attributes:
        start: where each sensor's message begins, -1 for one that does not fly (s).
        V2: the covariances that are believed where none comes with the message (q).
        with_message: whether a sensor's covariance comes with its message, behind the value (s).
        gates: largest squared Mahalanobis distance of each sensor from the prediction, inf for none (s).
        oldest: largest age of a value that is used [ticks].
    """

    start: np.ndarray
    V2: np.ndarray
    with_message: np.ndarray
    gates: np.ndarray
    oldest: int


@njit(cache=True, _nrt=False)
def squared_distance(e: np.ndarray, C: np.ndarray, P: np.ndarray, V: np.ndarray, S: np.ndarray) -> float:
    """Return the squared Mahalanobis distance e^T (C P_xx C^T + V)^-1 e of a value from its prediction.

    It is infinite where the prediction is no longer finite or S is not positive definite.

    Args:
        e: value less prediction (m); overwritten.
        C: the sensor's rows (m, 12).
        P: the prediction's covariance, row by row (225).
        V: the value's covariance, row by row (m^2).
        S: to work in (m or more, m or more).
    """
    m = e.size
    for i in range(m):
        for j in range(m):
            total = 0.0
            for k in range(12):
                if C[i, k] != 0.0:
                    for n in range(12):
                        if C[j, n] != 0.0:
                            total += C[i, k] * P[15 * k + n] * C[j, n]
            S[i, j] = total + V[m * i + j]
            if not np.isfinite(S[i, j]):
                return np.inf
    squared = squared_norm_in_place(S, e)
    return squared if np.isfinite(squared) else np.inf


@register_jitable(_nrt=False)
def put_measurements(
    out: np.ndarray,
    messages: np.ndarray,
    xhat: np.ndarray,
    P: np.ndarray,
    k: int,
    h: float,
    incoming: Incoming,
    layout: Layout,
    e: np.ndarray,
    S: np.ndarray,
) -> None:
    """Write [y, delta, V2, stamps] of tick k.

    delta_j = 1 where sensor j's value is there, within its gate, and not too late. Rows that did not arrive hold 0,
    and so do their stamps.

    Args:
        out: zeros, to write to (p + 2 s + q).
        messages: the messages of the sensors that fly, one after the other.
        xhat: prediction (15), for the gates.
        P: its covariance, row by row (225).
        k: tick, by which late ones are dropped; NEVER if none is.
        h: tick [s].
        incoming: how the messages stand in that vector, and what is believed of them.
        layout: of the measurement.
        e: to work in (p).
        S: to work in (p, p).
    """
    C, _, _, first, block, _ = layout
    start, V2, with_message, gates, oldest = incoming
    s, p, q = start.size, first[-1], block[-1]
    delta, stamps = out[p : p + s], out[p + s + q :]
    put(V2, out, p + s)
    for j in range(s):
        if start[j] < 0:
            continue
        message = messages[start[j] :]
        if message[0] == 0.0:
            continue
        m = first[j + 1] - first[j]
        V = out[p + s + block[j] : p + s + block[j + 1]]
        if with_message[j]:
            put(message[2 + m : 2 + m + m * m], V)
        stamps[j] = message[1]
        if not np.isinf(gates[j]):
            values, x = values_of(message[2 : 2 + m]), values_of(xhat)
            for i in range(m):
                e[i] = values[i]
                for n in range(12):
                    if C[first[j] + i, n] != 0.0:
                        e[i] -= C[first[j] + i, n] * x[n]
            if squared_distance(e[:m], C[first[j] : first[j + 1]], values_of(P), values_of(V), S) > gates[j]:
                continue
        if k != NEVER and k - tick_of(values_of(message[1:2])[0], h) > oldest:
            continue
        put(message[2 : 2 + m], out, first[j])
        delta[j] = 1.0


def oldest_used(delay: str, horizon: float, h: float) -> int:
    """Return the largest age of a measurement that is used [ticks], as estimator.delay and its horizon [s] have it."""
    return history_ticks(horizon, h) - 1 if delay == "replay" else MAX_AGE


def incoming_of(
    measurement: Measurement,
    sizes: dict[str, int],
    V: dict[str, np.ndarray | None],
    gates: dict[str, float],
    oldest: int = MAX_AGE,
) -> Incoming:
    """Return the layout of messages in one vector.

    Args:
        measurement: the layout of what the filter gets.
        sizes: of the message of each sensor that flies, in their order in the vector.
        V: covariance that is believed of each sensor; None where it comes with the message.
        gates: probability with which a right value stays within its gate, for the sensors that have one.
        oldest: largest age of a value that is used [ticks], where any is dropped.
    """
    ends = np.cumsum([0, *sizes.values()])
    starts = dict(zip(sizes, ends[:-1].tolist(), strict=True))
    V2 = np.zeros(measurement.sizes["V2"])
    squared = np.full(len(measurement.sensors), np.inf)
    for j, sensor in enumerate(measurement.sensors):
        rows, believed = measurement.rows_of(sensor), V.get(sensor)
        m = rows.stop - rows.start
        V2[measurement.block_of(sensor)] = (np.eye(m) if believed is None else believed).ravel()
        if sensor in gates:
            squared[j] = squared_gate(gates[sensor], m)
    start = np.array([starts.get(sensor, -1) for sensor in measurement.sensors], dtype=np.int64)
    with_message = np.array([V.get(sensor) is None for sensor in measurement.sensors])
    return Incoming(start, V2, with_message, squared, oldest)


def handler_out(
    n: Any,
    k: int,
    messages: np.ndarray,
    belief: np.ndarray,
    incoming: Incoming,
    layout: Layout,
    e: np.ndarray,
    S: np.ndarray,
    out: np.ndarray,
) -> None:
    """Output [y, delta, V2, stamps] of what landed in tick k, see put_measurements."""
    fill(out, 0.0)
    judged = k if n.drops else NEVER
    put_measurements(out, messages, belief[:N_XBAR], belief[N_XBAR:], judged, n.h, incoming, layout, e, S)


HANDLER = Element(
    "handler", out=handler_out, numbers=(Number("drops", kind="i8"), Number("h")), work=(Array("e"), Array("S", 2))
)


def handler_box(incoming: Incoming, layout: Layout, drops: bool, h: float) -> Box:
    """Return the handler: it reads all that landed, `messages`, and the belief of this tick (240)."""
    s, p, q = len(incoming.start), int(layout.first[-1]), int(layout.block[-1])
    given = Values({"drops": drops, "h": h})
    parts = {"y": (0, p), "delta": (p, s), "V2": (p + s, q), "stamps": (p + s + q, s)}
    work = {"e": (p,), "S": (p, p)}
    box = Box("handler", HANDLER, p + 2 * s + q, given, work, parts=parts)
    return box.with_groups(incoming=incoming, layout=layout)
