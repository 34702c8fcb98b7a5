"""The estimator `kind: tight` as a Diagram: detector and solvers of fixes about the tight filter."""

from typing import Any

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort
from pydrake.systems.primitives import Demultiplexer

from ortilo_drake.diagrams.estimator import make_detector
from ortilo_drake.model.parts import Sensor
from ortilo_drake.model.signals import SENSORS
from ortilo_drake.onboard.estimator.tight.model import aids_of, initial_covariance, layout_of, motion_of
from ortilo_drake.onboard.estimator.tight.system import TightFilter
from ortilo_drake.scenario import Belief
from ortilo_drake.sensors.described import flown
from ortilo_drake.sensors.messages import message_port


def make_tight(scenario: Belief, xbar_0: np.ndarray) -> Diagram:
    """Return the estimator of a scenario whose estimator is of kind 'tight'; see diagrams/onboard.py.

    Ports:
        uwb, detections, imu, ...: the messages of the sensors that the scenario flies.
        image (ImageRgba8U), shutter: the picture of a rendered camera and its message, in place of detections.
        control (4): u_k.
        estimate (12, output), covariance (144, output): one tick ahead.
        y (p), delta (s), V2 (q) (outputs): which sensors were used; of ranges and boxes no fix is made, y is NaN there.
    """
    scenario = scenario.belief
    settings: Any = scenario.estimator
    room, h = scenario.load_room(), scenario.h
    sensors = tuple(name for name in scenario.measurement.sensors if name in scenario.sensors)
    layout = layout_of(settings, room, sensors, h)
    own: list[Sensor] = [flown(name, scenario) for name in sensors if name not in SENSORS]
    builder = DiagramBuilder()
    rows = {sensor.name: scenario.measurement.C_of(sensor.name) for sensor in own}
    arguments = (
        layout,
        motion_of(settings, layout, scenario),
        initial_covariance(settings, layout),
        aids_of(settings, room, scenario),
    )
    tight = builder.AddSystem(
        TightFilter(*arguments, sensors, scenario.measurement, scenario.samples("imu"), rows, xbar_0)
    )
    for name in sensors:
        if name in ("uwb", "imu"):
            builder.ExportInput(tight.GetInputPort(name), name)
        elif name == "camera" and scenario.is_rendered:
            detector = builder.AddSystem(make_detector(scenario, room))
            builder.ExportInput(detector.GetInputPort("image"), "image")
            builder.ExportInput(detector.GetInputPort("shutter"), "shutter")
            builder.Connect(detector.get_output_port(), tight.GetInputPort("detections"))
        elif name == "camera":
            builder.ExportInput(tight.GetInputPort("detections"), "detections")
    wide: dict[str, OutputPort] = {}
    for sensor in own:
        if sensor.make_onboard is None:
            builder.ExportInput(tight.GetInputPort(sensor.name), sensor.name)
            continue
        solver = builder.AddSystem(sensor.make_onboard(scenario, room))
        builder.ExportInput(message_port(solver), message_port(solver).get_name())
        if not wide and solver.HasInputPort("estimate"):
            parts = builder.AddSystem(Demultiplexer([15, 225]))
            builder.Connect(tight.GetOutputPort("wide"), parts.get_input_port())
            wide = {"estimate": parts.get_output_port(0), "covariance": parts.get_output_port(1)}
        for port in ("estimate", "covariance"):
            if solver.HasInputPort(port):
                builder.Connect(wide[port], solver.GetInputPort(port))
        builder.Connect(solver.get_output_port(), tight.GetInputPort(sensor.name))
    builder.ExportInput(tight.GetInputPort("control"), "control")
    for port in ("estimate", "covariance", "y", "delta", "V2"):
        builder.ExportOutput(tight.GetOutputPort(port), port)
    diagram = builder.Build()
    diagram.set_name("estimator")
    return diagram
