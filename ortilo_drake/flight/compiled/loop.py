"""One flight as one compiled loop; the order of a tick stands in the package's docstring."""

import numpy as np
from numba import njit
from numba.extending import register_jitable

from ortilo_drake.flight.compiled.constants import (
    FilterConstants,
    FlightConstants,
    ImuConstants,
    LinkConstants,
    ServoConstants,
    UwbConstants,
)
from ortilo_drake.flight.compiled.figures import ESTIMATED, NEES, TRUE, figures_of, position_nees
from ortilo_drake.flight.lost import NOT_LOST, cause_of_loss
from ortilo_drake.model.equations import step
from ortilo_drake.model.signals import ARRIVED, IMU_SIZE, N_U, N_X, N_XBAR, PAYLOAD, STAMP
from ortilo_drake.onboard.estimator.belief import known_part
from ortilo_drake.onboard.estimator.filter_loops import filter_step
from ortilo_drake.onboard.estimator.imu_rows import with_imu_rows
from ortilo_drake.onboard.estimator.measurement_handler import NEVER, stack_measurements
from ortilo_drake.onboard.ranging.multilateration import fix_message
from ortilo_drake.onboard.servo.lq_servo import servo_control
from ortilo_drake.world.radio.link import NOT_SENT, chain_after, delay_of_tick, landing_row, put_in_flight
from ortilo_drake.world.sensors.imu import imu_message
from ortilo_drake.world.sensors.uwb import uwb_message
from ortilo_drake.world.vehicle.disturbance import disturbance_at


@register_jitable
def empty_link(link: LinkConstants, size: int) -> np.ndarray:
    """Return what a link has in flight at first: nothing, rows (tick of arrival, message of that size)."""
    flying = np.zeros((link.delays[0] + link.delays[1], 1 + size))
    flying[:, 0] = -1.0
    return flying


@register_jitable
def delay_through(link: LinkConstants, k: int, x: np.ndarray, bad: bool, seed: int) -> int:
    """Return the delay of the message of tick k [ticks], NOT_SENT where none is sent."""
    if link.every == 0:
        return NOT_SENT
    return delay_of_tick(k, link.every, x, bad, link.loss, link.blackouts, link.delays, seed, link.stream)


@register_jitable
def deliver(message: np.ndarray, delay: int, flying: np.ndarray, k: int) -> None:
    """Overwrite the message of tick k by the one that lands in it, zeros if none does; put it in flight if it is late.

    Args:
        message: of this tick, read where it is sent (n).
        delay: of delay_through.
        flying: what is in flight.
        k: tick.
    """
    landed = landing_row(flying, k, message[STAMP] if delay == 0 else -np.inf)
    late = flying[landed, 1:].copy() if landed != NOT_SENT else message
    if delay > 0:
        put_in_flight(flying, k + delay, message)
    if landed != NOT_SENT:
        message[:] = late
    elif delay != 0:
        message[:] = 0.0


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
        message = imu_message(x, u, d, mass, imu.bias, imu.sd, seed, imu.stream, k * h, h)
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
def measured(
    flight: FilterConstants, uwb: UwbConstants, ranges: np.ndarray, imu: np.ndarray, known: np.ndarray, k: int, h: float
) -> np.ndarray:
    """Return the handler's [y, delta, V2, stamps] of what landed at tick k, known the belief of [x; i]."""
    messages = np.zeros(flight.size)
    xhat, P = known[:N_XBAR], known[N_XBAR:]
    if ranges[ARRIVED] != 0.0:
        fix = fix_message(ranges, uwb.surveyed, uwb.noise, xhat, uwb.three)
        messages[flight.first[0] : flight.first[0] + fix.size] = fix
    if imu[ARRIVED] != 0.0:
        messages[flight.first[1] : flight.first[1] + imu.size] = imu
    return stack_measurements(messages, xhat, P, k if flight.drops else NEVER, h, flight.incoming, flight.handled)


@njit(cache=True, nogil=True)
def fly_one(
    seed: int, flight: FlightConstants, trace: np.ndarray, arrived: np.ndarray, log: np.ndarray
) -> tuple[int, int]:
    """Fly one seed and write what it leaves behind; return its last tick and the cause of its loss, see lost.CAUSES.

    Args:
        seed: of all noise.
        flight: what decides it beside.
        trace: a row for each tick, see figures.py (ticks + 1, TRACE_SIZE).
        arrived: in how many ticks each sensor's value reached the filter (s).
        log: a row for each tick, see Measurement.logged_sizes (ticks + 1, w); (0, w) for none.
    """
    h, vehicle, imu, uwb, servo, estimator = (
        flight.h,
        flight.vehicle,
        flight.imu,
        flight.uwb,
        flight.servo,
        flight.filter,
    )
    handled = estimator.handled
    p, s, q = handled.first[-1], handled.first.size - 1, handled.block[-1]
    x, u, d, hover = np.zeros(N_X), np.zeros(N_U), np.zeros(6), np.zeros(N_U)
    x[0:3], x[5] = flight.reference[0, 0:3], flight.yaw
    hover[0] = vehicle.hover_thrust
    u[:] = hover
    belief = estimator.belief_0.copy()
    n = N_XBAR + len(estimator.model.extra)
    uwb_flying = empty_link(uwb.link, PAYLOAD + 2 * uwb.anchors.shape[0])
    imu_flying = empty_link(imu.link, IMU_SIZE)
    uwb_bad = imu_bad = False
    last = flight.reference.shape[0] - 1
    arrived[:] = 0.0
    for k in range(last + 1):
        r = flight.reference[k]
        known = known_part(belief, n)
        imu_landed = imu_of_tick(imu, vehicle.mass, x, u, d, k, h, seed, imu_bad, imu_flying)
        ranges = uwb_of_tick(uwb, x, k, h, seed, uwb_bad, uwb_flying)
        handed = measured(estimator, uwb, ranges, imu_landed, known, k, h)
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
        y, delta, V2 = with_imu_rows(
            handed[:p],
            handed[p : p + s],
            handed[p + s : p + s + q],
            imu_landed,
            estimator.imu_number,
            estimator.imu_variances,
        )
        belief = filter_step(belief, y, delta, V2, u - hover, r, estimator.model, estimator.layout)
        d = disturbance_at(vehicle.force_sd, vehicle.torque_sd, seed, vehicle.stream, k * h, h)
        x = step(x, u, d, vehicle.mass, vehicle.inertia, vehicle.kinematics, h)
        if imu.link.has_chain:
            imu_bad = chain_after(k, imu_bad, imu.link.loss, seed, imu.link.stream)
        if uwb.link.has_chain:
            uwb_bad = chain_after(k, uwb_bad, uwb.link.loss, seed, uwb.link.stream)
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
    no_log = np.zeros((0, 0))
    for i in range(seeds.size):
        last, cause = fly_one(seeds[i], flight, trace, arrived[i], no_log)
        figures[i, 0], figures[i, 1] = last, cause
        figures_of(trace[: last + 1], flight.reference[: last + 1, :3], figures[i])
