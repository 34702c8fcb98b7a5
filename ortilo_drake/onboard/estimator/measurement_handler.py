"""The intermittent measurements handler (paper, section IV-B).

The handler stacks the measurements that arrived in this tick into y_k, sets their arrivals delta_k, and gives each
sensor's noise covariance (model/measurement.py). The filter forms H_k = Delta_k Cbar and E_k from the arrivals.

The scenario's estimator.delay decides how late measurements are used. With 'ignore' they enter as if they were current,
and their stamps are not used. With 'drop' the handler drops those older than MAX_AGE ticks; the others enter as if they
were current. With 'replay' the filter gets the stamps, see late_measurements.py, and a measurement older than the ticks
that the filter keeps does not count as arrived.
"""

from typing import Any, NamedTuple

import numpy as np

from ortilo_drake.loop.element import Box, Element, Values, parts_of
from ortilo_drake.model.clock import history_ticks, tick_of
from ortilo_drake.model.measurement import Layout, Measurement
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.scalars import values_of
from ortilo_drake.model.signals import N_X, N_XBAR
from ortilo_drake.onboard.estimator.kalman import innovation, squared_distance
from ortilo_drake.onboard.gate import squared_gate

MAX_AGE = 1  # largest age that 'drop' still uses [ticks]: a detector takes one tick, so 0 would drop all camera fixes


class Incoming(NamedTuple):
    """The layout of the sensors' messages in one vector."""

    start: np.ndarray
    """index at which each sensor's message begins, -1 for a sensor that does not fly (s)."""
    V2: np.ndarray
    """covariances used for the sensors whose messages hold none (q)."""
    with_message: np.ndarray
    """whether a sensor's message holds its covariance, after the value (s)."""
    gates: np.ndarray
    """outlier gate of each sensor: largest squared Mahalanobis distance from the prediction, inf for no gate (s)."""
    oldest: int
    """largest age of a value that is used [ticks]."""


def oldest_used(delay: str, horizon: float, h: float) -> int:
    """Return the largest age of a measurement that is used [ticks], given estimator.delay and its horizon [s]."""
    return history_ticks(horizon, h) - 1 if delay == "replay" else MAX_AGE


def incoming_of(
    measurement: Measurement,
    sizes: dict[str, int],
    V: dict[str, np.ndarray | None],
    gates: dict[str, float],
    oldest: int = MAX_AGE,
) -> Incoming:
    """Return the layout of the messages in one vector: the sensors that fly, in the order of `sizes` [numbers].

    V is the noise covariance of each sensor, None if the sensor's message holds it. `gates` gives, for each sensor with
    an outlier gate, the probability that a correct value passes; `oldest` is the largest age of a value that is used
    [ticks].
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
    S: np.ndarray,
    GT: np.ndarray,
    out: np.ndarray,
) -> None:
    """Output [y, delta, V2, stamps] of tick k (p + 2 s + q), given the sensors' messages, one after the other.

    delta_j is 1 if sensor j's value arrived, passed the gate and is not too late; otherwise its rows of y are 0. The
    stamp is 0 if no message arrived. The gates use the belief [xhat, P row by row] (240). n.drops says whether late
    values are dropped. S (p, p) and GT (p, 13) are work memory.
    """
    _, states, weights, first, block, _ = layout
    start, V2, with_message, gates, oldest = incoming
    s, p, q = start.size, first[-1], block[-1]
    delta, stamps = out[p : p + s], out[p + s + q :]
    fill(out, 0.0)
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
        if n.drops and k - tick_of(values_of(message[1:2])[0], n.h) > oldest:
            continue
        put(message[2 : 2 + m], out, first[j])
        if not np.isinf(gates[j]):
            x, P = values_of(belief[:N_XBAR]), values_of(belief[N_XBAR:]).reshape((N_XBAR, N_XBAR))
            innovation(x, P, values_of(out[:p]), values_of(V), m, first[j], states, weights, S, GT)
            if squared_distance(S, GT, m) > gates[j]:
                fill(out[first[j] : first[j + 1]], 0.0)
                continue
        delta[j] = 1.0


HANDLER = Element("handler", out=handler_out)


def handler_box(incoming: Incoming, layout: Layout, drops: bool, h: float) -> Box:
    """Return the handler's box; it reads all arrived `messages` and the belief of this tick (240)."""
    s, p, q = len(incoming.start), int(layout.first[-1]), int(layout.block[-1])
    given = Values({"drops": drops, "h": h})
    parts = parts_of({"y": p, "delta": s, "V2": q, "stamps": s})
    box = Box("handler", HANDLER, p + 2 * s + q, given, {"S": (p, p), "GT": (p, N_X + 1)}, parts=parts)
    return box.with_groups(incoming=incoming, layout=layout)
