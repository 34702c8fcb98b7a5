"""The boxes of the world: the vehicle, its sensors and their links."""

from typing import Any

import numpy as np
from pydrake.systems.framework import System

from ortilo_drake.diagrams.wiring.systems import system_box
from ortilo_drake.loop.diagram import system_of
from ortilo_drake.loop.element import Box, constant, outside
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.model.parts import find_part
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import N_U, N_X, PAYLOAD, SENSORS
from ortilo_drake.onboard.estimator.imu_rows import imu_variances
from ortilo_drake.onboard.planner.planned import BUILT_IN
from ortilo_drake.scenario import CommandLink, IntermittentFilter, LqServo, Scenario
from ortilo_drake.scenario.truth import ClockTruth, ForceTruth, VehicleTruth
from ortilo_drake.sensors.described import described
from ortilo_drake.world.drawn_truth import check_size
from ortilo_drake.world.faults.fault_element import asked_box, fault_boxes
from ortilo_drake.world.faults.table import message_faults
from ortilo_drake.world.faults.vehicle_faults import force_faults_box, force_table, wrench_faults_box, wrench_table
from ortilo_drake.world.noise import gauss_markov
from ortilo_drake.world.radio.command_link import command_link_box
from ortilo_drake.world.radio.link import delivery_box, is_late, link_box
from ortilo_drake.world.sensors.own_sensor import own_sensor_box
from ortilo_drake.world.sensors.sample_collector import SampleCollector
from ortilo_drake.world.sensors.sensor_clock import clock_box, clock_inside_box
from ortilo_drake.world.sensors.sensor_errors import errors_box, errors_of
from ortilo_drake.world.sensors.true_velocity import shutter_box, velocity_box
from ortilo_drake.world.vehicle.acted_report import now_box, report_box
from ortilo_drake.world.vehicle.continuous import continuous_boxes
from ortilo_drake.world.vehicle.disturbance import disturbance_box, drag_box, lasting_force_box
from ortilo_drake.world.vehicle.quadrotor import acceleration_box, felt_box, plant_box
from ortilo_drake.world.vehicle.rotors import wrench_error_box


def world_boxes(
    scenario: Scenario, room: Room, r_0: np.ndarray, whole_imu: bool = False
) -> tuple[list[Box], dict[str, Box]]:
    """Return the boxes of the world, and which of them says each sensor's message as it lands.

    They read the control (4) of a box `servo`.

    Args:
        scenario: the scenario.
        room: as it was surveyed.
        r_0: where the vehicle hovers at first, p_WB (3) [m].
        whole_imu: whether all of the imu's message is asked for; else only what the estimator reads of it.
    """
    h, hover, control, stamp, boxes = scenario.h, scenario.vehicle.hover_thrust, "servo", "now", list[Box]()
    if scenario.command_link != CommandLink():
        boxes.append(command_link_box(scenario.command_link, hover, h).with_inputs(control="servo"))
        control, stamp = "command_link.applied", "command_link.stamp"
    boxes += vehicle_boxes(scenario, r_0, control, needs_forces(scenario, whole_imu))
    if scenario.commands.are_reported:
        report = report_box(hover, h).with_inputs(control=control, stamp=stamp)
        boxes += [*([now_box(h)] if stamp == "now" else []), report, *report_link_boxes(scenario, report)]
    sensing, messages = sensors_boxes(scenario, room, whole_imu)
    return [*boxes, *sensing], messages


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
        plant = continuous_boxes(scenario, x_0, needs_forces)
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


def sensors_boxes(scenario: Scenario, room: Room, whole_imu: bool) -> tuple[list[Box], dict[str, Box]]:
    """Return the boxes of the sensors and their links, and which of them says each sensor's message as it lands.

    They read `plant`, the true state, and where a sensor asks for it `felt`; arguments as of world_boxes.
    """
    boxes, messages = list[Box](), dict[str, Box]()
    if scenario.lends_velocities:
        boxes.append(velocity_box(scenario.h).with_inputs(state="plant"))
    for name in scenario.measurement.sensors:
        if name in scenario.sensors:
            own = sensor_boxes(scenario, room, name, whole_imu)
            boxes += own
            messages[name] = own[-1]
    return boxes, messages


def report_link_boxes(scenario: Scenario, report: Box) -> list[Box]:
    """Return the link of the report of what acted; `acted_delivered` says it as it lands."""
    settings, h = scenario.report_link, scenario.h
    link = link_box("acted", settings, settings.every(h), h).with_inputs(state="plant")
    return [link, delivery_box("acted", report, settings)]


def sensor_boxes(scenario: Scenario, room: Room, name: str, whole_imu: bool) -> list[Box]:
    """Return a sensor with its clock, errors, faults and link; the last box says its message as it lands."""
    settings, h, samples = scenario.link_of(name), scenario.h, scenario.samples(name)
    if not scenario.is_picture(name):  # from picture to boxes it takes the projected camera's latency besides
        settings = settings.model_copy(update={"delay": settings.delay + scenario.latency_of(name)})
    faults = [] if scenario.is_picture(name) else message_faults(scenario.faults, name)
    link = link_box(name, settings, scenario.every(name), h).with_inputs(state="plant")
    asked, clocks = asked_box(name, faults, samples, h), list[Box]()
    seen, passed = "plant", "vehicle.passed"
    if not described(name).is_wired and scenario.truth.clock != ClockTruth():
        clocks.append(clock_box(name, h).with_inputs(state=seen))
        if samples > 1 and not is_system(scenario, name):
            clocks.append(clock_inside_box(name, scenario.instants, h).with_inputs(passed=passed))
            passed = clocks[-1].name
        seen = clocks[0].name
    sensor = source_box(scenario, room, name, seen, whole_imu)
    if sensor.system is None:
        sensor = sensor.with_inputs(state=seen, passed=passed, sent=link.name if asked is None else asked.name)
    each = 1 if sensor.system is not None else samples  # a System gives its samples one by one
    said, payload = [sensor], (sensor.size - PAYLOAD) // each - (PAYLOAD if each > 1 else 0)
    if name in dict(scenario.truth.sensors):
        check_size(name, dict(scenario.truth.sensors)[name], payload)
    after_sensor = described(name).after_sensor
    changed = None if after_sensor is None else after_sensor(scenario, room, sensor, each)
    if changed is not None:
        said.append(changed.with_inputs(state=seen))
    errors = None if scenario.is_picture(name) else errors_of(scenario, name, payload)
    if errors is not None:
        said.append(errors_box(name, said[-1], errors, each, h))
    changing = fault_boxes(name, said[-1], faults, room.anchor_positions, each, scenario.sampled_for(name).h)
    said += [box.with_inputs(state=seen) for box in changing]
    if samples > each:
        collector = SampleCollector(name, said[-1].size, samples, h)
        signals = {"sample": (said[-1].name, said[-1].size)}
        said.append(system_box(f"{name}_samples", collector, (name,), signals))
    before = [*([] if asked is None else [asked]), *clocks]
    lands = is_late(settings) or asked is not None or sensor.system is not None
    return [link, *before, *said, *([delivery_box(name, said[-1], settings)] if lands else [])]


def source_box(scenario: Scenario, room: Room, name: str, seen: str, whole_imu: bool) -> Box:
    """Return the box of a sensor's message as it is sent; it reads `sent` and the state as the sensor sees it.

    A System of one's own says it in every tick.
    """
    if scenario.is_picture(name):
        return shutter_box(scenario.h)
    if is_system(scenario, name):
        system = sensor_system(scenario.sampled_for(name), room, name)
        signals = {"state": (seen, N_X), "control": (felt_control(scenario), N_U)}
        signals |= {"disturbance": ("felt.disturbance", 6)}
        return system_box(name, system, (system.get_output_port().get_name(),), signals)
    return sensor_element(scenario, room, name, whole_imu)


def sensor_element(scenario: Scenario, room: Room, name: str, whole: bool) -> Box:
    """Return the box of the message of a sensor that is an element, all of it or the part that the estimator reads."""
    its = described(name)
    if its.compiled is not None:
        return own_sensor_box(name, its.compiled, scenario, room)
    assert its.element is not None
    box: Box = its.element(scenario, room, whole or reads_whole_imu(scenario))
    return box


def sensor_system(scenario: Scenario, room: Room, name: str) -> System:
    """Return the System of a sensor's message, at the times of the ticks of its own clock."""
    if not is_element(name):
        make: Any = described(name).make_world
        made: System = make(scenario, room)
        return made
    sensor = sensor_element(scenario, room, name, whole=True).with_inputs(state="state", sent="always")
    return system_of(Wiring([outside("state", N_X), constant("always", 0.0), sensor]), scenario.h, scenario.seed)


def is_system(scenario: Scenario, name: str) -> bool:
    """Return whether a System plays a sensor: it has no compiled share, or a fault of one's own takes its samples.

    Such a fault changes one sample after the other; the imu, which is never a System, refuses it.
    """
    faults = message_faults(scenario.faults, name) if scenario.samples(name) > 1 and name not in SENSORS else []
    return not is_element(name) or any(find_part("fault", its.fault.kind) for its in faults)


def is_element(name: str) -> bool:
    """Return whether a sensor is an element, built in or by its compiled share."""
    return described(name).element is not None or described(name).compiled is not None


def needs_forces(scenario: Scenario, whole_imu: bool) -> bool:
    """Return whether a sensor asks for what acts on the body."""
    felt = whole_imu or reads_whole_imu(scenario) or scenario.imu.ahrs is not None
    return any((felt and described(name).needs_forces) or is_system(scenario, name) for name in scenario.sensors)


def reads_whole_imu(scenario: Scenario) -> bool:
    """Return whether more of the imu than its angles may be read."""
    own = not isinstance(scenario.servo, LqServo) or not isinstance(scenario.planner, BUILT_IN)
    own = own or not isinstance(scenario.estimator, IntermittentFilter)
    return own or scenario.imu_samples > 1 or imu_variances(scenario) is not None
