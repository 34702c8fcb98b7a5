"""The nominal flight: reference, feed-forward, fix covariances and possible arrivals at each tick of the path."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ortilo_drake.flight.blackouts import in_blackout
from ortilo_drake.model.signals import N_U, N_X
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.onboard.planner.planned import path_of
from ortilo_drake.onboard.servo.lq_servo import servo_control
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.loop.fix_covariance import value_noise


class NominalFlight(NamedTuple):
    """A flight as it is planned, at every tick t_k [s] (n): the reference position r [m] (n, 3).

    The servo aims at the state x_ref, 0 in the paper's form (n, 12), and feeds u_ff forward, less hover (n, 4). V has
    the covariances of what arrives in a tick, of each sensor in the corner of an M x M block (n, s, M, M); there says
    whether a message of each sensor can arrive, if none is lost at random (n, s).
    """

    time: np.ndarray
    r: np.ndarray
    x_ref: np.ndarray
    u_ff: np.ndarray
    V: np.ndarray
    there: np.ndarray


def delay_of(scenario: Scenario, sensor: str) -> int:
    """Return the delay of a sensor's messages [ticks]; InputError if that is random."""
    link = scenario.link_of(sensor)
    if link.random_delay and sensor in scenario.sensors:
        raise InputError(f"{sensor}.link.random_delay: {link.random_delay}: must be 0 where the tube is predicted")
    return link.delay + scenario.latency_of(sensor)


def aim(scenario: Scenario, reference: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return x_ref (n, 12) and u_ff (n, 4) for references r, r_dot, r_ddot (n, 9), by the servo's own law.

    With L = 0 the law returns m g and u_ff; with unit rows for L, it returns x_ref row by row. A registered
    servo's law is unknown: it is taken to aim as the LQ servo's form 'error' does, at the planned acceleration's tilt.
    """
    vehicle, yaw = scenario.vehicle, scenario.yaw
    error_form = getattr(scenario.servo, "form", "error") == "error"
    nothing, hover = np.zeros(15), np.array([vehicle.mass * GRAVITY, 0.0, 0.0, 0.0])
    x_ref, u_ff = np.zeros((len(reference), N_X)), np.zeros((len(reference), N_U))
    picks = [np.eye(4, 15, 4 * part) for part in range(3)]
    for k, row in enumerate(reference):
        u_ff[k] = servo_control(nothing, row, np.zeros((4, 15)), vehicle.mass, yaw, error_form) - hover
        for part, L in enumerate(picks):
            u = servo_control(nothing, row, L, vehicle.mass, yaw, error_form)
            x_ref[k, 4 * part : 4 * part + 4] = u - hover - u_ff[k]
    return x_ref, u_ff


def planned_reference(scenario: Scenario) -> tuple[np.ndarray, np.ndarray]:
    """Return t_k (n) and r, r_dot, r_ddot (n, 9) of the whole flight; InputError if there is no path."""
    path = path_of(scenario)
    end = path.end_time()
    time = np.arange(round((end + scenario.settle) * scenario.control_rate) + 1) * scenario.h
    inside = np.minimum(time, end)
    rates = [path.MakeDerivative(order).vector_values(inside).T * (time <= end)[:, None] for order in (1, 2)]
    return time, np.hstack([path.vector_values(inside).T, *rates])


@lru_cache(maxsize=4)
def nominal_flight(scenario: Scenario) -> NominalFlight:
    """Return the nominal flight of a scenario: its path, and where along it a message of each sensor can arrive.

    A message sent at tick k arrives late by its constant delay, with the covariance of the place where it was taken.
    InputError if there is no path, or messages are late at random.
    """
    time, reference = planned_reference(scenario)
    n = len(time)
    x_ref, u_ff = aim(scenario, reference)
    poses = np.zeros((n, N_X))
    poses[:, :3], poses[:, 3:6] = reference[:, :3], x_ref[:, 3:6]
    sensors, sizes = scenario.measurement.sensors, np.diff(scenario.measurement.layout.first)
    V = np.tile(np.eye(max(sizes)), (n, len(sensors), 1, 1))
    there = np.zeros((n, len(sensors)), dtype=np.bool_)
    flying = [(s, sensor) for s, sensor in enumerate(sensors) if sensor in scenario.sensors]
    for s, sensor in flying:
        delay, dark = delay_of(scenario, sensor), in_blackout(poses, scenario, sensor)
        for k in range(0, n - delay, scenario.link_of(sensor).every(scenario.h)):
            if not dark[k]:
                V[k + delay, s, : sizes[s], : sizes[s]], there[k + delay, s] = value_noise(scenario, sensor, poses[k])
    return NominalFlight(time, np.ascontiguousarray(reference[:, :3]), x_ref, u_ff, V, there)
