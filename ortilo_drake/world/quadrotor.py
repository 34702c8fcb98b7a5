"""The quadrotor plant."""

from typing import Any

import numpy as np
from pydrake.systems.framework import LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from ortilo_drake.model.equations import DYNAMICS
from ortilo_drake.model.signals import N_U
from ortilo_drake.model.vehicle import M100, Vehicle


@TemplateSystem.define("QuadrotorPlant_")
def QuadrotorPlant_(T: type) -> type:
    """Return the plant for a scalar type: float, AutoDiffXd or Expression."""

    class Impl(LeafSystem_[T]):
        """A quadrotor as a rigid body under its total thrust and three torques.

        Ports:
            control (4): u = [f_T, tau_x, tau_y, tau_z], f_T absolute [N], torques about B's axes [N m].
            disturbance (6): force in W [N], torque in B [N m]; zero where not connected.
            state (12, output): x = [p_WB, rpy, v_WB, Euler rates]; does not depend on the inputs.

        The equations are those of model/equations.py: ``kinematics`` picks 'small_angle' (the paper's),
        'rigid_body' or 'linear'. Floats run through numba, other scalars through the same source in Python.
        """

        def _construct(self, vehicle: Vehicle = M100, kinematics: str = "small_angle", converter: Any = None) -> None:
            LeafSystem_[T].__init__(self, converter=converter)
            self.set_name("quadrotor")
            self._vehicle, self._kinematics = vehicle, kinematics
            dynamics = DYNAMICS[kinematics]
            self._dynamics = dynamics if T is float else dynamics.py_func
            self._mass, self._inertia = vehicle.mass, np.array(vehicle.inertia)
            self._undisturbed = np.zeros(6)
            self._control = self.DeclareVectorInputPort("control", N_U)
            self._disturbance = self.DeclareVectorInputPort("disturbance", 6)
            state = self.DeclareContinuousState(6, 6, 0)
            self.DeclareStateOutputPort("state", state)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            Impl._construct(self, other._vehicle, other._kinematics, converter=converter)

        def DoCalcTimeDerivatives(self, context: Any, derivatives: Any) -> None:
            try:
                d = self._disturbance.Eval(context)
            except RuntimeError:  # not connected; asking first would cost every other call a tenth of its time
                if self._disturbance.HasValue(context):
                    raise
                d = self._undisturbed
            x = context.get_continuous_state_vector().CopyToVector()
            u = self._control.Eval(context)
            if T is float:
                x_dot = self._dynamics(x, u, d, self._mass, self._inertia)
            else:
                with np.errstate(invalid="ignore"):  # flags that Drake's symbols leave raised
                    x_dot = self._dynamics(x, u, d, self._mass, self._inertia)
            derivatives.SetFromVector(x_dot)

    return Impl


QuadrotorPlant = QuadrotorPlant_[None]
