"""The boxes of the world: the vehicle, its sensors and their links."""

import numpy as np
from pydrake.trajectories import Trajectory

from ortilo_drake.loop.element import Box
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import N_X
from ortilo_drake.onboard.planner.planned import start_of
from ortilo_drake.scenario import Link, Scenario
from ortilo_drake.world.radio.link import delivery_box, link_box
from ortilo_drake.world.sensors.imu import imu_box
from ortilo_drake.world.sensors.projected_camera_element import camera_box
from ortilo_drake.world.sensors.uwb import uwb_box
from ortilo_drake.world.vehicle.disturbance import disturbance_box
from ortilo_drake.world.vehicle.quadrotor import plant_box


def world_boxes(scenario: Scenario, room: Room, path: Trajectory) -> tuple[list[Box], dict[str, str]]:
    """Return the boxes of the world, and which of them says each sensor's message as it lands."""
    boxes, messages = vehicle_boxes(scenario, path), {}
    for name in scenario.measurement.sensors:
        if name in scenario.sensors:
            own = sensor_boxes(scenario, room, name)
            boxes += own
            messages[name] = own[-1].name
    return boxes, messages


def vehicle_boxes(scenario: Scenario, path: Trajectory) -> list[Box]:
    """Return the plant, `plant`, what makes its wrench and what pushes it about."""
    x_0 = np.zeros(N_X)
    x_0[0:3], x_0[5] = start_of(path), scenario.yaw
    plant = plant_box(scenario.vehicle, scenario.world.kinematics, x_0, scenario.h)
    return [disturbance_box(scenario.world.disturbance, scenario.h), plant.reading(control="servo")]


def sensor_boxes(scenario: Scenario, room: Room, name: str) -> list[Box]:
    """Return a sensor with its link; the last box says its message as it lands."""
    settings, h = link_settings(scenario, name), scenario.h
    link = link_box(name, settings, scenario.every(name), h).reading(state="plant")
    sensor = source_box(scenario, room, name).reading(state="plant", sent=link.name)
    delivered = delivery_box(name, sensor, settings)
    return [link, sensor] + ([delivered] if delivered else [])


def link_settings(scenario: Scenario, name: str) -> Link:
    """Return the settings of a sensor's link; from picture to boxes it takes the camera's latency besides."""
    settings = scenario.link_of(name)
    latency = scenario.camera.latency if name == "camera" else 0
    return settings.model_copy(update={"delay": settings.delay + latency})


def source_box(scenario: Scenario, room: Room, name: str) -> Box:
    """Return what says a sensor's message as it is sent: it reads `sent` and the state."""
    if name == "uwb":
        return uwb_box(scenario.uwb, room, scenario.h)
    if name == "imu":
        return imu_box(scenario.imu, scenario.h, False, scenario.vehicle.mass)
    if name == "camera":
        return camera_box(scenario.camera, room, scenario.faults, scenario.h)
    raise NotImplementedError(name)
