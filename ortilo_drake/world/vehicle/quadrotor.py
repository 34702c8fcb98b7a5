"""The quadrotor plant."""

import contextlib
import sys
from typing import Any

import numpy as np
from pydrake.systems.framework import BasicVector_, LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.equations import DYNAMICS, KINEMATICS, step, stepped, velocity_rate
from ortilo_drake.model.placing import put
from ortilo_drake.model.signals import N_U, N_X
from ortilo_drake.model.vehicle import M100, Vehicle


def _body_of(vehicle: Vehicle) -> list[float]:
    return [vehicle.mass, *vehicle.inertia]


def sampled_step(n: Any, x: np.ndarray, control: np.ndarray, disturbance: np.ndarray) -> None:
    """Advance x by a tick under held u and d, see model.equations.step."""
    put(stepped(x, control, disturbance, n.mass, n.inertia, n.kinematics, n.h), x)


def felt_step(values: np.ndarray, control: np.ndarray, disturbance: np.ndarray) -> None:
    """Hold u and d over the tick that begins."""
    put(control, values)
    put(disturbance, values, N_U)


def acceleration_out(n: Any, state: np.ndarray, control: np.ndarray, disturbance: np.ndarray, out: np.ndarray) -> None:
    """Output v_dot (3) under u and d."""
    put(velocity_rate(state, control, disturbance, n.mass, n.kinematics), out)


SAMPLED = Element("sampled_plant", step=sampled_step, shows="x")
ACCELERATION = Element("acceleration", out=acceleration_out)
FELT = Element("felt", step=felt_step, shows="values")


def plant_box(vehicle: Vehicle, kinematics: str, x_0: np.ndarray, h: float) -> Box:
    """Return the sampled plant: it reads u as it acts on the body (4) and the disturbance (6), and outputs x (12)."""
    numbers = {"mass": vehicle.mass, "inertia": vehicle.inertia, "kinematics": KINEMATICS.index(kinematics), "h": h}
    return Box("plant", SAMPLED, N_X, Values(numbers, start={"x": x_0}))


def felt_box(vehicle: Vehicle) -> Box:
    """Return the box of u (4) and d (6) that acted since the last tick, without rotor dynamics; hover at first."""
    values = np.zeros(N_U + 6)
    values[0] = vehicle.hover_thrust
    parts = {"control": (0, N_U), "disturbance": (N_U, 6)}
    return Box("felt", FELT, N_U + 6, Values(start={"values": values}), parts=parts)


def acceleration_box(vehicle: Vehicle, kinematics: str) -> Box:
    """Return the box of v_dot of B's origin in W (3); it reads x (12), u as it acts on the body (4) and d (6)."""
    numbers = {"mass": vehicle.mass, "kinematics": KINEMATICS.index(kinematics)}
    return Box("acceleration", ACCELERATION, 3, Values(numbers))


# Without a scope Drake reads the sources of all frames to find it.
@TemplateSystem.define("QuadrotorPlant_", scope=sys.modules[__name__])
def QuadrotorPlant_(T: type) -> type:
    """Return the plant for a scalar type: float, AutoDiffXd or Expression."""

    class Impl(LeafSystem_[T]):
        """A quadrotor as a rigid body under its total thrust and three torques.

        Ports:
            control (4): u = [f_T, tau_x, tau_y, tau_z], f_T absolute [N], torques about B's axes [N m].
            disturbance (6): force in W [N], torque in B [N m]; zero where not connected.
            state (12, output): x = [p_WB, rpy, v_WB, Euler rates]; does not depend on the inputs.
            acceleration (3, output): v_dot of B's origin in W [m/s^2], under the inputs of that instant.

        The equations are those of model/equations.py: ``kinematics`` picks 'small_angle' (the paper's),
        'rigid_body' or 'linear'. Floats run through numba, other scalars through the same source in Python.

        As with Drake's MultibodyPlant, ``time_step`` 0 makes x a continuous state that the simulator integrates. A
        positive time_step [s] makes it a discrete state that is updated every time_step with the inputs of that
        instant, held over the step, by one step of the classical Runge-Kutta method; for the linearised model, whose A
        is nilpotent, this is the exact x_{k+1} = Phi x_k + Gamma u_k.

        Its default state is ``x_0``, by default zeros.

        Parameters of the Context:
            body (4): mass [kg] and moments of inertia I_x, I_y, I_z [kg m^2]; the vehicle's by default.
        """

        def _construct(
            self,
            vehicle: Vehicle = M100,
            kinematics: str = "small_angle",
            time_step: float = 0.0,
            x_0: np.ndarray | None = None,
            converter: Any = None,
        ) -> None:
            LeafSystem_[T].__init__(self, converter=converter)
            self.set_name("quadrotor")
            self._vehicle, self._kinematics, self._time_step, self._x_0 = vehicle, kinematics, time_step, x_0
            start = BasicVector_[T](np.zeros(N_X) if x_0 is None else x_0)
            dynamics, self._kind = DYNAMICS[kinematics], KINEMATICS.index(kinematics)
            self._dynamics, self._step = (dynamics, step) if T is float else (dynamics.py_func, step.py_func)
            self._body = self.DeclareNumericParameter(BasicVector_[T](_body_of(vehicle)))
            self._undisturbed = np.zeros(6)
            self._control = self.DeclareVectorInputPort("control", N_U)
            self._disturbance = self.DeclareVectorInputPort("disturbance", 6)
            if time_step:
                state = self.DeclareDiscreteState(start)
                update = self._update if T is float else self._update_symbols
                self.DeclarePeriodicDiscreteUpdateEvent(time_step, 0.0, update)
            else:
                state = self.DeclareContinuousState(start, 6, 6, 0)
            self.DeclareStateOutputPort("state", state)
            needs = {self.all_sources_ticket()}
            self.DeclareVectorOutputPort("acceleration", 3, self._calc_acceleration, prerequisites_of_calc=needs)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            Impl._construct(self, other._vehicle, other._kinematics, other._time_step, other._x_0, converter=converter)

        def SetState(self, context: Any, x: np.ndarray) -> None:
            """Set x (12) in a context of this plant."""
            if self._time_step:
                context.SetDiscreteState(x)
            else:
                context.SetContinuousState(x)

        def SetVehicle(self, context: Any, vehicle: Vehicle) -> None:
            """Set mass and inertia in a context of this plant."""
            context.get_mutable_numeric_parameter(self._body).SetFromVector(_body_of(vehicle))

        def DoCalcTimeDerivatives(self, context: Any, derivatives: Any) -> None:
            if self._time_step:
                return
            derivatives.SetFromVector(self._rates(context, context.get_continuous_state_vector().CopyToVector()))

        def _rates(self, context: Any, x: Any) -> Any:
            u, d = self._inputs(context)
            body = context.get_numeric_parameter(self._body).CopyToVector()
            with contextlib.nullcontext() if T is float else np.errstate(invalid="ignore"):  # as in _update_symbols
                return self._dynamics(x, u, d, body[0], body[1:4])

        def _calc_acceleration(self, context: Any, output: Any) -> None:
            x = self.GetOutputPort("state").Eval(context)
            output.SetFromVector(self._rates(context, x)[6:9])

        def _update(self, context: Any, values: Any) -> None:
            x, (u, d) = context.get_discrete_state_vector().CopyToVector(), self._inputs(context)
            body = context.get_numeric_parameter(self._body).CopyToVector()
            values.set_value(self._step(x, u, d, body[0], body[1:4], self._kind, self._time_step))

        def _update_symbols(self, context: Any, values: Any) -> None:
            with np.errstate(invalid="ignore"):  # Drake's symbols leave floating-point flags raised
                self._update(context, values)

        def _inputs(self, context: Any) -> tuple[Any, Any]:
            d = self._disturbance.Eval(context) if self._disturbance.HasValue(context) else self._undisturbed
            return self._control.Eval(context), d

    return Impl
