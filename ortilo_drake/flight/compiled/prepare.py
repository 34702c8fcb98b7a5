"""From a scenario to the constants of its compiled flight."""

from typing import Any

import numpy as np

from ortilo_drake.diagrams.faults import check_room
from ortilo_drake.diagrams.onboard import initial_estimate
from ortilo_drake.flight.compiled.boxes import METHODS
from ortilo_drake.flight.compiled.constants import FlightConstants, VehicleConstants
from ortilo_drake.flight.compiled.constants_onboard import FilterConstants, OwnConstants, ServoConstants, TightConstants
from ortilo_drake.flight.compiled.faults import VehicleFaults
from ortilo_drake.flight.compiled.own import remember_estimator
from ortilo_drake.flight.compiled.prepare_sensors import (
    camera_of,
    imu_of,
    others_of,
    uwb_of,
)
from ortilo_drake.flight.compiled.robust import RobustConstants
from ortilo_drake.flight.compiled.slow import NO_ERRORS
from ortilo_drake.flight.flyable import flight_ticks
from ortilo_drake.flight.lost import bounds_of
from ortilo_drake.model.clock import history_ticks
from ortilo_drake.model.equations import KINEMATICS
from ortilo_drake.model.measurement import Measurement
from ortilo_drake.model.parts import CompiledEstimator, find_part
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import DETECTIONS_SIZE, FIX_SIZE, IMU_SIZE, N_U, N_X, N_XBAR, PAYLOAD
from ortilo_drake.model.vehicle import mixing_inverse, mixing_matrix
from ortilo_drake.onboard.estimator.extra_states import augmented_rows, extra_states, names_of
from ortilo_drake.onboard.estimator.filter_model import augmented_model, initial_covariance
from ortilo_drake.onboard.estimator.imu_rows import imu_variances
from ortilo_drake.onboard.estimator.late_measurements import slot_of
from ortilo_drake.onboard.estimator.measurement_handler import incoming_of, oldest_used
from ortilo_drake.onboard.estimator.robust.system import opening_variances
from ortilo_drake.onboard.estimator.robust.weights import first_state, weighing_of
from ortilo_drake.onboard.estimator.tight.model import aids_of, first_states, layout_of, motion_of
from ortilo_drake.onboard.estimator.tight.model import initial_covariance as initial_covariance_of_tight
from ortilo_drake.onboard.estimator.tight.watch import LAST
from ortilo_drake.onboard.planner.planned import path_of, start_of
from ortilo_drake.onboard.planner.planner import make_planner
from ortilo_drake.onboard.ranging.fault_exclusion import consistency_of
from ortilo_drake.onboard.servo.lq_gain import servo_gain
from ortilo_drake.scenario import CommandLink, Commands, IntermittentFilter, LqServo, Scenario
from ortilo_drake.scenario.robust import Robust
from ortilo_drake.scenario.tight import TightFilter
from ortilo_drake.sensors.described import described, flown
from ortilo_drake.sensors.shares import handed_size
from ortilo_drake.world.faults.vehicle_faults import force_table, wrench_table
from ortilo_drake.world.noise import stream_id
from ortilo_drake.world.vehicle.continuous import steps_a_tick


def why_not(scenario: Scenario) -> str | None:
    """Return why a scenario cannot be flown compiled, naming the field, and None where it can."""
    settings, others = scenario.estimator, scenario.own_sensors
    is_tight = isinstance(settings, TightFilter)
    own = [name for name in others if described(name).compiled is None]
    if own:
        return f"sensors: {own[0]}: has no compiled form"
    if others and not isinstance(settings, IntermittentFilter):
        return f"sensors: {others[0]}: has no compiled form with estimator.kind {settings.kind}"
    faster = [name for name in scenario.faster_sensors if not (is_tight and name == "imu")]
    if faster:
        return f"{faster[0]}.link.rate: is faster than the tick"
    if not (is_tight or isinstance(settings, IntermittentFilter) or _share_of(settings)):
        return f"estimator.kind: {settings.kind}: has no compiled form"
    if scenario.is_rendered:
        return "camera.kind: rendered: has no compiled form"
    if "camera" in scenario.sensors and not is_tight and scenario.landmark_fix.method not in METHODS:
        return f"landmark_fix.method: {scenario.landmark_fix.method}: has no compiled form"
    if not isinstance(scenario.servo, LqServo):
        return f"servo.kind: {scenario.servo.kind}: has no compiled form"
    if scenario.commands != Commands() or scenario.command_link != CommandLink():
        return "command_link, commands: late or lost commands have no compiled form"
    return None


def constants_of(scenario: Scenario) -> FlightConstants:
    """Return what decides the compiled flights of a scenario that why_not has nothing against.

    The world is as it is believed to be; truth.py has what each seed's differs by.

    Raises:
        InputError: if there is no path or no servo gain, or if a fault concerns what is not there.
    """
    vehicle, h, room = scenario.vehicle, scenario.h, scenario.load_room()
    check_room(scenario, room)
    path, ticks = path_of(scenario), flight_ticks(scenario)
    planner = make_planner(path)
    context = planner.CreateDefaultContext()
    reference = np.empty((ticks + 1, 9))
    for k in range(ticks + 1):
        context.SetTime(k * h)
        reference[k] = planner.get_output_port().Eval(context)
    r_0, x_0 = start_of(path), np.zeros(N_X)
    x_0[0:3], x_0[5] = r_0, scenario.yaw
    estimator = _estimator(scenario, room, r_0)
    return FlightConstants(
        h,
        reference,
        x_0,
        _vehicle(scenario),
        NO_ERRORS,
        imu_of(scenario),
        NO_ERRORS,
        uwb_of(scenario, room),
        NO_ERRORS,
        camera_of(scenario, room) if "camera" in scenario.sensors else None,
        others_of(scenario, room, estimator.incoming.start) if isinstance(estimator, FilterConstants) else (),
        estimator,
        ServoConstants(
            servo_gain(vehicle, scenario.servo.weights, h, scenario.yaw),
            vehicle.mass,
            scenario.servo.yaw,
            scenario.servo.form == "error",
            scenario.lends_velocities,
        ),
        bounds_of(room, vehicle),
    )


def _vehicle(scenario: Scenario) -> VehicleConstants:
    vehicle, world = scenario.vehicle, scenario.world
    has_rotors = world.rotors.kind == "first_order"
    sampled = world.plant == "sampled" and not scenario.faster_sensors
    return VehicleConstants(
        vehicle.mass,
        np.array(vehicle.inertia),
        KINEMATICS.index(world.kinematics),
        vehicle.hover_thrust,
        None if sampled else scenario.h / steps_a_tick(scenario),
        np.eye(N_U),
        np.array(vehicle.hover_rotor_speeds, dtype=float) if has_rotors else np.zeros(0),
        mixing_matrix(vehicle),
        np.ascontiguousarray(mixing_inverse(vehicle)),
        vehicle.rotor_max_speed,
        np.array(vehicle.rotor_time_constant),
        world.disturbance.force_sd,
        world.disturbance.torque_sd,
        stream_id("disturbance"),
        VehicleFaults(wrench_table(scenario.faults, vehicle), force_table(scenario.faults))
        if scenario.faults
        else None,
    )


def _share_of(settings: Any) -> CompiledEstimator | None:
    """Return the compiled share of an estimator of one's own, by its settings; None if it has none."""
    found = find_part("estimator", settings.kind)
    return None if found is None else found.compiled


def _estimator(scenario: Scenario, room: Room, r_0: np.ndarray) -> FilterConstants | TightConstants | OwnConstants:
    if isinstance(scenario.estimator, TightFilter):
        return _tight(scenario, room, r_0)
    share = None if isinstance(scenario.estimator, IntermittentFilter) else _share_of(scenario.estimator)
    if share is None:
        return _filter(scenario, room, r_0)
    numbers = share.numbers(scenario.belief, initial_estimate(scenario, r_0))
    remember_estimator(numbers, share)
    return OwnConstants(scenario.measurement.layout, numbers, share.first(numbers))


def _filter(scenario: Scenario, room: Room, r_0: np.ndarray) -> FilterConstants:
    settings, measurement, vehicle, h = scenario.estimator, scenario.measurement, scenario.vehicle, scenario.h
    extras = extra_states(settings, vehicle, h, scenario.flown_rows, scenario.yaw)
    P_0 = initial_covariance(settings, extras)
    xbar_0 = initial_estimate(scenario, r_0)
    sensors = [flown(name, scenario) for name in measurement.sensors if name in scenario.sensors]
    camera = PAYLOAD + len(scenario.landmark_fix.rows) + len(scenario.landmark_fix.rows) ** 2
    handed = {"uwb": FIX_SIZE, "camera": camera, "imu": IMU_SIZE}
    sizes = {s.name: handed[s.name] if s.name in handed else handed_size(s.name) for s in sensors}
    V = {name: flown(name, scenario).V(scenario) for name in measurement.sensors}
    oldest = oldest_used(settings.delay, settings.horizon, h)
    incoming = incoming_of(measurement, sizes, V, dict(settings.gates), oldest)
    starts = dict(zip(measurement.sensors, incoming.start.tolist(), strict=True))
    exclude = scenario.multilateration.exclude
    variances, augmented = imu_variances(scenario), augmented_rows(measurement.rows, extras)
    return FilterConstants(
        incoming,
        max(sum(sizes.values()), 1),
        (starts["uwb"], starts["imu"], starts["camera"]),
        measurement.layout,
        settings.delay != "ignore",
        augmented_model(settings, vehicle, settings.integrator, h, extras, scenario.yaw),
        augmented.layout,
        measurement.sensors.index("imu"),
        np.zeros(0) if variances is None else variances,
        np.concatenate((xbar_0[:N_X], np.zeros(len(P_0) - N_XBAR), xbar_0[N_X:], P_0.ravel())),
        bool(extras),
        slot_of(augmented, len(P_0)) if settings.delay == "replay" else None,
        history_ticks(settings.horizon, h),
        None if exclude is None else consistency_of(exclude, len(room.anchors)),
        _robust(settings.robust, augmented, names_of(extras), len(measurement.sensors)),
    )


def _robust(settings: Robust | None, seen: Measurement, extra: tuple[str, ...], sensors: int) -> RobustConstants | None:
    if settings is None:
        return None
    late = [seen.sensors.index(name) for name in ("uwb", "camera")]
    state, last_seen, _ = first_state(sensors)
    return RobustConstants(
        weighing_of(settings, seen, sensors),
        opening_variances(settings.opening, extra),
        np.inf if settings.stuck is None else float(settings.stuck),
        (late[0], late[1]),
        state,
        last_seen,
    )


def _tight(scenario: Scenario, room: Room, r_0: np.ndarray) -> TightConstants:
    """Return the tight filter, as diagrams/tight_estimator.py has it."""
    belief = scenario.belief
    settings: Any = belief.estimator
    sensors = tuple(name for name in belief.measurement.sensors if name in belief.sensors)
    layout = layout_of(settings, room, sensors, belief.h)
    motion, C_0 = motion_of(settings, layout, belief), initial_covariance_of_tight(settings, layout)
    xbar_0 = initial_estimate(belief, r_0)
    numbers = [belief.measurement.sensors.index(name) if name in sensors else -1 for name in ("uwb", "imu", "camera")]
    payloads = {"uwb": 2 * len(room.anchors), "camera": DETECTIONS_SIZE - PAYLOAD}
    watched = LAST + sum(size for name, size in payloads.items() if name in sensors)
    x, kept, ahead = first_states(layout, motion, C_0, xbar_0)
    return TightConstants(
        belief.measurement.layout,
        (numbers[0], numbers[1], numbers[2]),
        scenario.samples("imu") if "imu" in sensors else 1,
        layout,
        motion,
        aids_of(settings, room, belief),
        x,
        np.ascontiguousarray(C_0),
        kept,
        ahead,
        watched,
    )
