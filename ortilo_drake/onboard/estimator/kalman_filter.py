"""The intermittent Kalman filter as a system."""

import sys
from typing import Any

import numpy as np
from pydrake.autodiffutils import AutoDiffXd
from pydrake.systems.framework import BasicVector_, Context, DiscreteValues, LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from ortilo_drake.model.measurement import Layout, Measurement
from ortilo_drake.model.scalars import values_of
from ortilo_drake.model.signals import IMU_SIZE, N_U, N_X, N_XBAR, REFERENCE_SIZE
from ortilo_drake.onboard.estimator.belief import diagonal_of_P, extra_part, known_part, with_known_part
from ortilo_drake.onboard.estimator.extra_states import IMU_ROWS
from ortilo_drake.onboard.estimator.filter_loops import filter_step
from ortilo_drake.onboard.estimator.imu_rows import with_imu_rows
from ortilo_drake.onboard.estimator.intermittent_filter import FilterModel, intermittent_step


def handed_over(measurement: Measurement) -> dict[str, int]:
    """Return sizes of y, delta and V2 as the handler hands them over: without the rows of imu_rows.py."""
    sizes, own = measurement.sizes, sum(sensor in IMU_ROWS for sensor in measurement.sensors)
    return {"y": sizes["y"] - 3 * own, "delta": sizes["delta"] - own, "V2": sizes["V2"] - 9 * own}


def differentiable_step(
    belief: np.ndarray,
    y: np.ndarray,
    delta: np.ndarray,
    V2: np.ndarray,
    u: np.ndarray,
    r: np.ndarray,
    model: FilterModel,
    layout: Layout,
) -> np.ndarray:
    """Return filter_step of AutoDiffXd, by the equations as printed; what arrived is a constant."""
    n = len(model[0]) + 3
    P, known = belief[n:].reshape(n, n), (FilterModel(*model), Layout(*layout))
    x, P, _ = intermittent_step.py_func(belief[:n], P, y, values_of(delta), V2, u, r, *known)
    return np.concatenate((x, P.ravel()))


def plain(numbers: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return a named tuple, and those in it, as plain tuples, see filter_loops.py."""
    return tuple(plain(part) if isinstance(part, tuple) else part for part in numbers)


class Predictor:
    """Ports, belief and measurement of a LeafSystem of any scalar type that is a Kalman filter."""

    def declare_predictor(
        self: Any,
        T: type,
        model: FilterModel,
        measurement: Measurement,
        hover_thrust: float,
        xbar_0: np.ndarray,
        P_0: np.ndarray,
        h: float,
        imu_variances: np.ndarray | None = None,
        opens: bool = False,
    ) -> None:
        """Declare ports and states; arguments as KalmanFilter_'s, T the scalar type."""
        self.set_name("kalman_filter")
        self._n, self._imu_variances = len(P_0), imu_variances
        self._model, self._layout, self._h = plain(model), plain(measurement.layout), h
        functions = known_part, extra_part, with_imu_rows
        self._known_part, self._extra_part, self._with_imu_rows = (f if T is float else f.py_func for f in functions)
        self._hover = np.array([hover_thrust, 0.0, 0.0, 0.0])
        self._measurement = [self.DeclareVectorInputPort(name, size) for name, size in handed_over(measurement).items()]
        if imu_variances is not None:
            self._imu, self._imu_number = self.DeclareVectorInputPort("imu", IMU_SIZE), measurement.sensors.index("imu")
        self._control = self.DeclareVectorInputPort("control", N_U)
        self._reference = self.DeclareVectorInputPort("reference", REFERENCE_SIZE)
        whole = np.concatenate((xbar_0[:N_X], np.zeros(self._n - N_XBAR), xbar_0[N_X:], P_0.ravel()))
        self._known = self._belief = self.DeclareDiscreteState(BasicVector_[T](known_part(whole, self._n)))
        if self._n > N_XBAR:
            self._extra = self.DeclareDiscreteState(BasicVector_[T](extra_part(whole, self._n)))
            self._belief = self.DeclareDiscreteState(BasicVector_[T](whole))
            self.DeclareStateOutputPort("extra", self._extra)
        self.DeclareStateOutputPort("belief", self._known)
        self._opening = None
        if opens:
            self._opening = self.DeclareVectorInputPort("opening", self._n)
            self.DeclareStateOutputPort("whole_belief", self._belief)
        self.DeclarePeriodicDiscreteUpdateEvent(h, 0.0, self._update)

    def SetBelief(self: Any, context: Context, xbar: np.ndarray, P: np.ndarray) -> None:
        """Set estimate (15) and covariance (15 x 15) of [x; i] in a context of this filter; e stays as it is."""
        values = context.get_mutable_discrete_state()
        self.set_belief(values, with_known_part(values.value(self._belief), self._n, xbar, P))

    def set_belief(self: Any, values: DiscreteValues, belief: np.ndarray) -> None:
        """Set the belief of [x; e; i] and what is shown of it."""
        values.set_value(self._belief, belief)
        if self._n > N_XBAR:
            values.set_value(self._known, self._known_part(belief, self._n))
            values.set_value(self._extra, self._extra_part(belief, self._n))

    def opening_in(self: Any, context: Context) -> np.ndarray | None:
        """Return what is added to the diagonal of P (n); None for nothing."""
        if self._opening is None:
            return None
        opening = self._opening.Eval(context)
        return opening if np.any(values_of(opening) != 0.0) else None

    def inputs_in(self: Any, context: Context) -> list[np.ndarray]:
        """Return y, delta, V2, the control less hover, and the reference."""
        signals = [port.Eval(context) for port in self._measurement]
        if self._imu_variances is not None:
            imu = self._imu.Eval(context)
            signals = self._with_imu_rows(*signals, imu, self._imu_number, self._imu_variances)
        return [*signals, self._control.Eval(context) - self._hover, self._reference.Eval(context)]


# Without a scope Drake reads the sources of all frames to find it.
@TemplateSystem.define("KalmanFilter_", T_list=[float, AutoDiffXd], scope=sys.modules[__name__])
def KalmanFilter_(T: type) -> type:
    """Return the filter for a scalar type: float or AutoDiffXd, for which what arrived is a constant."""

    class Impl(LeafSystem_[T], Predictor):
        """The one-step predictor xhat_{k|k-1} of xbar = [x; e; i] and its covariance P_k.

        Ports:
            y (p), delta (s), V2 (q): the measurement of this tick, see model/measurement.py.
            imu (11): the imu message; only where rows of y are made of it.
            control (4): u_k, f_T absolute.
            reference (9): r and its derivatives; r drives the integrator.
            opening (n): added to the diagonal of P_k before it is used; only if opens.
            belief (240, output): [xhat_{k|k-1}, P_k row by row] of [x; i].
            whole_belief (n + n^2, output): the same of [x; e; i], without the opening; only if opens.
            extra (2 e, output): the same of the states e between them, of P_k the standard deviations; only where there
                are any.

        The outputs are discrete states and depend on no input within a tick. Equations: intermittent_filter.py.

        Args:
            model: what the filter believes of the vehicle.
            measurement: the layout of y, delta and V2, over x and e, with the rows of imu_rows.py if it has any.
            hover_thrust: m g [N] of the vehicle as it is believed to be.
            xbar_0: initial estimate of [x; i] (15); that of e is 0.
            P_0: covariance of [x; e; i].
            h: tick [s].
            imu_variances: of the rows of imu_rows.py (3 or 6); None where there are none.
            opens: whether P can be opened.
        """

        def _construct(self, *arguments: Any, converter: Any = None) -> None:
            LeafSystem_[T].__init__(self, converter=converter)
            self._arguments = arguments
            self._step: Any = filter_step if T is float else differentiable_step
            self.declare_predictor(T, *arguments)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            Impl._construct(self, *other._arguments, converter=converter)

        def _update(self, context: Any, values: Any) -> None:
            belief, opening = context.get_discrete_state(self._belief).CopyToVector(), self.opening_in(context)
            if opening is not None:
                diagonal_of_P(belief, self._n)[:] += opening
            self.set_belief(values, self._step(belief, *self.inputs_in(context), self._model, self._layout))

    return Impl
