"""The vehicle where its state is continuous: a rigid body, with rotors that take time, between two ticks.

It goes by the steps and the arithmetic of Drake's RungeKutta3Integrator, as flight/simulator.py has Drake take them.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.model.equations import accelerations
from ortilo_drake.model.placing import put
from ortilo_drake.model.signals import N_X
from ortilo_drake.scenario import Scenario
from ortilo_drake.world.faults.table import FaultTable
from ortilo_drake.world.faults.vehicle_faults import wrench_at
from ortilo_drake.world.vehicle.rotors import put_acceleration, put_times

PASSED: Final = N_X + 3  # of an instant inside the tick: the state and v_dot
_STRETCH = 1.01  # by which Drake lengthens a step that would end just before an event [1]


class Physics(NamedTuple):
    """The forces, torques and rotors that move the vehicle.

    Attributes:
        mass: m [kg].
        inertia: I_x, I_y, I_z [kg m^2].
        kinematics: index in KINEMATICS.
        longest_step: of the integration [s].
        time_constant: of a rotor speeding up and slowing down [s] (2).
        wrench: T of wrench_error.py (4, 4).
        mixing: M of the rotors' squared speeds (4, n); (4, 0) of rotors without dynamics.
        faults: of wrench_table, where the rotors have dynamics.
    """

    mass: float
    inertia: np.ndarray
    kinematics: int
    longest_step: float
    time_constant: np.ndarray
    wrench: np.ndarray
    mixing: np.ndarray
    faults: FaultTable


def steps_a_tick(scenario: Scenario) -> int:
    """Return into how many steps a tick of a continuous plant is divided: rotors' lag is shorter than a tick.

    Of a lag tau the method is stable for steps up to 2.51 tau; here they are at most 2 tau.
    """
    if scenario.world.rotors.kind != "first_order":
        return 1
    return max(4, math.ceil(scenario.h / (2.0 * min(scenario.vehicle.rotor_time_constant))))


@register_jitable
def put_felt(
    u: np.ndarray,
    speeds: np.ndarray,
    wrench: np.ndarray,
    mixing: np.ndarray,
    faults: FaultTable,
    t: float,
    room: np.ndarray,
) -> None:
    """Write u as it acts on the body (4) at t [s], as the rotors make it at these speeds (n) [rad/s].

    The wrench is T of wrench_error.py (4, 4), the mixing M of the rotors' squared speeds (4, n), the faults those of
    wrench_table. It works in room (n + 4).
    """
    squared, made = room[: speeds.size], room[speeds.size :]
    for i in range(speeds.size):
        squared[i] = speeds[i] * speeds[i]
    put_times(made, mixing, squared)
    put_times(u, wrench, made)
    if faults.kinds.size > 0:
        put(wrench_at(u, faults, t), u)


@register_jitable
def put_control(
    physics: Physics, body: np.ndarray, held: np.ndarray, t: float, u: np.ndarray, room: np.ndarray
) -> None:
    """Write u as it acts on the body (4) at t [s]: the held control, or the rotors' wrench."""
    if body.size == N_X:
        put(held, u)
    else:
        put_felt(u, body[N_X:], physics.wrench, physics.mixing, physics.faults, t, room)


@register_jitable
def put_rates(
    rates: np.ndarray,
    physics: Physics,
    body: np.ndarray,
    commanded: np.ndarray,
    held: np.ndarray,
    d: np.ndarray,
    t: float,
    u: np.ndarray,
    room: np.ndarray,
) -> None:
    """Write the time derivatives of x and of the rotors' speeds at t [s] (12 + n)."""
    put_control(physics, body, held, t, u, room)
    put(body[6:N_X], rates)
    put(accelerations(body[:N_X], u, d, physics.mass, physics.inertia, physics.kinematics), rates, 6)
    put_acceleration(rates[N_X:], body[N_X:], commanded, physics.time_constant)


@register_jitable
def integrate(
    physics: Physics,
    body: np.ndarray,
    commanded: np.ndarray,
    held: np.ndarray,
    d: np.ndarray,
    start: float,
    end: float,
    rates: np.ndarray,
    u: np.ndarray,
    room: np.ndarray,
) -> None:
    """Go on from one time to another [s]; changes the body, x and the speeds of rotors with dynamics [rad/s] (12 + n).

    Those are to have the speeds commanded (n); u is held of rotors without dynamics (4); d is the disturbance (6). It
    works in rates (4, 12 + n), u (4) and room (n + 4).
    """
    a, b, c, between, t = rates[0], rates[1], rates[2], rates[3], start
    while t < end:
        target = t + physics.longest_step if t + _STRETCH * physics.longest_step < end else end
        dt = target - t
        put_rates(a, physics, body, commanded, held, d, t, u, room)
        for i in range(body.size):
            between[i] = body[i] + dt / 2.0 * a[i]
        put_rates(b, physics, between, commanded, held, d, t + dt / 2.0, u, room)
        for i in range(body.size):
            between[i] = body[i] + (2.0 * dt * b[i] - dt * a[i])
        put_rates(c, physics, between, commanded, held, d, target, u, room)
        for i in range(body.size):
            body[i] += dt / 6.0 * a[i] + 4.0 * (dt / 6.0) * b[i] + dt / 6.0 * c[i]
        t = target
