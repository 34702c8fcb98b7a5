"""The boxes of the vehicle: its plant, what makes its wrench and what pushes it about."""

import numpy as np

from ortilo_drake.loop.element import Box
from ortilo_drake.model.signals import N_X
from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.truth import ForceTruth, VehicleTruth
from ortilo_drake.world.faults.vehicle_faults import force_faults_box, force_table, wrench_faults_box, wrench_table
from ortilo_drake.world.slow_error import gauss_markov
from ortilo_drake.world.vehicle.continuous import continuous_boxes
from ortilo_drake.world.vehicle.disturbance import disturbance_box, drag_box, lasting_force_box
from ortilo_drake.world.vehicle.quadrotor import acceleration_box, felt_box, plant_box
from ortilo_drake.world.vehicle.wrench_error import wrench_error_box


def vehicle_boxes(scenario: Scenario, r_0: np.ndarray, control: str, needs_forces: bool) -> list[Box]:
    """Return the plant, `plant`, and all that acts on it.

    Args:
        scenario: the scenario.
        r_0: where it hovers at first, p_WB (3) [m].
        control: the box that says the control as it reaches the rotors.
        needs_forces: whether a sensor reads the forces on the body up to this tick, `felt`, and its `acceleration`.
    """
    x_0 = np.zeros(N_X)
    x_0[0:3], x_0[5] = r_0, scenario.yaw
    pushing = disturbance_boxes(scenario)
    acting = [] if rotors_lag(scenario) else wrench_changes(scenario, scenario.h, control)
    acts, pushes = acting[-1].name if acting else control, pushing[-1].name
    if scenario.world.plant == "sampled" and not scenario.faster_sensors:
        plant = [plant_box(scenario.vehicle, scenario.world.kinematics, x_0, scenario.h)]
    else:
        plant = continuous_boxes(scenario, x_0, scenario.imu_samples, needs_forces)
    moving = plant[0].with_inputs(control=acts, disturbance=pushes)
    boxes = [*pushing, *acting, moving, *plant[1:]]
    if needs_forces:
        felt, moved = felt_box(scenario.vehicle), acceleration_box(scenario.vehicle, scenario.world.kinematics)
        boxes.append(felt.with_inputs(control=acts, disturbance=pushes))
        boxes.append(moved.with_inputs(state="plant", control=felt_control(scenario), disturbance="felt.disturbance"))
    return boxes


def felt_control(scenario: Scenario) -> str:
    """Return the name of the control as it acted on the body up to this tick."""
    return "rotors_felt" if rotors_lag(scenario) else "felt.control"


def disturbance_boxes(scenario: Scenario) -> list[Box]:
    """Return the boxes of the disturbance; the last one gives it, and may read the true state, `plant`."""
    boxes = [disturbance_box(scenario.world.disturbance, scenario.h)]
    lasting, faults = scenario.truth.force, force_table(scenario.faults)
    if lasting != ForceTruth():
        noise = gauss_markov(np.array([*[lasting.gust_sd] * 3, 0.0, 0.0, 0.0]), lasting.gust_time, scenario.h)
        boxes.append(lasting_force_box(noise, scenario.h).with_inputs(disturbance=boxes[-1].name))
    if faults.kinds.size:
        boxes.append(force_faults_box(faults, scenario.h).with_inputs(disturbance=boxes[-1].name))
    if any(scenario.world.drag):
        boxes.append(drag_box(scenario.world.drag).with_inputs(disturbance=boxes[-1].name, state="plant"))
    return boxes


def rotors_lag(scenario: Scenario) -> bool:
    """Return whether the rotors have dynamics; what changes their wrench is then behind them (continuous.py)."""
    return scenario.world.rotors.kind == "first_order"


def wrench_changes(scenario: Scenario, h: float, control: str) -> list[Box]:
    """Return the boxes that change a control on its way to the body, in order, at ticks of h [s]."""
    boxes, faults = list[Box](), wrench_table(scenario.faults, scenario.vehicle)
    if scenario.truth.vehicle != VehicleTruth():
        boxes.append(wrench_error_box().with_inputs(control=control))
    if faults.kinds.size:
        boxes.append(wrench_faults_box(faults, h).with_inputs(control=boxes[-1].name if boxes else control))
    return boxes
