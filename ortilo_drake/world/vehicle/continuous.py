"""The vehicle as a continuous system, integrated from tick to tick: a rigid body, and rotors with a lag.

The integration has the steps and the arithmetic of Drake's RungeKutta3Integrator, as flight/flight.py sets it up.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.equations import KINEMATICS, accelerations, velocity_rate
from ortilo_drake.model.placing import put
from ortilo_drake.model.signals import N_U, N_X
from ortilo_drake.model.vehicle import mixing_inverse, mixing_matrix
from ortilo_drake.scenario import Scenario
from ortilo_drake.world.faults.table import FaultTable
from ortilo_drake.world.faults.vehicle_faults import wrench_at, wrench_table
from ortilo_drake.world.vehicle.rotors import commanded_speeds, put_acceleration, put_times

PASSED: Final = N_X + 3  # size of what is kept of an instant inside the tick: the state and v_dot
_STRETCH = 1.01  # by which Drake lengthens a step that would end just before an event [1]


class Physics(NamedTuple):
    """The forces, torques and rotors that move the vehicle in a tick."""

    mass: float
    """m [kg]."""
    inertia: np.ndarray
    """I_x, I_y, I_z [kg m^2]."""
    kinematics: int
    """index in KINEMATICS."""
    longest_step: float
    """longest step of the integration [s]."""
    time_constant: np.ndarray
    """time constants of a rotor speeding up and slowing down [s] (2)."""
    wrench: np.ndarray
    """T of rotors.wrench_matrix (4, 4)."""
    mixing: np.ndarray
    """M of the rotors' squared speeds (4, n); (4, 0) of rotors without dynamics."""
    faults: FaultTable
    """faults of wrench_table, where the rotors have dynamics."""
    commanded: np.ndarray
    """commanded speeds of rotors with dynamics, held over the tick [rad/s] (n)."""
    held: np.ndarray
    """control of rotors without dynamics, held over the tick (4)."""
    d: np.ndarray
    """disturbance, held over the tick (6)."""


def steps_a_tick(scenario: Scenario) -> int:
    """Return the number of steps into which a continuous plant's tick is divided, since rotors' lag is below a tick.

    For a lag tau the method is stable up to steps of 2.51 tau; here a step is at most 2 tau.
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
    """Write the control u (4) that acts on the body at t [s], made by rotors at these speeds (n) [rad/s].

    wrench (4, 4) is T of rotors.wrench_matrix, mixing (4, n) is M of the rotors' squared speeds, and faults are those
    of wrench_table. room (n + 4) is work space.
    """
    squared, made = room[: speeds.size], room[speeds.size :]
    for i in range(speeds.size):
        squared[i] = speeds[i] * speeds[i]
    put_times(made, mixing, squared)
    put_times(u, wrench, made)
    if faults.kinds.size > 0:
        put(wrench_at(u, faults, t), u)


@register_jitable
def put_control(physics: Physics, body: np.ndarray, t: float, u: np.ndarray, room: np.ndarray) -> None:
    """Write the control u (4) that acts on the body at t [s]: the held control, or the lagging rotors' wrench."""
    if body.size == N_X:
        put(physics.held, u)
    else:
        put_felt(u, body[N_X:], physics.wrench, physics.mixing, physics.faults, t, room)


@register_jitable
def put_rates(rates: np.ndarray, physics: Physics, body: np.ndarray, t: float, u: np.ndarray, room: np.ndarray) -> None:
    """Write the time derivatives of x and of the rotors' speeds at t [s] (12 + n)."""
    put_control(physics, body, t, u, room)
    put(body[6:N_X], rates)
    put(accelerations(body[:N_X], u, physics.d, physics.mass, physics.inertia, physics.kinematics), rates, 6)
    put_acceleration(rates[N_X:], body[N_X:], physics.commanded, physics.time_constant)


@register_jitable
def integrate(
    physics: Physics, body: np.ndarray, start: float, end: float, rates: np.ndarray, u: np.ndarray, room: np.ndarray
) -> None:
    """Integrate the body from start to end [s] in place: x, and the speeds of rotors with dynamics [rad/s] (12 + n).

    rates (4, 12 + n), u (4) and room (n + 4) are work space.
    """
    a, b, c, between, t = rates[0], rates[1], rates[2], rates[3], start
    while t < end:
        target = t + physics.longest_step if t + _STRETCH * physics.longest_step < end else end
        dt = target - t
        put_rates(a, physics, body, t, u, room)
        for i in range(body.size):
            between[i] = body[i] + dt / 2.0 * a[i]
        put_rates(b, physics, between, t + dt / 2.0, u, room)
        for i in range(body.size):
            between[i] = body[i] + (2.0 * dt * b[i] - dt * a[i])
        put_rates(c, physics, between, target, u, room)
        for i in range(body.size):
            body[i] += dt / 6.0 * a[i] + 4.0 * (dt / 6.0) * b[i] + dt / 6.0 * c[i]
        t = target


def continuous_step(
    n: Any,
    k: int,
    body: np.ndarray,
    control: np.ndarray,
    disturbance: np.ndarray,
    wrench: np.ndarray,
    mixing: np.ndarray,
    unmixing: np.ndarray,
    instants: np.ndarray,
    faults: FaultTable,
    rates: np.ndarray,
    u: np.ndarray,
    room: np.ndarray,
) -> None:
    """Advance by a tick under held u and d; keep the states at these instants, shares of the tick, in between."""
    size = N_X + mixing.shape[1]
    state, passed = body[:size], body[size:]
    commanded = commanded_speeds(control, unmixing, n.max_speed) if size > N_X else control
    given = n.mass, n.inertia, n.kinematics, n.longest_step, n.time_constant
    physics = Physics(*given, wrench, mixing, faults, commanded, control, disturbance)
    start = k * n.h
    for i in range(instants.size):
        time = n.h * instants[i] + k * n.h
        integrate(physics, state, start, time, rates, u, room)
        put_control(physics, state, time, u, room)
        put(state[:N_X], passed, i * PASSED)
        put(velocity_rate(state, u, disturbance, n.mass, n.kinematics), passed, i * PASSED + N_X)
        start = time
    integrate(physics, state, start, (k + 1) * n.h, rates, u, room)


def plant_out(body: np.ndarray, out: np.ndarray) -> None:
    """Output the true state (12)."""
    put(body, out)


def felt_out(
    n: Any,
    k: int,
    speeds: np.ndarray,
    wrench: np.ndarray,
    mixing: np.ndarray,
    faults: FaultTable,
    room: np.ndarray,
    out: np.ndarray,
) -> None:
    """Output the control u (4) that acts on the body, as the rotors make it."""
    put_felt(out, speeds, wrench, mixing, faults, k * n.h, room)


CONTINUOUS = Element("continuous_plant", step=continuous_step, shows="body", allocates=True)
STATE = Element("plant_state", out=plant_out)
ROTORS_FELT = Element("rotors_felt", out=felt_out, allocates=True)


def continuous_boxes(scenario: Scenario, x_0: np.ndarray, needs_forces: bool) -> list[Box]:
    """Return the continuous plant: it reads the control (4) and the disturbance (6), and outputs x (12), `plant`.

    Without rotor dynamics the control is the one that acts on the body. With them it is the command, and `rotors_felt`,
    present if needs_forces, outputs the control that acts. `vehicle.passed` holds a row of PASSED for each of
    Scenario.instants inside the last tick, oldest first. x starts at x_0 (12).
    """
    vehicle, h = scenario.vehicle, scenario.h
    has_rotors = scenario.world.rotors.kind == "first_order"
    M, M_inverse, speeds = np.zeros((N_U, 0)), np.zeros((0, N_U)), np.zeros(0)
    if has_rotors:
        M, M_inverse = mixing_matrix(vehicle), np.ascontiguousarray(mixing_inverse(vehicle))
        speeds = np.array(vehicle.hover_rotor_speeds, dtype=float)
    numbers = {
        "mass": vehicle.mass,
        "inertia": vehicle.inertia,
        "kinematics": KINEMATICS.index(scenario.world.kinematics),
        "longest_step": h / steps_a_tick(scenario),
        "max_speed": vehicle.rotor_max_speed,
        "time_constant": vehicle.rotor_time_constant,
        "h": h,
    }
    faults = wrench_table(scenario.faults if has_rotors else (), vehicle)
    instants, tables = scenario.instants, {"wrench": np.eye(N_U), "mixing": M}
    passed = np.zeros(instants.size * PASSED)
    body = np.concatenate((x_0, speeds, passed))
    parts = {"x": (0, N_X), "speeds": (N_X, speeds.size), "passed": (N_X + speeds.size, passed.size)}
    given = Values(numbers, start={"body": body}, tables=tables | {"unmixing": M_inverse, "instants": instants})
    work = {"rates": (4, N_X + speeds.size), "u": (N_U,), "room": (speeds.size + N_U,)}
    boxes = [
        Box("vehicle", CONTINUOUS, body.size, given, work, parts=parts).with_groups(faults=faults),
        Box("plant", STATE, N_X, reads={"body": "vehicle.x"}),
    ]
    if has_rotors and needs_forces:
        felt = Values({"h": h}, tables=tables)
        room = {"room": work["room"]}
        its = Box("rotors_felt", ROTORS_FELT, N_U, felt, room, reads={"speeds": "vehicle.speeds"})
        boxes.append(its.with_groups(faults=faults))
    return boxes
