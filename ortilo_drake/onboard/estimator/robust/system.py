"""What stands between handler and filter, as a system: it refuses and weighs values, and opens the filter's P."""

import sys
from typing import Any, Final

import numpy as np
from pydrake.autodiffutils import AutoDiffXd
from pydrake.systems.framework import LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from ortilo_drake.model.measurement import Measurement
from ortilo_drake.model.scalars import time_in, values_of
from ortilo_drake.model.signals import N_I
from ortilo_drake.onboard.estimator.extra_states import C as GYROSCOPE
from ortilo_drake.onboard.estimator.robust.weights import Weighing, first_state, judge, weighed
from ortilo_drake.scenario.robust import Opening

OUTPUTS: Final = ("y", "delta", "V2", "opening")


def opening_variances(opening: Opening, extra: tuple[str, ...]) -> np.ndarray:
    """Return what is added to the diagonal of P of [x; e; i], by what of it is opened (3, n); e has those names."""
    none = np.zeros(3)
    angle, gyroscope = np.full(3, opening.angle), [opening.gyroscope if name in GYROSCOPE else 0.0 for name in extra]
    others = np.repeat([opening.velocity, opening.rate], 3)
    rates = np.concatenate((none, angle, none, none, gyroscope, np.zeros(N_I)))
    whole = np.concatenate((np.full(3, opening.position), angle, others, gyroscope, np.zeros(N_I)))
    return np.square(np.array([np.zeros(whole.size), rates, whole]))


# Without a scope Drake reads the sources of all frames to find it.
@TemplateSystem.define("RobustGate_", T_list=[float, AutoDiffXd], scope=sys.modules[__name__])
def RobustGate_(T: type) -> type:
    """Return the gate for a scalar type: float or AutoDiffXd, for which what is used and weights are constants."""

    class Impl(LeafSystem_[T]):
        """Refuses and weighs what arrives; equations: weights.py.

        Ports:
            y (p), delta (s), V2 (q): the measurement of this tick.
            belief (n + n^2): [xhat, P row by row] of this tick.
            belief_<sensor> (n + n^2): that of the tick of a sensor's stamp, for sensors that come late.
            weighed (p + s + q + n, output): y, delta and V2 of what is used, and what is added to the diagonal of P.

        State (discrete, updated every h), see weights.py: of each sensor (3 s), when each state was seen (12), an
        average innovation (3).

        Args:
            weighing: what decides.
            measurement: the layout that y, delta and V2 begin with.
            opening: variances that are added by what is opened of P (3, n).
            late: sensors with a belief of their own.
            h: tick [s].
        """

        def _construct(
            self,
            weighing: Weighing,
            measurement: Measurement,
            opening: np.ndarray,
            late: tuple[str, ...],
            h: float,
            converter: Any = None,
        ) -> None:
            LeafSystem_[T].__init__(self, converter=converter)
            self.set_name("robust_gate")
            self._arguments = {
                "weighing": weighing,
                "measurement": measurement,
                "opening": opening,
                "late": late,
                "h": h,
            }
            self._weighing, self._opening, n = tuple(weighing), opening, opening.shape[1]  # plain, see filter_loops.py
            self._weighed = weighed if T is float else weighed.py_func
            sizes = weighing.first[-1], weighing.gates.size, weighing.block[-1]
            self._inputs = [
                self.DeclareVectorInputPort(name, int(size)) for name, size in zip(OUTPUTS[:3], sizes, strict=True)
            ]
            present = self.DeclareVectorInputPort("belief", n + n * n)
            own = {name: self.DeclareVectorInputPort(f"belief_{name}", n + n * n) for name in late}
            self._beliefs = [own.get(name, present) for name in measurement.sensors[: weighing.gates.size]]
            self._states = [self.DeclareDiscreteState(a.ravel()) for a in first_state(weighing.gates.size)]
            self.DeclarePeriodicDiscreteUpdateEvent(h, 0.0, self._update)
            needs = {port.ticket() for port in (*self._inputs, present, *own.values())}
            needs |= {self.time_ticket(), self.xd_ticket()}
            self.DeclareVectorOutputPort("weighed", int(sum(sizes)) + n, self._calc, prerequisites_of_calc=needs)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            Impl._construct(self, **other._arguments, converter=converter)

        def _judged(self, context: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, int]:
            signals = [values_of(port.Eval(context)) for port in self._inputs]
            beliefs = np.array([values_of(port.Eval(context)) for port in self._beliefs])
            values = [context.get_discrete_state(i).CopyToVector() for i in self._states]
            state, seen, mean = (values_of(value) for value in values)
            found: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, int] = judge(
                *signals, beliefs, state.reshape(len(beliefs), -1), seen, mean, time_in(context), self._weighing
            )
            return found

        def _calc(self, context: Any, output: Any) -> None:
            factors, _, _, _, opens = self._judged(context)
            signals = [port.Eval(context) for port in self._inputs]
            used = self._weighed(*signals, factors, self._weighing[1], self._weighing[2])
            output.set_value(np.concatenate((used, self._opening[opens])))

        def _update(self, context: Any, values: Any) -> None:
            for index, state in zip(self._states, self._judged(context)[1:4], strict=True):
                values.set_value(index, state.ravel())

    return Impl
