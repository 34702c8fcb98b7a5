"""The intermittent measurements handler (paper, section IV-B).

It stacks what arrived in this tick into y_k, says by delta_k which of it is there, and gives each sensor's
noise covariance (model/measurement.py). The filter forms H_k = Delta_k Cbar and E_k from the arrivals.

What becomes of a measurement that comes late is the scenario's to say (estimator.delay). With 'ignore' it enters as if
it were current and its stamp is not used; with 'drop' it must not be older than MAX_AGE ticks, and then enters as if it
were current; with 'replay' the stamps go to the filter, see late_measurements.py, and what is older than the ticks that
it keeps does not count as arrived.
"""

import sys
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numba.extending import register_jitable
from pydrake.autodiffutils import AutoDiffXd
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem_
from pydrake.systems.primitives import ConstantVectorSource, Demultiplexer, Multiplexer
from pydrake.systems.scalar_conversion import TemplateSystem

from ortilo_drake.loop.element import Array, Box, Element, Given, Number
from ortilo_drake.model.cholesky import forward_in_place
from ortilo_drake.model.clock import history_ticks, tick_of
from ortilo_drake.model.measurement import Layout, Measurement
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.scalars import time_in, values_of
from ortilo_drake.model.signals import N_XBAR
from ortilo_drake.onboard.gate import squared_gate

MAX_AGE = 1  # of a measurement that 'drop' still uses [ticks]: a detector takes one, so none would leave no camera
NEVER = -1  # the tick for a handler that drops nothing


class Incoming(NamedTuple):
    """How the sensors' messages stand in one vector.

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


@njit(cache=True)
def squared_distance(e: np.ndarray, C: np.ndarray, P: np.ndarray, V: np.ndarray) -> float:
    """Return the squared Mahalanobis distance e^T (C P_xx C^T + V)^-1 e of a value from its prediction.

    It is infinite where the prediction is no longer finite or S is not positive definite.

    Args:
        e: value less prediction (m).
        C: the sensor's rows (m, 12).
        P: the prediction's covariance, row by row (225).
        V: the value's covariance (m, m).
    """
    m = e.size
    S = np.empty((m, m))
    for i in range(m):
        for j in range(m):
            total = 0.0
            for k in range(12):
                if C[i, k] != 0.0:
                    for n in range(12):
                        if C[j, n] != 0.0:
                            total += C[i, k] * P[15 * k + n] * C[j, n]
            S[i, j] = total + V[i, j]
            if not np.isfinite(S[i, j]):
                return np.inf
    root, squared = e.copy().reshape((m, 1)), 0.0
    forward_in_place(S, root, m)
    for i in range(m):
        squared += root[i, 0] ** 2
    return squared if np.isfinite(squared) else np.inf


@register_jitable
def put_measurements(
    out: np.ndarray,
    messages: np.ndarray,
    xhat: np.ndarray,
    P: np.ndarray,
    k: int,
    h: float,
    incoming: Incoming,
    layout: Layout,
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
            e = values_of(message[2 : 2 + m]).copy()
            for i in range(m):
                for n in range(12):
                    if C[first[j] + i, n] != 0.0:
                        e[i] -= C[first[j] + i, n] * xhat[n]
            if squared_distance(e, C[first[j] : first[j + 1]], P, values_of(V).reshape(m, m)) > gates[j]:
                continue
        if k != NEVER and k - tick_of(values_of(message[1:2])[0], h) > oldest:
            continue
        put(message[2 : 2 + m], out, first[j])
        delta[j] = 1.0


@njit(cache=True)
def stack_measurements(
    messages: np.ndarray, xhat: np.ndarray, P: np.ndarray, k: int, h: float, incoming: Incoming, layout: Layout
) -> np.ndarray:
    """Return [y, delta, V2, stamps] of tick k (p + 2 s + q); arguments as put_measurements'."""
    _, _, _, first, block, _ = layout
    out = np.zeros(first[-1] + block[-1] + 2 * (first.size - 1), messages.dtype)
    put_measurements(out, messages, xhat, P, k, h, incoming, layout)
    return out


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
    """Return how messages stand in one vector.

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
    start: np.ndarray,
    V2: np.ndarray,
    with_message: np.ndarray,
    gates: np.ndarray,
    C: np.ndarray,
    states: np.ndarray,
    weights: np.ndarray,
    first: np.ndarray,
    block: np.ndarray,
    is_position: np.ndarray,
    out: np.ndarray,
) -> None:
    """Say [y, delta, V2, stamps] of what landed in tick k, see put_measurements."""
    fill(out, 0.0)
    layout, incoming = (
        Layout(C, states, weights, first, block, is_position),
        Incoming(start, V2, with_message, gates, n.oldest),
    )
    judged = k if n.drops else NEVER
    put_measurements(out, messages, belief[:N_XBAR], belief[N_XBAR:], judged, n.h, incoming, layout)


LAYOUT = (
    Array("C", 2),
    Array("states", 2, "i8"),
    Array("weights", 2),
    Array("first", kind="i8"),
    Array("block", kind="i8"),
    Array("is_position", kind="b1"),
)
HANDLER = Element(
    "handler",
    allocates=True,
    out=handler_out,
    numbers=(Number("oldest", kind="i8"), Number("drops", kind="i8"), Number("h")),
    tables=(
        Array("start", kind="i8"),
        Array("V2"),
        Array("with_message", kind="b1"),
        Array("gates"),
        *LAYOUT,
    ),
)


def handler_box(incoming: Incoming, layout: Layout, drops: bool, h: float) -> Box:
    """Return the handler: it reads all that landed, `messages`, and the belief of this tick (240)."""
    s, p, q = len(incoming.start), int(layout.first[-1]), int(layout.block[-1])
    tables = incoming._asdict()
    numbers = {"oldest": tables.pop("oldest"), "drops": drops, "h": h}
    parts = {"y": (0, p), "delta": (p, s), "V2": (p + s, q), "stamps": (p + s + q, s)}
    return Box("handler", HANDLER, p + 2 * s + q, Given(numbers, tables=tables | layout._asdict()), parts=parts)


# Without a scope Drake reads the sources of all frames to find it.
@TemplateSystem.define("MeasurementStack_", T_list=[float, AutoDiffXd], scope=sys.modules[__name__])
def MeasurementStack_(T: type) -> type:
    """Return the stack for a scalar type: float or AutoDiffXd, for which arrivals and gates are constants."""

    class Impl(LeafSystem_[T]):
        """Turns the messages of a tick, in one vector, into the measurement.

        Ports:
            messages: the messages of the sensors that fly, one after the other.
            estimate (15), covariance (225): of the prediction; only if there is a gate.
            measurement (p + 2 s + q, output): y, delta, V2 and stamps.

        Memoryless, but for the time that 'drop' reads.

        Args:
            size: of all messages.
            incoming: how they stand in the vector.
            layout: of the measurement.
            h: tick [s].
            drops: whether late values are dropped.
        """

        def _construct(
            self, size: int, incoming: Incoming, layout: Layout, h: float, drops: bool, converter: Any = None
        ) -> None:
            LeafSystem_[T].__init__(self, converter=converter)
            self.set_name("measurement_stack")
            self._arguments = {"size": size, "incoming": incoming, "layout": layout, "h": h, "drops": drops}
            self._stack = stack_measurements if T is float else stack_measurements.py_func
            self._incoming, self._layout, self._h = tuple(incoming), tuple(layout), h  # plain, see filter_loops.py
            self._messages = self.DeclareVectorInputPort("messages", size)
            needs = {self._messages.ticket()}
            sizes = N_XBAR, N_XBAR * N_XBAR
            self._nothing = np.zeros(sizes[0]), np.zeros(sizes[1])
            self._predictions = []
            if not np.all(np.isinf(incoming.gates)):
                named = zip(("estimate", "covariance"), sizes, strict=True)
                self._predictions = [self.DeclareVectorInputPort(name, n) for name, n in named]
                needs |= {port.ticket() for port in self._predictions}
            if drops:
                needs.add(self.time_ticket())
            self._drops = drops
            length = int(layout.first[-1] + layout.block[-1]) + 2 * incoming.start.size
            self.DeclareVectorOutputPort("measurement", length, self._calc, prerequisites_of_calc=needs)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            Impl._construct(self, **other._arguments, converter=converter)

        def _calc(self, context: Any, output: Any) -> None:
            xhat, P = [values_of(port.Eval(context)) for port in self._predictions] or self._nothing
            k = tick_of(time_in(context), self._h) if self._drops else NEVER
            messages = self._messages.Eval(context)
            output.set_value(self._stack(messages, xhat, P, k, self._h, self._incoming, self._layout))

    return Impl


class MeasurementHandler(Diagram):
    """Turns the sensors' messages and fixes into y_k, the arrivals and V2.

    Ports:
        <sensor>: the message or fix of each sensor that flies: arrived, stamp, value (m) and, where no V is given for
            it, the value's covariance row by row (m^2); whatever follows is not read.
        estimate (15), covariance (225): of the prediction; only if there is a gate.
        y (p, output), delta (s, output), V2 (q, output): the measurement, see model/measurement.py.
        stamps (s, output): when each sensor's value was true [s], 0 where none arrived.

    A sensor that does not fly never arrives. A gate judges a late fix by the present prediction.

    Args:
        measurement: the layout of y, delta and V2.
        sizes: of the message or fix of each sensor that flies.
        V: covariance that is believed of each sensor (m, m); None where it comes with the message.
        gates: probability with which a right value stays within its gate, for the sensors that have one.
        h: tick [s], by which 'drop' judges.
        delay: 'ignore', 'drop' or 'replay': what becomes of a late measurement.
        horizon: how far back 'replay' goes [s].
    """

    def __init__(
        self,
        measurement: Measurement,
        sizes: dict[str, int],
        V: dict[str, np.ndarray | None],
        gates: dict[str, float],
        h: float,
        delay: str = "ignore",
        horizon: float = 0.0,
    ):
        super().__init__()
        builder = DiagramBuilder()
        incoming = incoming_of(measurement, sizes, V, gates, oldest_used(delay, horizon, h))
        size = max(sum(sizes.values()), 1)
        stack = builder.AddSystem(MeasurementStack_[float](size, incoming, measurement.layout, h, delay != "ignore"))
        if sizes:
            together = builder.AddSystem(Multiplexer(list(sizes.values())))
            for i, sensor in enumerate(sizes):
                builder.ExportInput(together.get_input_port(i), sensor)
        else:
            together = builder.AddSystem(ConstantVectorSource([0.0]))
        builder.Connect(together.get_output_port(), stack.GetInputPort("messages"))
        for name in ("estimate", "covariance"):
            if stack.HasInputPort(name):
                builder.ExportInput(stack.GetInputPort(name), name)
        parts = builder.AddSystem(Demultiplexer([*measurement.sizes.values(), measurement.sizes["delta"]]))
        builder.Connect(stack.get_output_port(), parts.get_input_port())
        for i, name in enumerate((*measurement.sizes, "stamps")):
            builder.ExportOutput(parts.get_output_port(i), name)
        builder.BuildInto(self)
        self.set_name("measurement_handler")
