"""From a scenario to the constants of its compiled flight."""

import numpy as np

from ortilo_drake.diagrams.onboard import initial_estimate
from ortilo_drake.flight.compiled.boxes import METHODS
from ortilo_drake.flight.compiled.constants import (
    CameraConstants,
    FilterConstants,
    FlightConstants,
    ImuConstants,
    LinkConstants,
    ServoConstants,
    UwbConstants,
    VehicleConstants,
)
from ortilo_drake.flight.flyable import flight_ticks
from ortilo_drake.flight.lost import bounds_of
from ortilo_drake.model.clock import history_ticks
from ortilo_drake.model.equations import KINEMATICS
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import FIX_SIZE, IMU_SIZE, N_X, N_XBAR, PAYLOAD
from ortilo_drake.onboard.estimator.extra_states import augmented_rows, extra_states
from ortilo_drake.onboard.estimator.filter_model import augmented_model, initial_covariance
from ortilo_drake.onboard.estimator.imu_rows import imu_variances
from ortilo_drake.onboard.estimator.late_measurements import slot_of
from ortilo_drake.onboard.estimator.measurement_handler import incoming_of
from ortilo_drake.onboard.landmarks.box_fix import box_belief, prior_covariance
from ortilo_drake.onboard.planner.planned import path_of, start_of
from ortilo_drake.onboard.planner.planner import make_planner
from ortilo_drake.onboard.ranging.multilateration import believed_noise
from ortilo_drake.onboard.servo.lq_gain import servo_gain
from ortilo_drake.scenario import CommandLink, Commands, IntermittentFilter, LqServo, Scenario, Truth
from ortilo_drake.scenario.loss_chain import loss_parameters
from ortilo_drake.sensors.described import as_known, flown
from ortilo_drake.world.noise import stream_id
from ortilo_drake.world.radio.link import blackout_rows, steps_a_chain
from ortilo_drake.world.sensors.landmark_view import surroundings
from ortilo_drake.world.sensors.projected_camera import noise_streams, tables_of
from ortilo_drake.world.sensors.uwb import ranging_settings, walls_between

COMPILED_SENSORS = ("uwb", "camera", "imu")


def why_not(scenario: Scenario) -> str | None:
    """Return why a scenario cannot be flown compiled, naming the field, and None where it can."""
    own = [name for name in scenario.sensors if name not in COMPILED_SENSORS]
    settings = scenario.estimator
    if own:
        return f"sensors: {own[0]}: has no compiled form"
    if scenario.faster_sensors:
        return f"{scenario.faster_sensors[0]}.link.rate: is faster than the tick"
    if not isinstance(settings, IntermittentFilter):
        return f"estimator.kind: {settings.kind}: has no compiled form"
    if settings.robust is not None:
        return "estimator.robust: has no compiled form"
    if scenario.multilateration.exclude is not None:
        return "multilateration.exclude: has no compiled form"
    if scenario.is_rendered:
        return "camera.kind: rendered: has no compiled form"
    if "camera" in scenario.sensors and scenario.landmark_fix.method not in METHODS:
        return f"landmark_fix.method: {scenario.landmark_fix.method}: has no compiled form"
    if not isinstance(scenario.servo, LqServo):
        return f"servo.kind: {scenario.servo.kind}: has no compiled form"
    if scenario.commands != Commands() or scenario.command_link != CommandLink():
        return "command_link, commands: late or lost commands have no compiled form"
    if scenario.world.plant != "sampled":
        return f"world.plant: {scenario.world.plant}: has no compiled form"
    if scenario.truth != Truth() or scenario.faults:
        return "truth, faults: a world that differs from what is believed has no compiled form"
    return None


def constants_of(scenario: Scenario) -> FlightConstants:
    """Return what decides the compiled flights of a scenario that why_not has nothing against.

    Raises:
        InputError: if there is no path or no servo gain.
    """
    vehicle, h, room = scenario.vehicle, scenario.h, scenario.load_room()
    path, ticks = path_of(scenario), flight_ticks(scenario)
    planner = make_planner(path)
    context = planner.CreateDefaultContext()
    reference = np.empty((ticks + 1, 9))
    for k in range(ticks + 1):
        context.SetTime(k * h)
        reference[k] = planner.get_output_port().Eval(context)
    disturbance = scenario.world.disturbance
    return FlightConstants(
        h,
        reference,
        scenario.yaw,
        VehicleConstants(
            vehicle.mass,
            np.array(vehicle.inertia),
            KINEMATICS.index(scenario.world.kinematics),
            vehicle.hover_thrust,
            disturbance.force_sd,
            disturbance.torque_sd,
            stream_id("disturbance"),
        ),
        _imu(scenario),
        _uwb(scenario, room),
        _camera(scenario, room) if "camera" in scenario.sensors else None,
        _filter(scenario, room, start_of(path)),
        ServoConstants(
            servo_gain(vehicle, scenario.servo.weights, h),
            vehicle.mass,
            scenario.servo.yaw,
            scenario.servo.form == "error",
            scenario.lends_velocities,
        ),
        bounds_of(room, vehicle),
    )


def _link(scenario: Scenario, sensor: str, latency: int = 0) -> LinkConstants:
    settings = scenario.link_of(sensor)
    return LinkConstants(
        scenario.every(sensor) if sensor in scenario.sensors else 0,
        loss_parameters(settings.loss, scenario.h),
        steps_a_chain(settings),
        blackout_rows(settings, scenario.h),
        (settings.delay + latency, settings.random_delay),
        stream_id(f"link/{sensor}"),
    )


def _imu(scenario: Scenario) -> ImuConstants:
    settings = scenario.imu
    sd = np.array([settings.angle_sd, settings.rate_sd, settings.specific_force_sd])
    whole = imu_variances(scenario) is not None
    return ImuConstants(whole, np.zeros(9), sd, stream_id("imu"), _link(scenario, "imu"))


def _uwb(scenario: Scenario, room: Room) -> UwbConstants:
    settings = scenario.multilateration
    return UwbConstants(
        room.anchor_positions,
        np.zeros(len(room.anchors)),
        walls_between(scenario.uwb, room),
        ranging_settings(scenario.uwb),
        stream_id("uwb"),
        _link(scenario, "uwb"),
        room.anchor_positions,
        believed_noise(settings),
        settings.method == "nearest_three",
    )


def _camera(scenario: Scenario, room: Room) -> CameraConstants:
    settings, fix = scenario.camera, scenario.landmark_fix
    prior = prior_covariance(fix)
    streams, false_stream = noise_streams(room)
    return CameraConstants(
        surroundings(room),
        room.landmark_labels,
        room.camera.scaled_to(settings.width).constants,
        tables_of(settings, room, scenario.h),
        streams,
        false_stream,
        _link(scenario, "camera", settings.latency),
        box_belief(fix, as_known(scenario, room), scenario.image_width),
        METHODS.index(fix.method),
        len(fix.rows),
        np.zeros(0) if prior is None else prior,
        fix.joint is not None,
    )


def _filter(scenario: Scenario, room: Room, r_0: np.ndarray) -> FilterConstants:
    settings, measurement, vehicle, h = scenario.estimator, scenario.measurement, scenario.vehicle, scenario.h
    extras = extra_states(settings, vehicle, h, scenario.flown_rows)
    P_0 = initial_covariance(settings, extras)
    xbar_0 = initial_estimate(scenario, r_0)
    sensors = [flown(name, scenario) for name in measurement.sensors if name in scenario.sensors]
    camera = PAYLOAD + len(scenario.landmark_fix.rows) + len(scenario.landmark_fix.rows) ** 2
    handed = {"uwb": FIX_SIZE, "camera": camera, "imu": IMU_SIZE}
    sizes = {s.name: handed[s.name] for s in sensors}
    V = {name: flown(name, scenario).V(scenario) for name in measurement.sensors}
    incoming = incoming_of(measurement, sizes, V, dict(settings.gates))
    starts = dict(zip(measurement.sensors, incoming.start.tolist(), strict=True))
    variances, augmented = imu_variances(scenario), augmented_rows(measurement.rows, extras)
    return FilterConstants(
        incoming,
        max(sum(sizes.values()), 1),
        (starts["uwb"], starts["imu"], starts["camera"]),
        measurement.layout,
        settings.delay == "drop",
        augmented_model(settings, vehicle, settings.integrator, h, extras),
        augmented.layout,
        measurement.sensors.index("imu"),
        np.zeros(0) if variances is None else variances,
        np.concatenate((xbar_0[:N_X], np.zeros(len(P_0) - N_XBAR), xbar_0[N_X:], P_0.ravel())),
        bool(extras),
        slot_of(augmented, len(P_0)) if settings.delay == "replay" else None,
        history_ticks(settings.horizon, h),
    )
