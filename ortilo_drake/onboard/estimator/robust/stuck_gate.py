"""The gate of a sensor that is stuck: what its noise should have changed and did not is no measurement.

A frozen value is consistent with itself, and near what it was when it froze, so that no test against the prediction
refuses it in time. But no sensor with noise says the same twice.
"""

import sys
from typing import Any

import numpy as np
from numba import njit
from pydrake.autodiffutils import AutoDiffXd
from pydrake.systems.framework import LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from ortilo_drake.loop.element import Array, Box, Element, Given, Number
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.scalars import values_of
from ortilo_drake.model.signals import ARRIVED, PAYLOAD, STAMP, samples_in

SAME = 1e-12  # values that differ by less are the same: they may have gone through text


def said_by(message: np.ndarray, samples: int) -> np.ndarray:
    """Return what a message says beside when: its payload, of each sample where there are several."""
    if samples == 1:
        return message[PAYLOAD:]
    return np.delete(samples_in(message, samples), STAMP, axis=1).ravel()


@njit(cache=True)
def repeats(said: np.ndarray, last: np.ndarray) -> float:
    """Return how many messages in a row have said the same, this one included.

    Args:
        said: what this one says (n).
        last: how many said the same up to the last one, 0 before any came, and what that was (1 + n).
    """
    if last[0] == 0.0:
        return 1.0
    for i in range(said.size):
        if not abs(said[i] - last[1 + i]) <= SAME:  # NaN is never the same
            return 1.0
    return float(last[0] + 1.0)


def heard_out(n: Any, message: np.ndarray, last: np.ndarray, out: np.ndarray) -> None:
    """Say the message, or zeros where the sensor is stuck."""
    fill(out, 0.0)
    if message[ARRIVED] != 0.0 and repeats(message[PAYLOAD:], last) < n.stuck:
        put(message, out)


def heard_step(message: np.ndarray, last: np.ndarray) -> None:
    """Remember what a message said, and how many have in a row."""
    if message[ARRIVED] != 0.0:
        said = message[PAYLOAD:]
        last[0] = repeats(said, last)
        put(said, last, 1)


STUCK = Element("stuck_gate", out=heard_out, step=heard_step, numbers=(Number("stuck"),), state=(Array("last"),))


def stuck_box(name: str, size: int, stuck: int) -> Box:
    """Return the gate of a sensor whose messages have that size: it reads the message as it lands."""
    return Box(f"{name}_heard", STUCK, size, Given({"stuck": stuck}, {"last": np.zeros(1 + size - PAYLOAD)}))


# Without a scope Drake reads the sources of all frames to find it.
@TemplateSystem.define("StuckGate_", T_list=[float, AutoDiffXd], scope=sys.modules[__name__])
def StuckGate_(T: type) -> type:
    """Return the gate for a scalar type: float or AutoDiffXd, for which whether a sensor is stuck is a constant."""

    class Impl(LeafSystem_[T]):
        """Lets messages pass that say something new.

        Ports:
            message (m): as it arrives.
            heard (m, output): the same, or zeros where the sensor is stuck.

        State (discrete, updated every h): how many messages in a row said the same, and what (1 + n).

        Args:
            name: the sensor's.
            size: m.
            stuck: so many in a row say that it is stuck.
            h: tick [s].
            samples: in each message.
        """

        def _construct(
            self, name: str, size: int, stuck: int, h: float, samples: int = 1, converter: Any = None
        ) -> None:
            LeafSystem_[T].__init__(self, converter=converter)
            self.set_name(f"{name}_stuck_gate")
            self._arguments = {"name": name, "size": size, "stuck": stuck, "h": h, "samples": samples}
            self._stuck, self._samples = stuck, samples
            self._message = self.DeclareVectorInputPort("message", size)
            self._last = self.DeclareDiscreteState(1 + said_by(np.zeros(size), samples).size)
            self.DeclarePeriodicDiscreteUpdateEvent(h, 0.0, self._update)
            needs = {self._message.ticket(), self.discrete_state_ticket(self._last)}
            self.DeclareVectorOutputPort("heard", size, self._calc, prerequisites_of_calc=needs)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            Impl._construct(self, **other._arguments, converter=converter)

        def _said(self, context: Any) -> tuple[np.ndarray, float]:
            """Return what a message that is there says, and how many have in a row."""
            said = said_by(values_of(self._message.Eval(context)), self._samples)
            return said, repeats(said, values_of(context.get_discrete_state(self._last).CopyToVector()))

        def _calc(self, context: Any, output: Any) -> None:
            message = self._message.Eval(context)
            if message[ARRIVED] != 0.0 and self._said(context)[1] < self._stuck:
                output.SetFromVector(message)
            else:
                output.SetZero()

        def _update(self, context: Any, values: Any) -> None:
            if self._message.Eval(context)[ARRIVED] != 0.0:
                said, count = self._said(context)
                values.set_value(self._last, np.concatenate(([count], said)))

    return Impl
