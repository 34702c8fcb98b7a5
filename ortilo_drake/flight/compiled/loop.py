"""One flight as one compiled loop; the order of a tick stands in the package's docstring."""

import numpy as np
from numba import njit
from numba.extending import register_jitable

from ortilo_drake.flight.compiled.boxes import camera_chain, detections_of_tick, empty_camera_link, fix_of_boxes
from ortilo_drake.flight.compiled.constants import FlightConstants, ImuConstants, ServoConstants, UwbConstants
from ortilo_drake.flight.compiled.estimate import belief_about, belief_after, first_history, handed_over
from ortilo_drake.flight.compiled.figures import ESTIMATED, NEES, TRUE, figures_of, position_nees, squared_distance_to
from ortilo_drake.flight.compiled.links import chain_of_tick, delay_through, deliver, empty_link
from ortilo_drake.flight.lost import NOT_LOST, cause_of_loss
from ortilo_drake.model.equations import step
from ortilo_drake.model.signals import ARRIVED, IMU_SIZE, N_U, N_X, N_XBAR, PAYLOAD
from ortilo_drake.onboard.estimator.belief import known_part
from ortilo_drake.onboard.ranging.multilateration import fix_message
from ortilo_drake.onboard.servo.lq_servo import servo_control
from ortilo_drake.world.radio.link import NOT_SENT
from ortilo_drake.world.sensors.imu import attitude_message, imu_message
from ortilo_drake.world.sensors.uwb import uwb_message
from ortilo_drake.world.vehicle.disturbance import disturbance_at


@register_jitable
def imu_of_tick(
    imu: ImuConstants,
    mass: float,
    x: np.ndarray,
    u: np.ndarray,
    d: np.ndarray,
    k: int,
    h: float,
    seed: int,
    bad: bool,
    flying: np.ndarray,
) -> np.ndarray:
    """Return the imu's message that lands at tick k, zeros if none does; arguments as imu_message."""
    delay = delay_through(imu.link, k, x, bad, seed)
    if delay == NOT_SENT:
        message = np.zeros(IMU_SIZE)
    else:
        message = (
            imu_message(x, u, d, mass, imu.bias, imu.sd, seed, imu.stream, k * h, h)
            if imu.whole
            else attitude_message(x, imu.bias, imu.sd, seed, imu.stream, k * h, h)
        )
    deliver(message, delay, flying, k)
    return message


@register_jitable
def uwb_of_tick(
    uwb: UwbConstants, x: np.ndarray, k: int, h: float, seed: int, bad: bool, flying: np.ndarray
) -> np.ndarray:
    """Return the uwb message that lands at tick k, zeros if none does; arguments as uwb_message."""
    delay = delay_through(uwb.link, k, x, bad, seed)
    if delay == NOT_SENT:
        message = np.zeros(PAYLOAD + 2 * uwb.anchors.shape[0])
    else:
        message = uwb_message(x, uwb.anchors, uwb.bias, uwb.walls, uwb.settings, seed, uwb.stream, k * h, h)
    deliver(message, delay, flying, k)
    return message


@register_jitable
def control_of(
    servo: ServoConstants, knows_force: bool, belief: np.ndarray, xhat: np.ndarray, x: np.ndarray, reference: np.ndarray
) -> np.ndarray:
    """Return u_k; the force that is believed to act is that of the belief of [x; e; i], 0 where there is none."""
    xbar, force = xhat.copy(), np.zeros(3)
    if servo.lent:
        xbar[6:N_X] = x[6:N_X]
    if knows_force:
        force[:] = belief[N_X : N_X + 3]
    return servo_control(xbar, reference, servo.L, servo.mass, servo.yaw, servo.error_form, force)


@register_jitable
def fix_of_ranges(uwb: UwbConstants, message: np.ndarray, about: np.ndarray) -> np.ndarray:
    """Return the fix of the ranges that landed, zeros if there is none, about a belief of [x; i] (240)."""
    if message[ARRIVED] == 0.0:
        return np.zeros(PAYLOAD)
    return fix_message(message, uwb.surveyed, uwb.noise, about[:N_XBAR], uwb.three)


@njit(cache=True, nogil=True)
def fly_one(
    seeds: np.ndarray, flight: FlightConstants, trace: np.ndarray, arrived: np.ndarray, log: np.ndarray
) -> tuple[int, int]:
    """Fly once and write what it leaves behind; return its last tick and the cause of its loss, see lost.CAUSES.

    Args:
        seeds: of all noise, at each tick (ticks + 1): one and the same for a flight of a seed, another from some tick
            on for one that branches off it.
        flight: what decides it beside.
        trace: a row for each tick, see figures.py (ticks + 1, TRACE_SIZE).
        arrived: in how many ticks each sensor's value reached the filter (s).
        log: a row for each tick, see Measurement.logged_sizes (ticks + 1, w); (0, w) for none.
    """
    h, vehicle, imu, uwb, camera = flight.h, flight.vehicle, flight.imu, flight.uwb, flight.camera
    servo, estimator = flight.servo, flight.filter
    slot, handled, n = estimator.slot, estimator.handled, N_XBAR + len(estimator.model.extra)
    p, s, q = handled.first[-1], handled.first.size - 1, handled.block[-1]
    x, d, hover = np.zeros(N_X), np.zeros(6), np.zeros(N_U)
    x[0:3], x[5] = flight.reference[0, 0:3], flight.yaw
    hover[0] = vehicle.hover_thrust
    u, belief, history = hover.copy(), estimator.belief_0.copy(), first_history(slot, estimator.history)
    uwb_flying = empty_link(uwb.link, PAYLOAD + 2 * uwb.anchors.shape[0])
    imu_flying, camera_flying = empty_link(imu.link, IMU_SIZE), empty_camera_link(camera)
    uwb_bad = imu_bad = camera_bad = False
    refused = 0.0
    last = flight.reference.shape[0] - 1
    arrived[:] = 0.0
    for k in range(last + 1):
        seed, r = seeds[k], flight.reference[k]
        known = belief if n == N_XBAR else known_part(belief, n)
        felt = imu_of_tick(imu, vehicle.mass, x, u, d, k, h, seed, imu_bad, imu_flying)
        ranges = uwb_of_tick(uwb, x, k, h, seed, uwb_bad, uwb_flying)
        detections = detections_of_tick(camera, x, k, h, seed, camera_bad, camera_flying)
        about = belief_about(slot, history, n, ranges, known, h)
        by_ranges = fix_of_ranges(uwb, ranges, about)
        about = belief_about(slot, history, n, detections, known, h)
        by_boxes, refused = fix_of_boxes(camera, detections, about[:N_XBAR], about[N_XBAR:], refused)
        handed = handed_over(estimator, by_ranges, felt, by_boxes, known, k, h)
        u = control_of(servo, estimator.knows_force, belief, known[:N_XBAR], x, r)
        arrived += handed[p : p + s]
        trace[k, TRUE], trace[k, ESTIMATED] = x[:3], known[:3]
        trace[k, NEES] = position_nees(x, known, known[N_XBAR:])
        if log.shape[0] > 0:
            row = log[k]
            row[:N_X], row[N_X : N_X + N_U] = x, u
            at = N_X + N_U + p + s + q
            row[N_X + N_U : at], row[at : at + known.size], row[at + known.size :] = handed[: p + s + q], known, r
        cause = cause_of_loss(x, flight.bounds)
        if cause != NOT_LOST:
            return k, cause
        if k == last:
            break
        belief = belief_after(slot, history, belief, estimator, handed, felt, k, h, u - hover, r)
        d = disturbance_at(vehicle.force_sd, vehicle.torque_sd, seed, vehicle.stream, k * h, h)
        x = step(x, u, d, vehicle.mass, vehicle.inertia, vehicle.kinematics, h)
        imu_bad, uwb_bad = chain_of_tick(imu.link, k, imu_bad, seed), chain_of_tick(uwb.link, k, uwb_bad, seed)
        camera_bad = camera_chain(camera, k, camera_bad, seed)
    return last, NOT_LOST


@njit(cache=True, nogil=True)
def fly_some(
    seeds: np.ndarray, flight: FlightConstants, trace: np.ndarray, figures: np.ndarray, arrived: np.ndarray
) -> None:
    """Fly seeds one after the other; write the figures of each, see figures.py, and its arrivals.

    Args:
        seeds: of all noise, one for each flight (n).
        flight: what decides them beside.
        trace: of one flight, overwritten (ticks + 1, TRACE_SIZE).
        figures: to be written (n, FIGURES).
        arrived: to be written (n, s).
    """
    no_log, of_ticks = np.zeros((0, 0)), np.empty(trace.shape[0], np.int64)
    for i in range(seeds.size):
        of_ticks[:] = seeds[i]
        last, cause = fly_one(of_ticks, flight, trace, arrived[i], no_log)
        figures[i, 0], figures[i, 1] = last, cause
        figures_of(trace[: last + 1], flight.reference[: last + 1, :3], figures[i])


@njit(cache=True, nogil=True)
def distances_of(seeds: np.ndarray, flight: FlightConstants, trace: np.ndarray, distances: np.ndarray) -> None:
    """Fly and write how far from its reference r each flight is at each tick [m], infinity from a loss on.

    Args:
        seeds: of all noise, of each flight at each tick (n, ticks + 1).
        flight: what decides them beside.
        trace: of one flight, overwritten (ticks + 1, TRACE_SIZE).
        distances: to be written (n, ticks + 1).
    """
    no_log, arrived = np.zeros((0, 0)), np.zeros(flight.filter.handled.first.size - 1)
    for i in range(seeds.shape[0]):
        last, cause = fly_one(seeds[i], flight, trace, arrived, no_log)
        for k in range(last + 1):
            distances[i, k] = np.sqrt(squared_distance_to(flight.reference, k, trace[k, TRUE]))
        distances[i, last + 1 if cause == NOT_LOST else last :] = np.inf
