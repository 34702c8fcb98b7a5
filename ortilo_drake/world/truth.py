"""The truth of a world, set in a Context: it may differ from what the onboard half believes.

Each function sets the parameters of every system that has a part in the matter, as Drake does for random contexts; the
default Context holds the scenario's vehicle and room. The context is the root's throughout.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from pydrake.systems.framework import Context, Diagram

from ortilo_drake.model.room import Room
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.world.drawn_truth import Drawn
from ortilo_drake.world.faults.message_fault import MessageFault
from ortilo_drake.world.scenery.rendering import mount_camera, move_landmarks
from ortilo_drake.world.sensors.sensor_errors import bias_of, factor_of
from ortilo_drake.world.vehicle.wrench_error import wrench_matrix


def set_truth(
    world: Diagram, context: Context, vehicle: Vehicle, room: Room, drawn: Drawn, payloads: Mapping[str, int]
) -> None:
    """Set how a world differs from what is believed of it.

    Args:
        world: the world; systems that it has not are left out.
        context: the root's; its seed is set already.
        vehicle: as it is believed to be.
        room: as it was surveyed.
        drawn: the differences, see drawn_truth.py.
        payloads: size of each sensor's payload, of those that fly.
    """
    set_body(world, context, vehicle, drawn)
    set_anchors(world, context, room.anchor_positions + drawn["survey.anchors"], drawn["uwb.bias"])
    set_landmarks(world, context, room.landmark_positions + drawn["survey.landmarks"])
    p_BC = np.array(room.camera.position) + drawn["camera.position"]
    set_camera(world, context, p_BC, drawn["camera.angles"], float(drawn["camera.focal_factor"]))
    for error, its in _named(world, context, "wrench_error"):
        matrix = wrench_matrix(float(drawn["vehicle.thrust_factor"]), drawn["vehicle.center_of_gravity"])
        error.set_wrench_in(its, matrix)
    for force, its in _named(world, context, "lasting_force"):
        force.start_in(its, np.concatenate((drawn["force.mean"], np.zeros(3))))
    for sensor in payloads:
        for error, its in _named(world, context, f"{sensor}_error"):
            error.set_factor_in(its, factor_of(drawn, sensor, error.GetInputPort("error").size()))
        for slow, its in _named(world, context, f"{sensor}_slow_error"):
            slow.start_in(its, bias_of(drawn, sensor, slow.get_output_port().size()))
        for clock, its in _named(world, context, f"{sensor}_clock"):
            clock.set_clock_in(its, float(drawn[f"clock.offset.{sensor}"]), float(drawn[f"clock.drift.{sensor}"]))


def _named(world: Diagram, context: Context, name: str) -> list[tuple[Any, Context]]:
    """Return the system of that name and its context, if the world has one."""
    if not world.HasSubsystemNamed(name):
        return []
    system = world.GetSubsystemByName(name)
    return [(system, system.GetMyMutableContextFromRoot(context))]


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


def set_body(world: Diagram, context: Context, vehicle: Vehicle, drawn: Drawn) -> None:
    """Set mass, moments of inertia and the imu's biases as drawn, beside the vehicle as it is believed to be."""
    inertia = tuple(float(drawn["vehicle.inertia_factor"] * moment) for moment in vehicle.inertia)
    mass = float(drawn["vehicle.mass_factor"] * vehicle.mass)
    imu_bias = np.array([*drawn["imu.level"], drawn["imu.yaw"], *drawn["imu.rates"], *drawn["imu.specific_force"]])
    set_vehicle(world, context, vehicle.model_copy(update={"mass": mass, "inertia": inertia}), imu_bias)


def set_lasting_force(world: Diagram, context: Context, force: np.ndarray) -> None:
    """Set the mean force in W (3) [N] of a world that has one, its gusts left as they are."""
    for lasting, its in _named(world, context, "lasting_force"):
        lasting.set_bias_in(its, np.concatenate((force, np.zeros(3))))


def set_anchors(world: Diagram, context: Context, p_WA: np.ndarray, bias: np.ndarray) -> None:
    """Set where the UWB anchors stand (n, 3) and the biases of their ranges (n) [m]."""
    if world.HasSubsystemNamed("uwb"):
        uwb = world.GetSubsystemByName("uwb")
        uwb.set_anchors_in(uwb.GetMyMutableContextFromRoot(context), p_WA, bias)
    for system in world.GetSystems():
        if isinstance(system, MessageFault):
            system.set_anchors_in(system.GetMyMutableContextFromRoot(context), p_WA)


def set_landmarks(world: Diagram, context: Context, p_WL: np.ndarray) -> None:
    """Set where the landmarks' centres are (n, 3) [m], for either camera; what carries them stays where it is."""
    if world.HasSubsystemNamed("projected_camera"):
        camera = world.GetSubsystemByName("projected_camera")
        camera.set_landmarks_in(camera.GetMyMutableContextFromRoot(context), p_WL)
    if world.HasSubsystemNamed("rendered_camera"):
        scene_graph = world.GetSubsystemByName("rendered_camera").GetSubsystemByName("scene_graph")
        move_landmarks(scene_graph, scene_graph.GetMyMutableContextFromRoot(context), p_WL)


def set_camera(
    world: Diagram, context: Context, p_BC: np.ndarray, rpy: np.ndarray | None = None, focal_factor: float = 1.0
) -> None:
    """Set how the camera is mounted and its lens, of either kind.

    Args:
        world: the world.
        context: the root's.
        p_BC: where on the vehicle it is (3) [m].
        rpy: roll, pitch and yaw by which it is turned from looking ahead (3) [rad]; by default not at all.
        focal_factor: by which its focal length differs from the room's [1].
    """
    rpy = np.zeros(3) if rpy is None else rpy
    for camera, its in _named(world, context, "projected_camera"):
        camera.set_camera_in(its, p_BC, rpy, focal_factor)
    if world.HasSubsystemNamed("rendered_camera"):
        sensor = world.GetSubsystemByName("rendered_camera").GetSubsystemByName("rgbd_sensor")
        mount_camera(sensor, sensor.GetMyMutableContextFromRoot(context), p_BC, rpy, focal_factor)
