"""Errors of a sensor's payload beside its white noise: what is added to it, and a factor of the whole."""

import sys
from typing import Any

import numpy as np
from numba import njit
from pydrake.autodiffutils import AutoDiffXd
from pydrake.systems.framework import BasicVector_, LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from ortilo_drake.model.signals import ARRIVED, PAYLOAD


@njit(cache=True)
def message_with_error(message: np.ndarray, factor: np.ndarray, error: np.ndarray, flagged: bool) -> np.ndarray:
    """Return a message with c_i (y_i + e_i) in place of its payload's first n numbers y_i, if it is there.

    Args:
        message: see model/signals.py.
        factor: c (n).
        error: e (n).
        flagged: whether n flags follow these numbers, as in the uwb message: a number that is not there stays, and the
            others, which are distances, are at least 0.
    """
    found = message.copy()
    if message[ARRIVED] == 0.0:
        return found
    n = len(factor)
    for i in range(n):
        there = not flagged or message[PAYLOAD + n + i] != 0.0
        if there:
            found[PAYLOAD + i] = factor[i] * (message[PAYLOAD + i] + error[i])
        if there and flagged and found[PAYLOAD + i] < 0.0:
            found[PAYLOAD + i] = 0.0 * found[PAYLOAD + i]
    return found


# Without a scope Drake reads the sources of all frames to find it.
@TemplateSystem.define("MessageError_", T_list=[float, AutoDiffXd], scope=sys.modules[__name__])
def MessageError_(T: type) -> type:
    """Return the system for a scalar type: float or AutoDiffXd."""

    class Impl(LeafSystem_[T]):
        """Memoryless: the errors of a sensor's payload, see message_with_error.

        Ports:
            message (m): what the sensor would say.
            error (n): e.
            measured (m, output): what it says.

        Parameters of the Context:
            factor (n): c, 1 by default.

        Args:
            name: of the system.
            size: m.
            n: how many numbers of the payload err.
            flagged: whether n flags follow them.
        """

        def _construct(self, name: str, size: int, n: int, flagged: bool, converter: Any = None) -> None:
            LeafSystem_[T].__init__(self, converter=converter)
            self.set_name(name)
            self._arguments = {"name": name, "size": size, "n": n, "flagged": flagged}
            self._with_error = message_with_error if T is float else message_with_error.py_func
            self._flagged = flagged
            self._factor = self.DeclareNumericParameter(BasicVector_[T](np.ones(n)))
            self._message = self.DeclareVectorInputPort("message", size)
            self._error = self.DeclareVectorInputPort("error", n)
            needs = {self._message.ticket(), self._error.ticket(), self.all_parameters_ticket()}
            self.DeclareVectorOutputPort("measured", size, self._calc_measured, prerequisites_of_calc=needs)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            Impl._construct(self, **other._arguments, converter=converter)

        def set_factor_in(self, context: Any, factor: np.ndarray) -> None:
            """Set c (n) in a context of this system."""
            context.get_mutable_numeric_parameter(self._factor).SetFromVector(factor)

        def _calc_measured(self, context: Any, output: Any) -> None:
            factor = context.get_numeric_parameter(self._factor).CopyToVector()
            message, error = self._message.Eval(context), self._error.Eval(context)
            output.set_value(self._with_error(message, factor, error, self._flagged))

    return Impl
