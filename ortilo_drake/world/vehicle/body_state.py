"""A body of Drake's MultibodyPlant in our layout of a state."""

import sys
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform_, RollPitchYaw_
from pydrake.multibody.math import SpatialAcceleration_, SpatialVelocity_
from pydrake.systems.framework import LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from ortilo_drake.model.signals import N_X


# Without a scope Drake reads the sources of all frames to find it.
@TemplateSystem.define("BodyState_", scope=sys.modules[__name__])
def BodyState_(T: type) -> type:
    """Return the system for a scalar type: float, AutoDiffXd or Expression."""

    class Impl(LeafSystem_[T]):
        """The motion of a body of a MultibodyPlant, as our sensors read it; memoryless.

        Ports, the inputs each from the plant's output of that name:
            body_poses: X_WB of all bodies.
            body_spatial_velocities: V_WB of all bodies.
            body_spatial_accelerations: A_WB of all bodies; only `acceleration` needs it.
            state (12, output): x = [p_WB, rpy, v_WB, rpy rates] of B's origin.
            acceleration (3, output): v_dot of B's origin in W [m/s^2].

        The plant's world frame must have its z axis up, and B must look along its x axis, as ours does.

        Args:
            body: the body's index in the plant.
        """

        def _construct(self, body: Any, converter: Any = None) -> None:
            LeafSystem_[T].__init__(self, converter=converter)
            self.set_name("body_state")
            self._body = int(body)
            kinds = {"poses": RigidTransform_, "spatial_velocities": SpatialVelocity_}
            kinds["spatial_accelerations"] = SpatialAcceleration_
            self._ports = {
                name: self.DeclareAbstractInputPort(f"body_{name}", AbstractValue.Make([kind[T]()]))
                for name, kind in kinds.items()
            }
            poses, velocities, accelerations = (port.ticket() for port in self._ports.values())
            self.DeclareVectorOutputPort("state", N_X, self._calc_state, {poses, velocities})
            self.DeclareVectorOutputPort("acceleration", 3, self._calc_acceleration, {accelerations})

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            Impl._construct(self, other._body, converter=converter)

        def _in(self, context: Any, name: str) -> Any:
            return self._ports[name].Eval(context)[self._body]

        def _calc_state(self, context: Any, output: Any) -> None:
            X_WB, V_WB = self._in(context, "poses"), self._in(context, "spatial_velocities")
            rpy = RollPitchYaw_[T](X_WB.rotation())
            rates = rpy.CalcRpyDtFromAngularVelocityInParent(V_WB.rotational())
            output.SetFromVector(np.concatenate([X_WB.translation(), rpy.vector(), V_WB.translational(), rates]))

        def _calc_acceleration(self, context: Any, output: Any) -> None:
            output.SetFromVector(self._in(context, "spatial_accelerations").translational())

    return Impl
