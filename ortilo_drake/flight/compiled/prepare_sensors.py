"""From a scenario to the constants of its sensors in a compiled flight."""

import numpy as np

from ortilo_drake.flight.compiled.constants import (
    CameraConstants,
    ImuConstants,
    LinkConstants,
    OtherConstants,
    UwbConstants,
)
from ortilo_drake.flight.compiled.others import remember
from ortilo_drake.flight.compiled.slow import NO_ERRORS
from ortilo_drake.model.room import Room
from ortilo_drake.onboard.estimator.imu_rows import imu_variances
from ortilo_drake.onboard.landmarks.box_fix import box_belief, prior_covariance
from ortilo_drake.onboard.ranging.multilateration import believed_noise
from ortilo_drake.scenario import IntermittentFilter, Scenario
from ortilo_drake.scenario.loss_chain import loss_parameters
from ortilo_drake.sensors.described import as_known
from ortilo_drake.sensors.shares import share_of
from ortilo_drake.world.faults.scene_faults import message_faults, scene_table
from ortilo_drake.world.faults.table import FaultTable, table_of
from ortilo_drake.world.noise import stream_id
from ortilo_drake.world.radio.link import blackout_rows, steps_a_chain
from ortilo_drake.world.sensors.landmark_view import surroundings
from ortilo_drake.world.sensors.projected_camera import noise_streams, tables_of
from ortilo_drake.world.sensors.uwb import ranging_settings, walls_between


def faults_of(scenario: Scenario, sensor: str) -> FaultTable | None:
    """Return the faults of a sensor's messages; None if the whole flight has none."""
    return table_of(message_faults(scenario.faults, sensor)) if scenario.faults else None


def link_of(scenario: Scenario, sensor: str, latency: int = 0) -> LinkConstants:
    """Return how a sensor's messages are delivered; latency [ticks] beside its delay."""
    settings = scenario.link_of(sensor)
    return LinkConstants(
        scenario.every(sensor) if sensor in scenario.sensors else 0,
        loss_parameters(settings.loss, scenario.h),
        steps_a_chain(settings),
        blackout_rows(settings, scenario.h),
        (settings.delay + latency, settings.random_delay),
        stream_id(f"link/{sensor}"),
    )


def imu_of(scenario: Scenario) -> ImuConstants:
    """Return the imu."""
    settings = scenario.imu
    sd = np.array([settings.angle_sd, settings.rate_sd, settings.specific_force_sd])
    whole = not isinstance(scenario.estimator, IntermittentFilter) or imu_variances(scenario) is not None
    samples = scenario.samples("imu") if "imu" in scenario.sensors else 1
    link, faults = link_of(scenario, "imu"), faults_of(scenario, "imu")
    return ImuConstants(whole, samples, np.zeros(9), sd, stream_id("imu"), link, faults)


def uwb_of(scenario: Scenario, room: Room) -> UwbConstants:
    """Return ranging."""
    settings = scenario.multilateration
    return UwbConstants(
        room.anchor_positions,
        np.zeros(len(room.anchors)),
        walls_between(scenario.uwb, room),
        ranging_settings(scenario.uwb),
        stream_id("uwb"),
        np.zeros(2),
        link_of(scenario, "uwb"),
        room.anchor_positions,
        believed_noise(settings),
        settings.method == "nearest_three",
        faults_of(scenario, "uwb"),
    )


def camera_of(scenario: Scenario, room: Room) -> CameraConstants:
    """Return the projected camera and its fix."""
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
        np.zeros(3),
        np.zeros(2),
        link_of(scenario, "camera", settings.latency),
        box_belief(fix, as_known(scenario, room), scenario.image_width),
        True if fix.method == "cosine_law" else None,
        len(fix.rows),
        np.zeros(0) if prior is None else prior,
        fix.joint is not None,
        faults_of(scenario, "camera"),
        scene_table(scenario.faults) if scenario.faults else None,
    )


def others_of(scenario: Scenario, room: Room, starts: np.ndarray) -> tuple[OtherConstants, ...]:
    """Return the sensors beside uwb, camera and imu.

    Args:
        scenario: the scenario.
        room: its room.
        starts: where each sensor's message or fix begins in the vector that the handler takes.
    """
    found = []
    for name in scenario.own_sensors:
        share, number = share_of(name), scenario.measurement.sensors.index(name)
        numbers = share.numbers(scenario, room)
        remember(numbers, share)
        found.append(
            OtherConstants(
                numbers,
                share.payload,
                share.noises,
                int(starts[number]),
                number,
                share.solve is not None,
                stream_id(name),
                np.zeros(2),
                NO_ERRORS,
                link_of(scenario, name),
                faults_of(scenario, name),
            )
        )
    return tuple(found)
