"""The boxes of the world: the vehicle, its sensors and their links."""

from pydrake.trajectories import Trajectory

from ortilo_drake.diagrams.wiring.vehicle import vehicle_boxes
from ortilo_drake.loop.element import Box
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import PAYLOAD
from ortilo_drake.onboard.estimator.imu_rows import imu_variances
from ortilo_drake.onboard.planner.planned import BUILT_IN
from ortilo_drake.scenario import CommandLink, IntermittentFilter, Link, LqServo, Scenario
from ortilo_drake.scenario.truth import ClockTruth
from ortilo_drake.sensors.shares import share_of
from ortilo_drake.world.faults.fault_element import asked_box, fault_boxes
from ortilo_drake.world.faults.scene_faults import message_faults
from ortilo_drake.world.radio.command_link import command_link_box
from ortilo_drake.world.radio.link import delivery_box, is_late, link_box
from ortilo_drake.world.sensors.imu import imu_box
from ortilo_drake.world.sensors.message_error import errors_box
from ortilo_drake.world.sensors.own_sensor import own_sensor_box
from ortilo_drake.world.sensors.projected_camera_element import camera_box
from ortilo_drake.world.sensors.sensor_clock import clock_box
from ortilo_drake.world.sensors.sensor_errors import errors_of
from ortilo_drake.world.sensors.uwb import uwb_box
from ortilo_drake.world.vehicle.acted_report import now_box, report_box


def world_boxes(scenario: Scenario, room: Room, path: Trajectory | Box) -> tuple[list[Box], dict[str, Box]]:
    """Return the boxes of the world, and which of them says each sensor's message as it lands."""
    commands, messages = command_boxes(scenario), dict[str, Box]()
    control = "command_link.applied" if commands else "servo"
    boxes = [*commands, *vehicle_boxes(scenario, path, control, reads_whole_imu(scenario))]
    if scenario.commands.are_reported:
        boxes += report_boxes(scenario, control)
    for name in scenario.measurement.sensors:
        if name in scenario.sensors:
            own = sensor_boxes(scenario, room, name)
            boxes += own
            messages[name] = own[-1]
    return boxes, messages


def command_boxes(scenario: Scenario) -> list[Box]:
    """Return what carries the commands to the rotors; nothing where that is perfect."""
    settings = scenario.command_link
    if settings == CommandLink():
        return []
    return [command_link_box(settings, scenario.vehicle.hover_thrust, scenario.h).reading(control="servo")]


def report_boxes(scenario: Scenario, control: str) -> list[Box]:
    """Return what tells which commands acted, with its link; `acted_delivered` is the report as it lands."""
    settings, h, perfect = scenario.report_link, scenario.h, control == "servo"
    stamp = "now" if perfect else "command_link.stamp"
    report = report_box(scenario.vehicle.hover_thrust, h).reading(control=control, stamp=stamp)
    link = link_box("acted", settings, settings.every(h), h).reading(state="plant")
    delivered = delivery_box("acted", report, settings)
    return [*([now_box(h)] if perfect else []), report, link, delivered]


def sensor_boxes(scenario: Scenario, room: Room, name: str) -> list[Box]:
    """Return a sensor with its clock, errors, faults and link; the last box says its message as it lands."""
    settings, h, samples = link_settings(scenario, name), scenario.h, scenario.samples(name)
    faults = message_faults(scenario.faults, name)
    link = link_box(name, settings, scenario.every(name), h).reading(state="plant")
    asked, clock = asked_box(name, faults, samples, h), None
    if name != "imu" and scenario.truth.clock != ClockTruth():  # the imu's is the onboard computer's
        clock = clock_box(name, h).reading(state="plant")
    seen = "plant" if clock is None else clock.name
    sensor = source_box(scenario, room, name).reading(state=seen, sent=link.name if asked is None else asked.name)
    changes, payload = [], (sensor.size - PAYLOAD) // samples - (PAYLOAD if samples > 1 else 0)
    errors = errors_of(scenario.truth, name, payload, h)
    if errors is not None:
        changes.append(errors_box(name, sensor, errors, samples, h))
    said = changes[-1] if changes else sensor
    its_h = scenario.sampled_for(name).h
    boxes = fault_boxes(name, said, faults, room.anchor_positions, samples, its_h)
    changes += [box.reading(state=seen) for box in boxes]
    said = changes[-1] if changes else sensor
    before = [box for box in (asked, clock) if box is not None]
    landing = [delivery_box(name, said, settings)] if is_late(settings) or asked is not None else []
    return [link, *before, sensor, *changes, *landing]


def link_settings(scenario: Scenario, name: str) -> Link:
    """Return the settings of a sensor's link; from picture to boxes it takes the camera's latency besides."""
    settings = scenario.link_of(name)
    latency = scenario.camera.latency if name == "camera" else 0
    return settings.model_copy(update={"delay": settings.delay + latency})


def source_box(scenario: Scenario, room: Room, name: str) -> Box:
    """Return what says a sensor's message as it is sent: it reads `sent` and the state as the sensor sees it."""
    if name == "uwb":
        return uwb_box(scenario.uwb, room, scenario.h)
    if name == "imu":
        return inertial_box(scenario)
    if name == "camera":
        return camera_box(scenario.camera, room, scenario.faults, scenario.h)
    return own_sensor_box(name, share_of(name), scenario, room)


def reads_whole_imu(scenario: Scenario) -> bool:
    """Return whether more of the imu than its angles may be read."""
    own = not isinstance(scenario.servo, LqServo) or not isinstance(scenario.planner, BUILT_IN)
    return own or not isinstance(scenario.estimator, IntermittentFilter) or imu_variances(scenario) is not None


def inertial_box(scenario: Scenario) -> Box:
    """Return the imu."""
    whole = reads_whole_imu(scenario)
    imu = imu_box(scenario.imu, scenario.h, whole, scenario.vehicle.mass, scenario.samples("imu"))
    felt = "rotors_felt" if scenario.world.rotors.kind == "first_order" else "felt.control"
    return imu.reading(felt=felt, disturbance="felt.disturbance", passed="vehicle.passed")
