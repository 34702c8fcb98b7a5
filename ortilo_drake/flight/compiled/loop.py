"""One flight as one compiled loop; the order of a tick stands in the package's docstring."""

from typing import Any

import numpy as np
from numba import njit
from numba.extending import register_jitable

from ortilo_drake.flight.compiled.borrowed import borrowed
from ortilo_drake.flight.compiled.boxes import detections_of_tick, step_camera
from ortilo_drake.flight.compiled.constants import (
    CameraConstants,
    ImuConstants,
    OtherConstants,
    UwbConstants,
    VehicleConstants,
)
from ortilo_drake.flight.compiled.constants_onboard import FilterConstants, OwnConstants, ServoConstants, TightConstants
from ortilo_drake.flight.compiled.estimators import first, force_of, go_on, handed_of, known_of
from ortilo_drake.flight.compiled.faults import is_read_anyway, spoil
from ortilo_drake.flight.compiled.figures import NEES, position_nees
from ortilo_drake.flight.compiled.kept import Sensed, SensorMemory, first_sensed
from ortilo_drake.flight.compiled.links import delay_through, deliver, step_chain
from ortilo_drake.flight.compiled.others import first_others, read_others, step_others
from ortilo_drake.flight.compiled.slow import SlowConstants, add_errors, seen_by, step_slow
from ortilo_drake.flight.compiled.vehicle import Body, body_at_start, fly_tick, put_sample
from ortilo_drake.flight.lost import NOT_LOST, Bounds, cause_of_loss
from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.signals import IMU_SIZE, N_U, N_X, N_XBAR, PAYLOAD
from ortilo_drake.model.triples import Four, Triple
from ortilo_drake.onboard.servo.lq_servo import command
from ortilo_drake.world.noise import four_normals, put_normals
from ortilo_drake.world.radio.link import NOT_SENT
from ortilo_drake.world.sensors.imu import put_angles
from ortilo_drake.world.sensors.uwb import put_uwb_message


@register_jitable(forceinline=True, error_model="numpy")
def imu_of_tick(
    imu: ImuConstants,
    errors: SlowConstants,
    vehicle: VehicleConstants,
    body: Body,
    kept: SensorMemory,
    samples: np.ndarray,
    k: int,
    h: float,
    seed: int,
    anchors: np.ndarray,
) -> None:
    """Set the imu's message that lands at tick k, zeros if none does.

    Args:
        imu: the imu.
        errors: of its messages that last.
        vehicle: the plant.
        body: of the vehicle.
        kept: of the imu; changed.
        samples: taken inside the tick, where it is faster than the tick (n - 1, 11).
        k: tick.
        h: tick [s].
        seed: of all noise.
        anchors: p_WA_i as they stand (n, 3).
    """
    message, delay, n = kept.message, delay_through(imu.link, k, body.x, kept.bad[0], seed), imu.samples
    fill(message, 0.0)
    if delay != NOT_SENT or is_read_anyway(imu.faults, k * h):
        if n > 1:
            message[0], message[1] = 1.0, k * h
            for i in range(n - 1):
                put(samples[i], message, PAYLOAD + i * IMU_SIZE)
            newest = message[message.size - IMU_SIZE :]
            put_sample(newest, imu, errors, body, kept, vehicle, seed, k * h, h / n, anchors)
        elif imu.whole:
            put_sample(message, imu, errors, body, kept, vehicle, seed, k * h, h, anchors)
        else:
            v = four_normals(seed, imu.stream, tick_of(k * h, h))
            put_angles(message, v, body.x, imu.bias, imu.sd, k * h)
            add_errors(message, errors, kept.slow, False)
            spoil(message, imu.faults, kept.held, body.x, k * h, anchors, seed, h)
    deliver(message, delay, kept.flying, k)


@register_jitable(forceinline=True, error_model="numpy")
def uwb_of_tick(
    uwb: UwbConstants, errors: SlowConstants, kept: SensorMemory, x: np.ndarray, k: int, h: float, seed: int
) -> None:
    """Set the uwb message that lands at tick k, zeros if none does; x is the true state, else as imu_of_tick."""
    message, delay = kept.message, delay_through(uwb.link, k, x, kept.bad[0], seed)
    fill(message, 0.0)
    if delay != NOT_SENT or is_read_anyway(uwb.faults, k * h):
        seen = seen_by(uwb.clock, x, k * h)
        put_normals(kept.noise, seed, uwb.stream, tick_of(k * h, h))
        put_uwb_message(message, kept.noise, seen, uwb.anchors, uwb.bias, uwb.walls, uwb.settings, k * h)
        add_errors(message, errors, kept.slow, True)
        spoil(message, uwb.faults, kept.held, seen, k * h, uwb.anchors, seed, h)
    deliver(message, delay, kept.flying, k)


@register_jitable(forceinline=True, error_model="numpy")
def control_of(servo: ServoConstants, force: Triple, xhat: np.ndarray, x: np.ndarray, reference: np.ndarray) -> Four:
    """Return u_k; force is what is believed to act, and x the true state, of which velocities may be lent."""
    xbar = xhat
    if servo.lent:
        xbar = xhat.copy()
        put(x[6:N_X], xbar, 6)
    return command(xbar, reference, servo.L, servo.mass, servo.yaw, servo.error_form, force)


@njit(cache=True, error_model="numpy")
def start_one(
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
) -> tuple[Body, Any, Sensed, tuple[SensorMemory, ...]]:
    """Return the vehicle's body and what estimator and sensors keep, at the start of a flight; of FlightConstants."""
    sensed = first_sensed(imu, imu_errors, uwb, uwb_errors, camera)
    return body_at_start(vehicle, force, x_0), first(estimator), sensed, first_others(others)


@njit(cache=True, nogil=True, error_model="numpy")
def fly_one(
    seeds: np.ndarray,
    trace: np.ndarray,
    arrived: np.ndarray,
    log: np.ndarray,
    body: Body,
    memory: Any,
    sensed: Sensed,
    others_kept: tuple[SensorMemory, ...],
    h: float,
    reference: np.ndarray,
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
        sensed: of uwb, imu and camera, likewise.
        others_kept: of the other sensors, likewise.
        h: as all that follow, of FlightConstants, in its order.
        reference: likewise.
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
    body, memory, sensed, others_kept = borrowed(body), borrowed(memory), borrowed(sensed), borrowed(others_kept)
    handled = estimator.handled
    p, s, q = handled.first[-1], handled.first.size - 1, handled.block[-1]
    last, x, u, anchors = reference.shape[0] - 1, body.x, body.u, uwb.anchors
    fill(arrived, 0.0)
    for k in range(last + 1):
        seed, r = seeds[k], reference[k]
        known = known_of(estimator, memory)
        imu_of_tick(imu, imu_errors, vehicle, body, sensed.imu, sensed.samples, k, h, seed, anchors)
        uwb_of_tick(uwb, uwb_errors, sensed.uwb, x, k, h, seed)
        detections_of_tick(camera, sensed.camera, x, k, h, seeds, anchors)
        read_others(others, others_kept, (x, k, h, seed, anchors))
        handed = handed_of(estimator, memory, uwb, camera, sensed, known, k, h, others, others_kept)
        put(control_of(servo, force_of(estimator, memory), known[:N_XBAR], x, r), u)
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
        go_on(estimator, memory, handed, sensed, k, h, u, vehicle.hover_thrust, r)
        step_chain(imu.link, k, sensed.imu.bad, seed)
        step_chain(uwb.link, k, sensed.uwb.bad, seed)
        step_camera(camera, sensed.camera, k, seed)
        step_others(others, others_kept, (k, h, seed))
        step_slow(sensed.imu.slow, imu_errors, k, h, seed)
        step_slow(sensed.uwb.slow, uwb_errors, k, h, seed)
        fly_tick(vehicle, force, imu, imu_errors, body, sensed.imu, sensed.samples, k, h, seed, anchors)
    return last, NOT_LOST
