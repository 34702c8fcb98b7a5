"""The nominal flight, as it is planned, and the tube about it: where the linear theory expects the vehicle.

tube_recursion.py has the equations and their approximations, disc_radius.py has the radius.
"""

import math
import os
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ortilo_drake.flight.blackouts import in_blackout
from ortilo_drake.model.signals import N_U, N_X
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.onboard.estimator.filter_model import filter_of, initial_covariance
from ortilo_drake.onboard.estimator.intermittent_filter import INTEGRATORS
from ortilo_drake.onboard.planner.planned import path_of
from ortilo_drake.onboard.servo.lq_servo import servo_control
from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.loss_chain import loss_parameters
from ortilo_drake.studies.loop.fix_covariance import value_noise
from ortilo_drake.studies.loop.hover_loop import hover_loop
from ortilo_drake.studies.tube.disc_radius import THREE_SIGMA, disc_radii
from ortilo_drake.studies.tube.tube_recursion import propagate


class NominalFlight(NamedTuple):
    """A flight as it is planned, at every tick t_k [s] (n): the reference position r [m] (n, 3).

    x_ref: the state that the servo aims at, 0 in the paper's form (n, 12); u_ff: the feedforward less hover (n, 4); V:
    the covariances of the sensors' values at each tick, each in the corner of an M x M block (n, s, M, M); there:
    whether a message of each sensor can arrive, if none is lost at random (n, s).
    """

    time: np.ndarray
    r: np.ndarray
    x_ref: np.ndarray
    u_ff: np.ndarray
    V: np.ndarray
    there: np.ndarray


def delay_of(scenario: Scenario, sensor: str) -> int:
    """Return the delay of a sensor's messages [ticks]; InputError if the delay is random."""
    link = scenario.link_of(sensor)
    if link.random_delay and sensor in scenario.sensors:
        raise InputError(f"{sensor}.link.random_delay: {link.random_delay}: must be 0 where the tube is predicted")
    return link.delay + scenario.latency_of(sensor)


def aim(scenario: Scenario, reference: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return x_ref (n, 12) and u_ff (n, 4) for references r, r_dot, r_ddot (n, 9), by the servo's own law.

    With L = 0 the law returns m g and u_ff; with unit rows for L, it returns x_ref row by row. A registered servo's law
    is unknown; it is assumed to aim at the planned acceleration's tilt, like the LQ servo's form 'error'.
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
    """Return the nominal flight of a scenario: its path, and where along the path each sensor's messages can arrive.

    A message sent at tick k arrives after its constant delay, with the covariance at the place where it was measured.
    InputError if there is no path, or if delays are random.
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


AT_ONCE = 50  # cases side by side; more do not fit into a processor's cache


class Tube(NamedTuple):
    """The predicted deviation of the vehicle from the planned path r_k [m] (n, 3) at t_k [s] (n)."""

    time: np.ndarray
    r: np.ndarray
    mean: np.ndarray
    """mean deviation of the true position from r_k [m] (n, 3)."""
    covariance: np.ndarray
    """covariance of this deviation [m^2] (n, 3, 3)."""
    X: np.ndarray
    """expected covariance of the filter's position error [m^2] (n, 3, 3)."""
    radius: np.ndarray
    """radius of the horizontal disc about r_k that the vehicle leaves with probability 0.27 % (3 sigma) [m] (n)."""
    height: np.ndarray
    """|mean| plus 3 sigma of the vertical deviation [m] (n)."""


def tube_height(mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return |mean| + 3 sigma (...) of the vertical deviation [m], from means (..., 3) and covariances (..., 3, 3)."""
    return np.asarray(np.abs(mean[..., 2]) + 3.0 * np.sqrt(covariance[..., 2, 2]))


def predict_tube(scenario: Scenario, nominal: NominalFlight | None = None) -> Tube:
    """Return the tube that the linear theory predicts for a scenario.

    The nominal flight may be given; it depends on all settings but the losses and the servo's gains. InputError if the
    theory has no answer (a servo fed true velocities, random delays), or if there is no path or no gain.
    """
    nominal = nominal_flight(scenario) if nominal is None else nominal
    mean, covariance, X = (part[0] for part in deviations(scenario, nominal, losses_of(scenario)[None]))
    radius = disc_radii(np.ascontiguousarray(mean[:, :2]), np.ascontiguousarray(covariance[:, :2, :2]), THREE_SIGMA)
    return Tube(nominal.time, nominal.r, mean, covariance, X, radius, tube_height(mean, covariance))


def losses_of(scenario: Scenario) -> np.ndarray:
    """Return the loss parameters of the sensors' links (s, 4), see loss_parameters."""
    return np.array([loss_parameters(scenario.link_of(s).loss, scenario.h) for s in scenario.measurement.sensors])


def deviations(
    scenario: Scenario, nominal: NominalFlight, losses: np.ndarray, there: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return mean (B, n, 3) and covariance (B, n, 3, 3) of the position's deviation from r_k, and X of the position.

    If no message is lost at random, the arrivals are known, and X is the filter's own P_k. The cases go through the
    recursion side by side, spread over the machine's cores.

    losses: of the links in each case (B, s, 4), see losses_of, in place of the scenario's own; there: whether a message
    can arrive in each case (B, n, s), by default as in the nominal flight. InputError as in `predict_tube`.
    """
    if scenario.lends_velocities:
        raise InputError("servo.velocities: 'truth': the tube is that of a servo fed by the filter, give 'estimate'")
    loop = hover_loop(scenario)
    if len(loop.names) != N_X:
        force = filter_of(scenario).force
        raise InputError(f"estimator.force: {force}: must be none: the tube is the paper's filter's")
    x_ref, u_ff = nominal.x_ref, nominal.u_ff
    d = x_ref[:-1] @ loop.Phi.T + u_ff[:-1] @ loop.Gamma.T - x_ref[1:]
    d = np.vstack([d, np.zeros((1, d.shape[1]))])
    layout = tuple(loop.measurement.layout)
    r_servo, X_0 = np.ascontiguousarray(x_ref[:, :3]), initial_covariance(filter_of(scenario))
    there = np.broadcast_to(nominal.there, (len(losses), *nominal.there.shape)) if there is None else there

    def some(cases: slice) -> tuple[np.ndarray, ...]:
        # Writable copies: numba would compile the recursion once more for read-only arrays.
        arrives, loss = (np.array(np.moveaxis(part[cases], 0, -1), order="C") for part in (there, losses))
        found = propagate(
            loop.Phi, loop.Gamma, loop.L, loop.W, nominal.V, arrives, loss, X_0, d, nominal.r, r_servo,
            INTEGRATORS[loop.integrator], layout, 3,
        )  # fmt: skip
        return tuple(np.ascontiguousarray(np.moveaxis(part, -1, 0)) for part in found)

    with ThreadPoolExecutor(os.cpu_count()) as threads:  # the recursion releases the interpreter's lock (GIL)
        ends = np.linspace(0, len(losses), math.ceil(len(losses) / AT_ONCE) + 1).astype(int)
        parts = list(threads.map(some, map(slice, ends[:-1], ends[1:])))
    means, covariances, X = (np.concatenate(part) for part in zip(*parts, strict=True))
    return means + (x_ref[:, :3] - nominal.r), covariances + X, X
