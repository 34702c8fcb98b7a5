"""What flies onboard: perception, the filter, the servo and the planner."""

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.trajectories import Trajectory

from ortilo_drake.model.signals import N_XBAR
from ortilo_drake.onboard.detector import Detector
from ortilo_drake.onboard.detector_network import load_detector
from ortilo_drake.onboard.kalman_filter import KalmanFilter
from ortilo_drake.onboard.landmark_fix import LandmarkFix
from ortilo_drake.onboard.lq_gain import servo_gain
from ortilo_drake.onboard.lq_servo import LqServo, resting_integral
from ortilo_drake.onboard.measurement_handler import MeasurementHandler
from ortilo_drake.onboard.multilateration import Multilateration
from ortilo_drake.onboard.planner import make_planner, plan
from ortilo_drake.scenario import Scenario


def initial_estimate(scenario: Scenario, r_0: np.ndarray) -> np.ndarray:
    """Return xbar_0 (15): hovering at r_0, with the integral at rest."""
    L = servo_gain(scenario.vehicle, scenario.servo.weights, scenario.h)
    xbar_0 = np.zeros(N_XBAR)
    xbar_0[0:3] = r_0
    xbar_0[5] = scenario.servo.yaw
    xbar_0[12:15] = resting_integral(L, r_0, scenario.servo.form)
    return xbar_0


def make_onboard(scenario: Scenario, trajectory: Trajectory | None = None) -> Diagram:
    """Return the onboard half as a Diagram.

    Ports:
        uwb, detections, imu: messages of the sensors that the scenario flies.
        image (ImageRgba8U), shutter: the picture of a rendered camera and its message, in place of detections.
        velocity: the true velocities, only where the scenario lends them to the servo.
        control (4, output): u_k, f_T absolute.
        estimate (15, output): xhat_{k|k-1}.
        covariance (225, output): P_k row by row.
        measurement (39, output): y, delta and V2 as the filter takes them.
        reference (9, output): r, r_dot, r_ddot.

    Args:
        scenario: the scenario.
        trajectory: the path to fly (3 rows, W); by default what the scenario's planner plans.

    Raises:
        InputError: if there is no path or no servo gain, or if the detector's files are wrong.
    """
    room, h = scenario.load_room(), scenario.h
    trajectory = trajectory or plan(scenario.planner, room, scenario.vehicle)
    r_0 = trajectory.value(trajectory.start_time())[:, 0]

    builder = DiagramBuilder()
    planner = builder.AddSystem(make_planner(trajectory))
    handler = builder.AddSystem(MeasurementHandler(scenario.handler, scenario.filter.V, scenario.sensors))
    xbar_0 = initial_estimate(scenario, r_0)
    kalman = builder.AddSystem(KalmanFilter(scenario.filter, scenario.vehicle, scenario.servo.integrator, xbar_0, h))
    servo = builder.AddSystem(LqServo(scenario.servo, scenario.vehicle, h))
    estimate, covariance = kalman.GetOutputPort("estimate"), kalman.GetOutputPort("covariance")

    if "uwb" in scenario.sensors:
        multilateration = builder.AddSystem(Multilateration(scenario.multilateration, room.anchor_positions))
        builder.ExportInput(multilateration.GetInputPort("uwb"), "uwb")
        builder.Connect(estimate, multilateration.GetInputPort("estimate"))
        builder.Connect(multilateration.get_output_port(), handler.GetInputPort("uwb"))
    if "camera" in scenario.sensors:
        fix = builder.AddSystem(LandmarkFix(scenario.landmark_fix, room, scenario.image_width))
        if scenario.is_rendered:
            camera = room.camera.scaled_to(scenario.rendered_camera.width)
            size = camera.width, camera.height
            detect = load_detector(scenario.detector, room, size)
            detector = builder.AddSystem(Detector(detect, size, scenario.rendered_camera.latency, h))
            builder.ExportInput(detector.GetInputPort("image"), "image")
            builder.ExportInput(detector.GetInputPort("shutter"), "shutter")
            builder.Connect(detector.get_output_port(), fix.GetInputPort("detections"))
        else:
            builder.ExportInput(fix.GetInputPort("detections"), "detections")
        builder.Connect(estimate, fix.GetInputPort("estimate"))
        builder.Connect(covariance, fix.GetInputPort("covariance"))
        builder.Connect(fix.get_output_port(), handler.GetInputPort("camera"))
    if "imu" in scenario.sensors:
        builder.ExportInput(handler.GetInputPort("imu"), "imu")
    if scenario.servo.velocities == "truth":
        builder.ExportInput(servo.GetInputPort("velocity"), "velocity")
    if handler.HasInputPort("estimate"):  # it gates
        builder.Connect(estimate, handler.GetInputPort("estimate"))
        builder.Connect(covariance, handler.GetInputPort("covariance"))
    builder.Connect(handler.get_output_port(), kalman.GetInputPort("measurement"))
    builder.Connect(servo.get_output_port(), kalman.GetInputPort("control"))
    builder.Connect(planner.get_output_port(), kalman.GetInputPort("reference"))
    builder.Connect(estimate, servo.GetInputPort("estimate"))
    builder.Connect(planner.get_output_port(), servo.GetInputPort("reference"))
    builder.ExportOutput(servo.get_output_port(), "control")
    builder.ExportOutput(estimate, "estimate")
    builder.ExportOutput(covariance, "covariance")
    builder.ExportOutput(handler.get_output_port(), "measurement")
    builder.ExportOutput(planner.get_output_port(), "reference")
    onboard = builder.Build()
    onboard.set_name("onboard")
    return onboard
