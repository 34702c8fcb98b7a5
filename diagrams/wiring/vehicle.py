"""The boxes of the vehicle: its plant, what makes its wrench and what pushes it about."""

import numpy as np
from pydrake.trajectories import Trajectory

from ortilo_drake.loop.element import Box
from ortilo_drake.model.signals import N_X
from ortilo_drake.onboard.planner.planned import start_of
from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.truth import ForceTruth, VehicleTruth
from ortilo_drake.world.faults.vehicle_faults import force_faults_box, force_table, wrench_faults_box, wrench_table
from ortilo_drake.world.slow_error import gauss_markov
from ortilo_drake.world.vehicle.continuous_element import continuous_boxes
from ortilo_drake.world.vehicle.disturbance import disturbance_box, lasting_force_box
from ortilo_drake.world.vehicle.quadrotor import felt_box, plant_box
from ortilo_drake.world.vehicle.wrench_error import wrench_error_box


def vehicle_boxes(scenario: Scenario, path: Trajectory | Box, control: str, feels: bool) -> list[Box]:
    """Return the plant, `plant`, and all that acts on it.

    Args:
        scenario: the scenario.
        path: that is flown, at whose start the vehicle hovers.
        control: the box that says the control as it reaches the rotors.
        feels: whether an imu asks for what the body felt up to this tick, `felt`.
    """
    x_0 = np.zeros(N_X)
    x_0[0:3], x_0[5] = start_of(path), scenario.yaw
    pushing, acting = disturbance_boxes(scenario), wrench_boxes(scenario, control)
    acts, pushes = acting[-1].name if acting else control, pushing[-1].name
    if scenario.world.plant == "sampled" and not scenario.faster_sensors:
        plant = [plant_box(scenario.vehicle, scenario.world.kinematics, x_0, scenario.h)]
    else:
        plant = continuous_boxes(scenario, x_0, scenario.samples("imu"), feels)
    moving = plant[0].reading(control=acts, disturbance=pushes)
    felt = [felt_box(scenario.vehicle).reading(control=acts, disturbance=pushes)] if feels else []
    return [*pushing, *acting, moving, *plant[1:], *felt]


def disturbance_boxes(scenario: Scenario) -> list[Box]:
    """Return what pushes the vehicle about; the last box says it."""
    boxes = [disturbance_box(scenario.world.disturbance, scenario.h)]
    lasting, faults = scenario.truth.force, force_table(scenario.faults)
    if lasting != ForceTruth():
        noise = gauss_markov(np.array([*[lasting.gust_sd] * 3, 0.0, 0.0, 0.0]), lasting.gust_time, scenario.h)
        boxes.append(lasting_force_box(noise, scenario.h).reading(disturbance=boxes[-1].name))
    if faults.kinds.size:
        boxes.append(force_faults_box(faults, scenario.h).reading(disturbance=boxes[-1].name))
    return boxes


def wrench_boxes(scenario: Scenario, control: str) -> list[Box]:
    """Return what changes the control of rotors without dynamics; the last box, if any, says it as it acts.

    Rotors with dynamics have these changes behind them: world/vehicle/continuous.py.
    """
    boxes: list[Box] = []
    if scenario.world.rotors.kind == "first_order":
        return boxes
    if scenario.truth.vehicle != VehicleTruth():
        boxes.append(wrench_error_box().reading(control=control))
    faults = wrench_table(scenario.faults, scenario.vehicle)
    if faults.kinds.size:
        boxes.append(wrench_faults_box(faults, scenario.h).reading(control=boxes[-1].name if boxes else control))
    return boxes
