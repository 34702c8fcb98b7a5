"""The samples of a sensor faster than the tick, collected into one message per tick."""

from functools import partial

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from ortilo_drake.model.signals import ARRIVED, PAYLOAD, STAMP, samples_in, size_of_samples


class Kept(LeafSystem):
    """Keeps a signal's values (m) at instants (n) inside a tick of h [s], shares of the tick.

    The kept values are a discrete state (n m), oldest first. Each instant has an event of period h at its own offset:
    so no event meant for a tick falls between two ticks, as with a period of h / n, which splits coincident events by
    an ulp. All that is sampled at one instant is sampled in one event.
    """

    def __init__(self, name: str, port: str, size: int, instants: np.ndarray, h: float):
        super().__init__()
        self.set_name(name)
        self._size = size
        self._signal = self.DeclareVectorInputPort(port, size)
        self._kept = self.DeclareDiscreteState(len(instants) * size)
        for i, instant in enumerate(instants):
            self.DeclarePeriodicDiscreteUpdateEvent(h, h * instant, partial(self._keep, i))

    def _keep(self, i: int, context: Context, values: DiscreteValues) -> None:
        values.get_mutable_value(self._kept)[i * self._size : (i + 1) * self._size] = self._signal.Eval(context)


class SampleCollector(Kept):
    """Samples a memoryless sensor n times a tick, at t_k - h + h / n, ..., t_k, and sends the n samples at t_k.

    The last sample is the sensor's output at t_k itself, the others are kept. `name` is the message's, `size` is 2 + p,
    n is 2 or more, h the tick [s].

    Ports:
        sample (2 + p): the sensor's message [arrived, stamp, payload] at any instant. <name> (2 + n (2 + p), output):
            see model/signals.py; at t_0 only the last sample is there.
    """

    def __init__(self, name: str, size: int, n: int, h: float):
        super().__init__(f"{name}_samples", "sample", size, np.arange(1, n) / n, h)
        self._n = n
        needs = {self._signal.ticket(), self.xd_ticket()}
        self.DeclareVectorOutputPort(name, size_of_samples(size, n), self._calc, prerequisites_of_calc=needs)

    def _calc(self, context: Context, output: BasicVector) -> None:
        message = np.zeros(output.size())
        message[PAYLOAD:] = np.concatenate((context.get_discrete_state(self._kept).value(), self._signal.Eval(context)))
        there = samples_in(message, self._n)
        there = there[there[:, ARRIVED] > 0.0]
        if len(there):
            message[ARRIVED], message[STAMP] = 1.0, there[-1, STAMP]
        output.SetFromVector(message)


class Passed(Kept):
    """Outputs what it keeps of `signal` (m) at `passed` (n m, output); arguments as for Kept."""

    def __init__(self, size: int, instants: np.ndarray, h: float):
        super().__init__("passed", "signal", size, instants, h)
        self.DeclareStateOutputPort("passed", self._kept)
