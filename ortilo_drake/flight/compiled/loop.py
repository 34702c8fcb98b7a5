"""One flight as one compiled loop; the order of a tick stands in the package's docstring."""

from typing import Any

import numpy as np
from numba import njit
from numba.extending import register_jitable

from ortilo_drake.flight.compiled.borrowed import borrowed
from ortilo_drake.flight.compiled.boxes import camera_chain, detections_of_tick, empty_camera_link, held_by_camera
from ortilo_drake.flight.compiled.constants import (
    CameraConstants,
    ImuConstants,
    OtherConstants,
    UwbConstants,
    VehicleConstants,
)
from ortilo_drake.flight.compiled.constants_onboard import FilterConstants, OwnConstants, ServoConstants, TightConstants
from ortilo_drake.flight.compiled.estimators import first, force_of, go_on, handed_of, known_of
from ortilo_drake.flight.compiled.faults import held_at_first, is_read_anyway, said_of
from ortilo_drake.flight.compiled.figures import NEES, position_nees
from ortilo_drake.flight.compiled.links import chain_of_tick, delay_through, deliver, empty_link
from ortilo_drake.flight.compiled.others import first_others, read_others, step_others
from ortilo_drake.flight.compiled.slow import SlowConstants, seen_by, slow_after, with_errors
from ortilo_drake.flight.compiled.vehicle import Body, body_at_start, fly_tick, sample_of_imu
from ortilo_drake.flight.lost import NOT_LOST, Bounds, cause_of_loss
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.signals import IMU_SIZE, N_U, N_X, N_XBAR, PAYLOAD
from ortilo_drake.onboard.servo.lq_servo import servo_control
from ortilo_drake.world.radio.link import NOT_SENT
from ortilo_drake.world.sensors.imu import attitude_message
from ortilo_drake.world.sensors.uwb import uwb_message


@register_jitable(forceinline=True, error_model="numpy")
def imu_of_tick(
    imu: ImuConstants,
    errors: SlowConstants,
    vehicle: VehicleConstants,
    body: Body,
    slow: np.ndarray,
    samples: np.ndarray,
    k: int,
    h: float,
    seed: int,
    bad: bool,
    flying: np.ndarray,
    held: np.ndarray,
    anchors: np.ndarray,
) -> np.ndarray:
    """Return the imu's message that lands at tick k, zeros if none does.

    Args:
        imu: the imu.
        errors: of its messages that last.
        vehicle: the plant.
        body: of the vehicle.
        slow: slow part of the errors.
        samples: taken inside the tick, where it is faster than the tick (n - 1, 11).
        k: tick.
        h: tick [s].
        seed: of all noise.
        bad: whether the link's chain is bad.
        flying: what is in flight.
        held: what the sensor holds if it is to be stuck, see faults.said_of; changed.
        anchors: p_WA_i as they stand (n, 3).
    """
    delay, n = delay_through(imu.link, k, body.x, bad, seed), imu.samples
    read = delay != NOT_SENT or is_read_anyway(imu.faults, k * h)
    if n > 1:
        message = np.zeros(PAYLOAD + n * IMU_SIZE)
        if read:
            message[0], message[1] = 1.0, k * h
            for i in range(n - 1):
                put(samples[i], message, PAYLOAD + i * IMU_SIZE)
            newest = sample_of_imu(imu, errors, body, slow, vehicle, seed, k * h, h / n, held, anchors)
            put(newest, message, message.size - IMU_SIZE)
    elif not read:
        message = np.zeros(IMU_SIZE)
    elif imu.whole:
        message = sample_of_imu(imu, errors, body, slow, vehicle, seed, k * h, h, held, anchors)
    else:
        message = attitude_message(body.x, imu.bias, imu.sd, seed, imu.stream, k * h, h)
        message = with_errors(message, errors, slow, False)
        message = said_of(message, imu.faults, held, body.x, k * h, anchors, seed, h)
    deliver(message, delay, flying, k)
    return message


@register_jitable(forceinline=True, error_model="numpy")
def uwb_of_tick(
    uwb: UwbConstants,
    errors: SlowConstants,
    slow: np.ndarray,
    x: np.ndarray,
    k: int,
    h: float,
    seed: int,
    bad: bool,
    flying: np.ndarray,
    held: np.ndarray,
) -> np.ndarray:
    """Return the uwb message that lands at tick k, zeros if none does; arguments as imu_of_tick's and uwb_message's."""
    delay = delay_through(uwb.link, k, x, bad, seed)
    if delay == NOT_SENT and not is_read_anyway(uwb.faults, k * h):
        message = np.zeros(PAYLOAD + 2 * uwb.anchors.shape[0])
    else:
        seen = seen_by(uwb.clock, x, k * h)
        message = uwb_message(seen, uwb.anchors, uwb.bias, uwb.walls, uwb.settings, seed, uwb.stream, k * h, h)
        message = with_errors(message, errors, slow, True)
        message = said_of(message, uwb.faults, held, seen, k * h, uwb.anchors, seed, h)
    deliver(message, delay, flying, k)
    return message


@register_jitable(forceinline=True, error_model="numpy")
def control_of(
    servo: ServoConstants, force: np.ndarray, xhat: np.ndarray, x: np.ndarray, reference: np.ndarray
) -> np.ndarray:
    """Return u_k; force is what is believed to act (3), and x the true state, of which velocities may be lent."""
    xbar = xhat
    if servo.lent:
        xbar = xhat.copy()
        put(x[6:N_X], xbar, 6)
    return servo_control(xbar, reference, servo.L, servo.mass, servo.yaw, servo.error_form, force)


@njit(cache=True)
def start_one(
    vehicle: VehicleConstants,
    force: SlowConstants,
    x_0: np.ndarray,
    estimator: FilterConstants | TightConstants | OwnConstants,
) -> tuple[Body, Any]:
    """Return the vehicle's body and what the estimator keeps, at the start of a flight; of FlightConstants."""
    return body_at_start(vehicle, force, x_0), first(estimator)


@njit(cache=True, nogil=True, error_model="numpy")
def fly_one(
    seeds: np.ndarray,
    trace: np.ndarray,
    arrived: np.ndarray,
    log: np.ndarray,
    body: Body,
    memory: Any,
    h: float,
    reference: np.ndarray,
    x_0: np.ndarray,
    vehicle: VehicleConstants,
    force: SlowConstants,
    imu: ImuConstants,
    imu_errors: SlowConstants,
    uwb: UwbConstants,
    uwb_errors: SlowConstants,
    camera: CameraConstants | None,
    others: tuple[OtherConstants, ...],
    estimator: FilterConstants | TightConstants | OwnConstants,
    servo: ServoConstants,
    bounds: Bounds,
) -> tuple[int, int]:
    """Fly once and write what it leaves behind; return its last tick and the cause of its loss, see lost.CAUSES.

    The constants are handed over one by one: numba passes a tuple by all it holds, at every name that is read of it.

    Args:
        seeds: of all noise, at each tick (ticks + 1): one and the same for a flight of a seed, another from some tick
            on for one that branches off it. What is drawn at the start is among the constants.
        trace: a row for each tick, see figures.py (ticks + 1, TRACE_SIZE).
        arrived: in how many ticks each sensor's value reached the filter (s).
        log: a row for each tick, see Measurement.logged_sizes (ticks + 1, w); (0, w) for none.
        body: of the vehicle at the start, of start_one; changed.
        memory: of the estimator, likewise.
        h: as all that follow, of FlightConstants, in its order.
        reference: likewise.
        x_0: likewise.
        vehicle: likewise.
        force: likewise.
        imu: likewise.
        imu_errors: likewise.
        uwb: likewise.
        uwb_errors: likewise.
        camera: likewise.
        others: likewise.
        estimator: likewise, its filter.
        servo: likewise.
        bounds: likewise.
    """
    vehicle, imu, uwb = borrowed(vehicle), borrowed(imu), borrowed(uwb)
    camera, estimator = borrowed(camera), borrowed(estimator)
    force, imu_errors, uwb_errors = borrowed(force), borrowed(imu_errors), borrowed(uwb_errors)
    servo, bounds, reference, others = borrowed(servo), borrowed(bounds), borrowed(reference), borrowed(others)
    trace, arrived, log = borrowed(trace), borrowed(arrived), borrowed(log)
    body, memory = borrowed(body), borrowed(memory)
    handled = estimator.handled
    p, s, q = handled.first[-1], handled.first.size - 1, handled.block[-1]
    imu_slow, uwb_slow = imu_errors.start.copy(), uwb_errors.start.copy()
    others_kept = first_others(others)
    samples = np.zeros((imu.samples - 1, IMU_SIZE))
    uwb_flying = empty_link(uwb.link, PAYLOAD + 2 * uwb.anchors.shape[0])
    size = IMU_SIZE if imu.samples == 1 else PAYLOAD + imu.samples * IMU_SIZE
    imu_flying, camera_flying = empty_link(imu.link, size), empty_camera_link(camera)
    uwb_held, camera_held = held_at_first(uwb.faults, 2 * uwb.anchors.shape[0]), held_by_camera(camera)
    imu_held, anchors = held_at_first(imu.faults, IMU_SIZE - PAYLOAD), uwb.anchors
    uwb_bad = imu_bad = camera_bad = False
    last = reference.shape[0] - 1
    fill(arrived, 0.0)
    for k in range(last + 1):
        seed, r, x = seeds[k], reference[k], body.x
        known = known_of(estimator, memory)
        felt = imu_of_tick(
            imu, imu_errors, vehicle, body, imu_slow, samples, k, h, seed, imu_bad, imu_flying, imu_held, anchors
        )
        ranges = uwb_of_tick(uwb, uwb_errors, uwb_slow, x, k, h, seed, uwb_bad, uwb_flying, uwb_held)
        detections = detections_of_tick(camera, x, k, h, seeds, camera_bad, camera_flying, camera_held, anchors)
        read_others(others, others_kept, (x, k, h, seed, anchors))
        handed = handed_of(estimator, memory, uwb, camera, ranges, felt, detections, known, k, h, others, others_kept)
        u = control_of(servo, force_of(estimator, memory), known[:N_XBAR], x, r)
        for j in range(s):
            arrived[j] += handed[p + j]
        for i in range(3):
            trace[k, i], trace[k, 3 + i] = x[i], known[i]
        trace[k, NEES] = position_nees(x, known, known[N_XBAR:])
        if log.shape[0] > 0:
            at = N_X + N_U + p + s + q
            put(x, log[k])
            put(u, log[k], N_X)
            put(handed[: p + s + q], log[k], N_X + N_U)
            put(known, log[k], at)
            put(r, log[k], at + known.size)
        cause = cause_of_loss(x, bounds)
        if cause != NOT_LOST:
            return k, cause
        if k == last:
            break
        go_on(estimator, memory, handed, ranges, felt, detections, k, h, u, vehicle.hover_thrust, r)
        imu_bad, uwb_bad = chain_of_tick(imu.link, k, imu_bad, seed), chain_of_tick(uwb.link, k, uwb_bad, seed)
        step_others(others, others_kept, (k, h, seed))
        camera_bad = camera_chain(camera, k, camera_bad, seed)
        imu_slow, uwb_slow = slow_after(imu_slow, imu_errors, k, h, seed), slow_after(uwb_slow, uwb_errors, k, h, seed)
        fly_tick(vehicle, force, imu, imu_errors, body, imu_slow, samples, u, k, h, seed, imu_held, anchors)
    return last, NOT_LOST
