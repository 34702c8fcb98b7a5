"""The estimator `kind: tight`: its settings made into states and noise, and its System."""

from typing import Any

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import Demultiplexer
from scipy.stats import chi2

from ortilo_drake.model.parts import Part, Sensor, register_part
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import SENSORS
from ortilo_drake.onboard.estimator.tight.layout import ACCEL, GYRO, N_INERTIAL, THETA, Layout, P, V, make_layout
from ortilo_drake.onboard.estimator.tight.system import Aids, TightFilter
from ortilo_drake.onboard.estimator.tight.tick import Motion
from ortilo_drake.scenario import Belief
from ortilo_drake.scenario.tight import DATASHEETS
from ortilo_drake.scenario.tight import TightFilter as Settings


def layout_of(settings: Settings, room: Room, sensors: tuple[str, ...], h: float) -> Layout:
    """Return which states there are: those whose error is not 0, of sensors that fly."""
    imu, ranges, pixels = settings.imu, settings.ranges, settings.pixels
    anchors = len(room.anchors) if "uwb" in sensors else 0
    landmarks = len(room.landmarks) if "camera" in sensors else 0
    clocks = (ranges.clock_sd > 0.0 and anchors > 0) or (pixels.clock_sd > 0.0 and landmarks > 0)
    sizes = {
        "angles": 3 * (imu.level_sd > 0.0 or imu.yaw_sd > 0.0),
        "clock": 2 * clocks,
        "range_bias": anchors * (ranges.bias_sd > 0.0),
        "range_slow": anchors * (ranges.slow_sd > 0.0),
        "survey": 3 * landmarks * (pixels.survey_sd > 0.0),
        "pixel_slow": 2 * landmarks * (pixels.slow_share > 0.0),
    }
    return make_layout(sizes, round(settings.horizon / h))


def _sample_sds(settings: Settings, samples: int, h: float) -> tuple[float, float]:
    """Return the noise of a sample of body rates [rad/s] and specific force [m/s^2]."""
    imu = settings.imu
    if imu.datasheet == "none":
        return imu.rate_sd, imu.specific_force_sd
    sheet, root = DATASHEETS[imu.datasheet], np.sqrt(samples / h)
    return sheet.rate_density * root, sheet.specific_force_density * root


def motion_of(settings: Settings, layout: Layout, scenario: Belief) -> Motion:
    """Return what the filter believes of imu and vehicle."""
    imu, ranges, pixels, h = settings.imu, settings.ranges, settings.pixels, scenario.h
    rate_sd, force_sd = _sample_sds(settings, scenario.samples("imu"), h)
    keeps, steps = np.ones(layout.core - GYRO), np.zeros(layout.core - GYRO)
    steps[:3], steps[3:6] = h * imu.gyroscope_rate**2, h * imu.accelerometer_rate**2

    def set_group(at: int, size: int, step: float, keep: float = 1.0) -> None:
        if at >= 0:
            keeps[at - GYRO : at - GYRO + size], steps[at - GYRO : at - GYRO + size] = keep, step

    anchors, landmarks = _counts(layout)
    set_group(layout.angles, 3, h * imu.angles_rate**2)
    set_group(layout.range_bias, anchors, h * ranges.bias_rate**2)
    keep = np.exp(-h / ranges.slow_time)
    set_group(layout.range_slow, anchors, (1.0 - keep**2) * ranges.slow_sd**2, keep)
    keep = np.exp(-h / pixels.slow_time)
    set_group(layout.pixel_slow, 2 * landmarks, 1.0 - keep**2, keep)
    coasting = np.square(imu.coasting_sd)
    inertia = np.array(scenario.vehicle.inertia, dtype=float)
    return Motion(np.array([rate_sd**2, force_sd**2]), coasting, keeps, steps, scenario.vehicle.mass, inertia, h)


def _counts(layout: Layout) -> tuple[int, int]:
    """Return how many anchors and landmarks the layout is for, as far as it has states of them."""
    starts = [at for at in (*layout[:6], layout.core) if at >= 0]

    def size(at: int) -> int:
        return min(s for s in starts if s > at) - at if at >= 0 else 0

    anchors = max(size(layout.range_bias), size(layout.range_slow))
    return anchors, max(size(layout.survey) // 3, size(layout.pixel_slow) // 2)


def initial_covariance(settings: Settings, layout: Layout) -> np.ndarray:
    """Return the first covariance (n, n); all clones are the first pose."""
    imu, ranges, pixels = settings.imu, settings.ranges, settings.pixels
    sd = np.zeros(layout.core)
    sd[P : P + 3], sd[THETA : THETA + 3], sd[V : V + 3] = settings.initial_sd
    sd[GYRO : GYRO + 3], sd[ACCEL:N_INERTIAL] = imu.gyroscope_sd, imu.accelerometer_sd
    anchors, landmarks = _counts(layout)
    for at, sds in (
        (layout.angles, [imu.level_sd, imu.level_sd, imu.yaw_sd]),
        (layout.clock, [ranges.clock_sd, pixels.clock_sd]),
        (layout.range_bias, [ranges.bias_sd] * anchors),
        (layout.range_slow, [ranges.slow_sd] * anchors),
        (layout.survey, [pixels.survey_sd] * 3 * landmarks),
        (layout.pixel_slow, [1.0] * 2 * landmarks),
    ):
        if at >= 0:
            sd[at : at + len(sds)] = sds
    pose = [P, P + 1, P + 2, THETA, THETA + 1, THETA + 2]
    from_ = np.concatenate((np.arange(layout.core), *([pose] * layout.clones))).astype(int)
    return np.diag(sd**2)[np.ix_(from_, from_)]


def make_tight(scenario: Belief, xbar_0: np.ndarray) -> Diagram:
    """Return the estimator of a scenario whose estimator is of kind 'tight'; see diagrams/onboard.py.

    Ports:
        uwb, detections, imu, ...: the messages of the sensors that the scenario flies.
        image (ImageRgba8U), shutter: the picture of a rendered camera and its message, in place of detections.
        control (4): u_k.
        estimate (12, output), covariance (144, output): one tick ahead.
        y (p), delta (s), V2 (q) (outputs): which sensors were used; of ranges and boxes no fix is made, y is NaN there.
    """
    # They need the sensors' descriptions, which register themselves with parts of the package that need this one.
    from ortilo_drake.diagrams.estimator import make_detector
    from ortilo_drake.sensors.described import flown
    from ortilo_drake.sensors.messages import message_port

    scenario = scenario.belief
    settings: Any = scenario.estimator
    room, h = scenario.load_room(), scenario.h
    sensors = tuple(name for name in scenario.measurement.sensors if name in scenario.sensors)
    layout = layout_of(settings, room, sensors, h)
    own: list[Sensor] = [flown(name, scenario) for name in sensors if name not in SENSORS]
    noise = settings.ranges.noise
    aids = Aids(
        anchors=np.ascontiguousarray(room.anchor_positions, dtype=float),
        lever=np.array(settings.ranges.lever),
        range_noise=np.array([noise.sd, 0.0] if noise.kind == "constant" else [0.0, noise.fraction]),
        differences=settings.ranges.differences,
        room=room.model_copy(update={"landmark_outline": {}}) if scenario.landmark_fix.shapes == "boxes" else room,
        camera=room.camera.scaled_to(scenario.image_width).constants,
        pixel_noise=np.array([settings.pixels.sd, settings.pixels.growth, settings.pixels.slow_share]),
        association=scenario.landmark_fix,
        angle_sd=settings.imu.angle_sd,
        gates=(float(chi2.ppf(settings.gate, 1)), float(chi2.ppf(settings.gate, 2))),
        huber=settings.huber,
    )
    builder = DiagramBuilder()
    rows = {sensor.name: scenario.measurement.C_of(sensor.name) for sensor in own}
    arguments = layout, motion_of(settings, layout, scenario), initial_covariance(settings, layout), aids
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
    wide = {}
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


register_part("estimator", Part("tight", Settings, make_tight))
