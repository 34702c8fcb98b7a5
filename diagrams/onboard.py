"""The onboard diagram: perception, the filter, the servo and the planner."""

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem, OutputPort
from pydrake.trajectories import Trajectory

from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import DETECTIONS_SIZE, N_XBAR
from ortilo_drake.onboard.detector.detector import Detector
from ortilo_drake.onboard.detector.detector_network import load_detector
from ortilo_drake.onboard.estimator.kalman_filter import KalmanFilter
from ortilo_drake.onboard.estimator.late_measurements import history_ticks
from ortilo_drake.onboard.estimator.measurement_handler import MeasurementHandler
from ortilo_drake.onboard.estimator.past_estimate import PastEstimate
from ortilo_drake.onboard.estimator.replay_kalman_filter import ReplayKalmanFilter
from ortilo_drake.onboard.landmarks.landmark_fix import LandmarkFix
from ortilo_drake.onboard.planner.planner import make_planner, plan
from ortilo_drake.onboard.ranging.multilateration import Multilateration
from ortilo_drake.onboard.servo.lq_gain import servo_gain
from ortilo_drake.onboard.servo.lq_servo import LqServo_, resting_integral
from ortilo_drake.scenario import Scenario


def initial_estimate(scenario: Scenario, r_0: np.ndarray) -> np.ndarray:
    """Return xbar_0 (15): hovering at r_0, with the integral at rest."""
    L = servo_gain(scenario.vehicle, scenario.servo.weights, scenario.h)
    xbar_0 = np.zeros(N_XBAR)
    xbar_0[0:3] = r_0
    xbar_0[5] = scenario.servo.yaw
    xbar_0[12:15] = resting_integral(L, r_0, scenario.servo.form)
    return xbar_0


def add_past_estimate(
    builder: DiagramBuilder, kalman: LeafSystem, sensor: str, size: int, scenario: Scenario
) -> PastEstimate:
    """Add what looks a sensor's late messages (of that size) up in the filter's history; its message is left open."""
    ticks = history_ticks(scenario.estimator.horizon, scenario.h)
    past = builder.AddSystem(PastEstimate(sensor, size, ticks, scenario.h))
    builder.Connect(kalman.GetOutputPort("estimate"), past.GetInputPort("present_estimate"))
    builder.Connect(kalman.GetOutputPort("covariance"), past.GetInputPort("present_covariance"))
    builder.Connect(kalman.GetOutputPort("history"), past.GetInputPort("history"))
    return past


def add_uwb(builder: DiagramBuilder, kalman: LeafSystem, room: Room, scenario: Scenario) -> OutputPort:
    """Add what turns uwb messages into fixes, about the estimate of their own tick where the filter replays."""
    multilateration = builder.AddSystem(Multilateration(scenario.multilateration, room.anchor_positions))
    message = multilateration.GetInputPort("uwb")
    uwb, about = builder.ExportInput(message, "uwb"), kalman
    if scenario.estimator.delay == "replay":
        about = add_past_estimate(builder, kalman, "uwb", message.size(), scenario)
        builder.ConnectInput(uwb, about.GetInputPort("message"))
    builder.Connect(about.GetOutputPort("estimate"), multilateration.GetInputPort("estimate"))
    return multilateration.get_output_port()


def add_camera(
    builder: DiagramBuilder, kalman: LeafSystem, room: Room, scenario: Scenario, detects: bool
) -> OutputPort:
    """Add what turns detections, or pictures where it detects, into fixes; as add_uwb."""
    fix, about = builder.AddSystem(LandmarkFix(scenario.landmark_fix, room, scenario.image_width)), kalman
    readers = [fix.GetInputPort("detections")]
    if scenario.estimator.delay == "replay":
        about = add_past_estimate(builder, kalman, "camera", DETECTIONS_SIZE, scenario)
        readers.append(about.GetInputPort("message"))
    if scenario.is_rendered and detects:
        camera = room.camera.scaled_to(scenario.camera.width)
        size = camera.width, camera.height
        detect = load_detector(scenario.detector, room, size)
        detector = builder.AddSystem(Detector(detect, size, scenario.camera.latency, scenario.h))
        builder.ExportInput(detector.GetInputPort("image"), "image")
        builder.ExportInput(detector.GetInputPort("shutter"), "shutter")
        for reader in readers:
            builder.Connect(detector.get_output_port(), reader)
    else:
        detections = builder.ExportInput(readers[0], "detections")
        for reader in readers[1:]:
            builder.ConnectInput(detections, reader)
    builder.Connect(about.GetOutputPort("estimate"), fix.GetInputPort("estimate"))
    builder.Connect(about.GetOutputPort("covariance"), fix.GetInputPort("covariance"))
    return fix.get_output_port()


def make_onboard(scenario: Scenario, trajectory: Trajectory | None = None, detects: bool = True) -> Diagram:
    """Return the onboard half as a Diagram.

    Ports:
        uwb, detections, imu: messages of the sensors that the scenario flies.
        image (ImageRgba8U), shutter: the picture of a rendered camera and its message, in place of detections.
        velocity: the true velocities, only where the scenario lends them to the servo.
        control (4, output): u_k, f_T absolute.
        estimate (15, output): xhat_{k|k-1}.
        covariance (225, output): P_k row by row.
        measurement (39, output): y, delta and V2 as they reach the filter in this tick, late ones included.
        reference (9, output): r, r_dot, r_ddot.

    Args:
        scenario: the scenario.
        trajectory: the path to fly (3 rows, W); by default what the scenario's planner plans.
        detects: whether the pictures of a rendered camera come here; if not, detections do.

    Raises:
        InputError: if there is no path or no servo gain, or if the detector's files are wrong.
    """
    room, h = scenario.load_room(), scenario.h
    trajectory = trajectory or plan(scenario.planner, room, scenario.vehicle)
    r_0 = trajectory.value(trajectory.start_time())[:, 0]

    builder = DiagramBuilder()
    planner = builder.AddSystem(make_planner(trajectory))
    delay = scenario.estimator.delay
    handler = builder.AddSystem(
        MeasurementHandler(scenario.estimator.gates, scenario.estimator.V, h, scenario.sensors, delay)
    )
    xbar_0 = initial_estimate(scenario, r_0)
    Filter = ReplayKalmanFilter if delay == "replay" else KalmanFilter
    kalman = builder.AddSystem(Filter(scenario.estimator, scenario.vehicle, scenario.estimator.integrator, xbar_0, h))
    servo = builder.AddSystem(LqServo_[float](scenario.servo, scenario.vehicle, h))
    estimate, covariance = kalman.GetOutputPort("estimate"), kalman.GetOutputPort("covariance")

    if "uwb" in scenario.sensors:
        builder.Connect(add_uwb(builder, kalman, room, scenario), handler.GetInputPort("uwb"))
    if "camera" in scenario.sensors:
        builder.Connect(add_camera(builder, kalman, room, scenario, detects), handler.GetInputPort("camera"))
    if "imu" in scenario.sensors:
        builder.ExportInput(handler.GetInputPort("imu"), "imu")
    if scenario.servo.velocities == "truth":
        builder.ExportInput(servo.GetInputPort("velocity"), "velocity")
    if handler.HasInputPort("estimate"):  # it gates
        builder.Connect(estimate, handler.GetInputPort("estimate"))
        builder.Connect(covariance, handler.GetInputPort("covariance"))
    if delay == "replay":
        builder.Connect(handler.GetOutputPort("stamps"), kalman.GetInputPort("stamps"))
    builder.Connect(handler.GetOutputPort("measurement"), kalman.GetInputPort("measurement"))
    builder.Connect(servo.get_output_port(), kalman.GetInputPort("control"))
    builder.Connect(planner.get_output_port(), kalman.GetInputPort("reference"))
    builder.Connect(estimate, servo.GetInputPort("estimate"))
    builder.Connect(planner.get_output_port(), servo.GetInputPort("reference"))
    builder.ExportOutput(servo.get_output_port(), "control")
    builder.ExportOutput(estimate, "estimate")
    builder.ExportOutput(covariance, "covariance")
    builder.ExportOutput(handler.GetOutputPort("measurement"), "measurement")
    builder.ExportOutput(planner.get_output_port(), "reference")
    onboard = builder.Build()
    onboard.set_name("onboard")
    return onboard
