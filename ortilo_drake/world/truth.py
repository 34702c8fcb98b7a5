"""The truth of a world, set in a Context: it may differ from what the onboard half believes.

Each function sets the parameters of every system that has a part in the matter, as Drake does for random contexts; the
default Context holds the scenario's vehicle and room. The context is the root's throughout.
"""

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context, Diagram

from ortilo_drake.model.pinhole import R_BC
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.world.scenery.rendering import move_landmarks


def set_vehicle(world: Diagram, context: Context, vehicle: Vehicle, imu_bias: np.ndarray | None = None) -> None:
    """Set the vehicle's body and rotors, and the biases of its imu's angles, rates and specific force (9).

    What its flight controller falls back to without a command, the hover it was made for, stays.
    """
    for name in ("quadrotor", "rotors"):
        if world.HasSubsystemNamed(name):
            system = world.GetSubsystemByName(name)
            system.SetVehicle(system.GetMyMutableContextFromRoot(context), vehicle)
    if world.HasSubsystemNamed("imu"):
        imu = world.GetSubsystemByName("imu")
        bias = np.zeros(9) if imu_bias is None else imu_bias
        imu.set_truth_in(imu.GetMyMutableContextFromRoot(context), vehicle.mass, bias)


def set_anchors(world: Diagram, context: Context, p_WA: np.ndarray, bias: np.ndarray) -> None:
    """Set where the UWB anchors stand (n, 3) and the biases of their ranges (n) [m]."""
    if world.HasSubsystemNamed("uwb"):
        uwb = world.GetSubsystemByName("uwb")
        uwb.set_anchors_in(uwb.GetMyMutableContextFromRoot(context), p_WA, bias)


def set_landmarks(world: Diagram, context: Context, p_WL: np.ndarray) -> None:
    """Set where the landmarks' centres are (n, 3) [m], for either camera; what carries them stays where it is."""
    if world.HasSubsystemNamed("projected_camera"):
        camera = world.GetSubsystemByName("projected_camera")
        camera.set_landmarks_in(camera.GetMyMutableContextFromRoot(context), p_WL)
    if world.HasSubsystemNamed("rendered_camera"):
        scene_graph = world.GetSubsystemByName("rendered_camera").GetSubsystemByName("scene_graph")
        move_landmarks(scene_graph, scene_graph.GetMyMutableContextFromRoot(context), p_WL)


def set_camera(world: Diagram, context: Context, p_BC: np.ndarray) -> None:
    """Set where on the vehicle the camera is (3) [m], of either kind; it looks ahead as before."""
    if world.HasSubsystemNamed("projected_camera"):
        camera = world.GetSubsystemByName("projected_camera")
        camera.set_camera_in(camera.GetMyMutableContextFromRoot(context), p_BC)
    if world.HasSubsystemNamed("rendered_camera"):
        sensor = world.GetSubsystemByName("rendered_camera").GetSubsystemByName("rgbd_sensor")
        sensor.SetX_PB(sensor.GetMyMutableContextFromRoot(context), RigidTransform(RotationMatrix(R_BC), p_BC))
