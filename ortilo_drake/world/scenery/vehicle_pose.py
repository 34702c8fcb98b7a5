"""The vehicle's pose, in the form that a SceneGraph needs."""

from pydrake.common.value import Value
from pydrake.geometry import FrameId, FramePoseVector
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.framework import Context, LeafSystem

from ortilo_drake.model.signals import N_X


class VehiclePose(LeafSystem):
    """The pose X_WB of the state; memoryless.

    Ports:
        state (12): x of the vehicle.
        geometry_pose (FramePoseVector, output): X_WB of the vehicle's frame.

    Args:
        frame: id of the vehicle's frame in the SceneGraph.
    """

    def __init__(self, frame: FrameId):
        super().__init__()
        self.set_name("vehicle_pose")
        self._frame = frame
        self._state = self.DeclareVectorInputPort("state", N_X)
        self.DeclareAbstractOutputPort(
            "geometry_pose",
            lambda: Value(FramePoseVector()),
            self._calc_pose,
            prerequisites_of_calc={self._state.ticket()},
        )

    def _calc_pose(self, context: Context, output: Value) -> None:
        x = self._state.Eval(context)
        poses = FramePoseVector()
        poses.set_value(id=self._frame, value=RigidTransform(RollPitchYaw(x[3:6]), x[0:3]))
        output.set_value(poses)
