"""The vehicle in a compiled flight: what its body feels of a control, and what becomes of it in a tick.

A continuous plant goes by the steps that Drake's simulator is told to take (flight/simulator.py), a sampled one by its
own step. A drawn truth changes what the rotors make of a command (world/vehicle/wrench_error.py) and adds a force that
lasts.
"""

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.flight.compiled.constants import ImuConstants, VehicleConstants
from ortilo_drake.flight.compiled.faults import spoil, spoil_force, spoil_wrench
from ortilo_drake.flight.compiled.kept import SensorMemory
from ortilo_drake.flight.compiled.slow import SlowConstants, add_errors, step_slow
from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.equations import derivative, stepped
from ortilo_drake.model.placing import put
from ortilo_drake.model.signals import N_U
from ortilo_drake.world.noise import put_normals
from ortilo_drake.world.sensors.imu import put_imu_message
from ortilo_drake.world.vehicle.disturbance import put_disturbance
from ortilo_drake.world.vehicle.rotors import commanded_speeds, rotor_acceleration, times, wrench_of

_STRETCH = 1.01  # by which Drake lengthens a step that would end just before an event [1]


class Body(NamedTuple):
    """The vehicle's state, changed in place.

    Attributes:
        x: state (12).
        speeds: of the rotors [rad/s] (n); none where they are ideal.
        u: control of the tick (4).
        held: control that is held over the tick, as it leaves the hold (4).
        d: disturbance that is held (6).
        lasting: slow part of the lasting force, x_k of world/slow_error.py (6 or 0).
    """

    x: np.ndarray
    speeds: np.ndarray
    u: np.ndarray
    held: np.ndarray
    d: np.ndarray
    lasting: np.ndarray


@register_jitable
def body_at_start(vehicle: VehicleConstants, force: SlowConstants, x_0: np.ndarray) -> Body:
    """Return the vehicle hovering at x_0 (12)."""
    held = np.zeros(N_U)
    held[0] = vehicle.hover_thrust
    return Body(x_0.copy(), vehicle.hover_speeds.copy(), np.zeros(N_U), held, np.zeros(6), force.start.copy())


@register_jitable
def product_into(out: np.ndarray, M: np.ndarray, v: np.ndarray) -> None:
    """Write M v to out, each row summed from the left as rotors.times has it, without an array of its own."""
    for i in range(out.size):
        total = M[i, 0] * v[0]
        for j in range(1, v.size):
            total += M[i, j] * v[j]
        out[i] = total


@register_jitable
def control_felt(vehicle: VehicleConstants, speeds: np.ndarray, held: np.ndarray, t: float) -> np.ndarray:
    """Return u as it acts on the body (4) at t [s]: what is held, or what the rotors make at these speeds."""
    if speeds.size == 0:
        return held
    u = times(vehicle.wrench, wrench_of(speeds, vehicle.mixing))
    spoil_wrench(u, vehicle.faults, t)
    return u


@register_jitable
def _rates(
    vehicle: VehicleConstants, x: np.ndarray, speeds: np.ndarray, commanded: np.ndarray, body: Body, t: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the time derivatives of x and of the rotors' speeds at t [s]."""
    u = control_felt(vehicle, speeds, body.held, t)
    x_dot = derivative(x, u, body.d, vehicle.mass, vehicle.inertia, vehicle.kinematics)
    if speeds.size == 0:
        return x_dot, speeds
    return x_dot, rotor_acceleration(speeds, commanded, vehicle.time_constant)


@register_jitable
def integrate(
    longest_step: float, vehicle: VehicleConstants, body: Body, commanded: np.ndarray, start: float, end: float
) -> None:
    """Go on from one time to another [s], by the steps and the arithmetic of Drake's RungeKutta3Integrator."""
    x, speeds, t = body.x, body.speeds, start
    while t < end:
        target = t + longest_step if t + _STRETCH * longest_step < end else end
        dt = target - t
        a, p = _rates(vehicle, x, speeds, commanded, body, t)
        b, q = _rates(vehicle, x + dt / 2.0 * a, speeds + dt / 2.0 * p, commanded, body, t + dt / 2.0)
        x_b, speeds_b = x + (2.0 * dt * b - dt * a), speeds + (2.0 * dt * q - dt * p)
        c, r = _rates(vehicle, x_b, speeds_b, commanded, body, target)
        for i in range(x.size):
            x[i] += dt / 6.0 * a[i] + 4.0 * (dt / 6.0) * b[i] + dt / 6.0 * c[i]
        for i in range(speeds.size):
            speeds[i] += dt / 6.0 * p[i] + 4.0 * (dt / 6.0) * q[i] + dt / 6.0 * r[i]
        t = target


@register_jitable(forceinline=True, error_model="numpy")
def disturb(vehicle: VehicleConstants, body: Body, force: SlowConstants, k: int, h: float, seed: int) -> None:
    """Write d_k: white, with the force that lasts, and with the faults."""
    d = body.d
    put_disturbance(d, vehicle.force_sd, vehicle.torque_sd, seed, vehicle.stream, k * h, h)
    for i in range(force.a.size):
        d[i] += force.bias[i] + body.lasting[i]
    spoil_force(d, vehicle.faults, k * h)


@register_jitable
def put_sample(
    message: np.ndarray,
    imu: ImuConstants,
    errors: SlowConstants,
    body: Body,
    kept: SensorMemory,
    vehicle: VehicleConstants,
    seed: int,
    time: float,
    h: float,
    anchors: np.ndarray,
) -> None:
    """Write the imu's whole message of an instant (11), with what lasts of its errors; h is its own period [s]."""
    u = control_felt(vehicle, body.speeds, body.held, time)
    put_normals(kept.noise, seed, imu.stream, tick_of(time, h))
    put_imu_message(message, kept.noise, body.x, u, body.d, vehicle.mass, imu.bias, imu.sd, time)
    add_errors(message, errors, kept.slow, False)
    spoil(message, imu.faults, kept.held, body.x, time, anchors, seed, h)


@register_jitable
def fly_continuously(
    longest_step: float | None,
    vehicle: VehicleConstants,
    imu: ImuConstants,
    errors: SlowConstants,
    body: Body,
    kept: SensorMemory,
    samples: np.ndarray,
    k: int,
    h: float,
    seed: int,
    anchors: np.ndarray,
) -> None:
    """Go through a tick by Drake's steps, from one sample of the imu to the next.

    Args:
        longest_step: of the vehicle. It is None where the plant is sampled, and numba then compiles nothing of this.
        vehicle: the plant.
        imu: the imu.
        errors: of it that last.
        body: of the vehicle; changed.
        kept: of the imu, its slow errors those of tick k + 1; changed.
        samples: of the imu inside the tick, oldest first (n - 1, 11); changed.
        k: tick.
        h: tick [s].
        seed: of all noise.
        anchors: p_WA_i as they stand (n, 3).
    """
    if longest_step is None:
        return
    u, has_rotors = body.u, vehicle.hover_speeds.size > 0
    commanded = commanded_speeds(u, vehicle.unmixing, vehicle.max_speed) if has_rotors else u
    n, start = samples.shape[0] + 1, k * h
    for i in range(1, n):
        time = h * (i / n) + k * h
        integrate(longest_step, vehicle, body, commanded, start, time)
        put_sample(samples[i - 1], imu, errors, body, kept, vehicle, seed, time, h / n, anchors)
        start = time
    integrate(longest_step, vehicle, body, commanded, start, (k + 1) * h)


@register_jitable(forceinline=True, error_model="numpy")
def fly_tick(
    vehicle: VehicleConstants,
    force: SlowConstants,
    imu: ImuConstants,
    errors: SlowConstants,
    body: Body,
    kept: SensorMemory,
    samples: np.ndarray,
    k: int,
    h: float,
    seed: int,
    anchors: np.ndarray,
) -> None:
    """Go on from tick k to the next under body.u; changes body, and samples if the imu is faster than the tick.

    Args:
        vehicle: the plant.
        force: that lasts.
        imu: the imu.
        errors: of it that last.
        body: of the vehicle.
        kept: of the imu, its slow errors already those of tick k + 1.
        samples: of the imu inside the tick, oldest first (n - 1, 11).
        k: tick.
        h: tick [s].
        seed: of all noise.
        anchors: p_WA_i as they stand (n, 3).
    """
    disturb(vehicle, body, force, k, h, seed)
    step_slow(body.lasting, force, k, h, seed)
    if vehicle.hover_speeds.size > 0:
        put(body.u, body.held)
    else:
        product_into(body.held, vehicle.wrench, body.u)
        spoil_wrench(body.held, vehicle.faults, k * h)
    if vehicle.longest_step is None:
        put(stepped(body.x, body.held, body.d, vehicle.mass, vehicle.inertia, vehicle.kinematics, h), body.x)
    else:
        fly_continuously(vehicle.longest_step, vehicle, imu, errors, body, kept, samples, k, h, seed, anchors)
