"""The vehicle where its state is continuous: a rigid body, with rotors that take time, between two ticks.

It goes by the steps and the arithmetic of Drake's RungeKutta3Integrator, as flight/simulator.py has Drake take them.
"""

from typing import Any, Final, NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.loop.element import Array, Box, Element, Given, Number
from ortilo_drake.model.equations import KINEMATICS, derivative
from ortilo_drake.model.placing import put
from ortilo_drake.model.signals import N_U, N_X
from ortilo_drake.model.vehicle import mixing_inverse, mixing_matrix
from ortilo_drake.scenario import Scenario
from ortilo_drake.world.faults.table import TABLES, FaultTable
from ortilo_drake.world.faults.vehicle_faults import wrench_at, wrench_table
from ortilo_drake.world.vehicle.rotors import commanded_speeds, rotor_acceleration, times, wrench_of

PASSED: Final = N_X + N_U  # of an instant inside the tick: the state, and u as it acts on the body
_STRETCH = 1.01  # by which Drake lengthens a step that would end just before an event [1]


class Physics(NamedTuple):
    """What moves the vehicle.

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
    """Return into how many steps a tick of a continuous plant is divided: rotors' lag is shorter than a tick."""
    return 4 if scenario.world.rotors.kind == "first_order" else 1


@register_jitable
def wrench_felt(speeds: np.ndarray, wrench: np.ndarray, mixing: np.ndarray, faults: FaultTable, t: float) -> np.ndarray:
    """Return u as it acts on the body (4) at t [s], as the rotors make it at these speeds."""
    u = times(wrench, wrench_of(speeds, mixing))
    return wrench_at(u, faults, t) if faults.kinds.size > 0 else u


@register_jitable
def control_felt(physics: Physics, speeds: np.ndarray, held: np.ndarray, t: float) -> np.ndarray:
    """Return u as it acts on the body (4) at t [s]: what is held, or what the rotors make."""
    if speeds.size == 0:
        return held
    return wrench_felt(speeds, physics.wrench, physics.mixing, physics.faults, t)


@register_jitable
def rates(
    physics: Physics,
    x: np.ndarray,
    speeds: np.ndarray,
    commanded: np.ndarray,
    held: np.ndarray,
    d: np.ndarray,
    t: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the time derivatives of x and of the rotors' speeds at t [s]."""
    u = control_felt(physics, speeds, held, t)
    x_dot = derivative(x, u, d, physics.mass, physics.inertia, physics.kinematics)
    if speeds.size == 0:
        return x_dot, speeds
    return x_dot, rotor_acceleration(speeds, commanded, physics.time_constant)


@register_jitable
def integrate(
    physics: Physics,
    x: np.ndarray,
    speeds: np.ndarray,
    commanded: np.ndarray,
    held: np.ndarray,
    d: np.ndarray,
    start: float,
    end: float,
) -> None:
    """Go on from one time to another [s].

    Args:
        physics: what moves the vehicle.
        x: state (12); changed.
        speeds: of the rotors [rad/s] (n), none of rotors without dynamics; changed.
        commanded: speeds that the rotors are to have (n).
        held: u that acts, of rotors without dynamics (4).
        d: disturbance (6).
        start: from when.
        end: until when.
    """
    t = start
    while t < end:
        target = t + physics.longest_step if t + _STRETCH * physics.longest_step < end else end
        dt = target - t
        a, p = rates(physics, x, speeds, commanded, held, d, t)
        x_a, speeds_a = x + dt / 2.0 * a, speeds + dt / 2.0 * p
        b, q = rates(physics, x_a, speeds_a, commanded, held, d, t + dt / 2.0)
        x_b, speeds_b = x + (2.0 * dt * b - dt * a), speeds + (2.0 * dt * q - dt * p)
        c, r = rates(physics, x_b, speeds_b, commanded, held, d, target)
        for i in range(x.size):
            x[i] += dt / 6.0 * a[i] + 4.0 * (dt / 6.0) * b[i] + dt / 6.0 * c[i]
        for i in range(speeds.size):
            speeds[i] += dt / 6.0 * p[i] + 4.0 * (dt / 6.0) * q[i] + dt / 6.0 * r[i]
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
    kinds: np.ndarray,
    starts: np.ndarray,
    ends: np.ndarray,
    streams: np.ndarray,
    first: np.ndarray,
    values: np.ndarray,
) -> None:
    """Go on by a tick under held u and d; keep what was passed at the instants in between that divide it evenly."""
    faults = FaultTable(kinds, starts, ends, streams, first, values)
    physics = Physics(n.mass, n.inertia, n.kinematics, n.longest_step, n.time_constant, wrench, mixing, faults)
    rotors = mixing.shape[1]
    x, speeds, passed = body[:N_X], body[N_X : N_X + rotors], body[N_X + rotors :]
    commanded = commanded_speeds(control, unmixing, n.max_speed) if rotors > 0 else control
    parts = passed.size // PASSED + 1
    start = k * n.h
    for i in range(1, parts):
        time = n.h * (i / parts) + k * n.h
        integrate(physics, x, speeds, commanded, control, disturbance, start, time)
        at = (i - 1) * PASSED
        put(x, passed, at)
        put(control_felt(physics, speeds, control, time), passed, at + N_X)
        start = time
    integrate(physics, x, speeds, commanded, control, disturbance, start, (k + 1) * n.h)


def plant_out(body: np.ndarray, out: np.ndarray) -> None:
    """Say the true state (12)."""
    put(body, out)


def felt_out(
    n: Any,
    k: int,
    speeds: np.ndarray,
    wrench: np.ndarray,
    mixing: np.ndarray,
    kinds: np.ndarray,
    starts: np.ndarray,
    ends: np.ndarray,
    streams: np.ndarray,
    first: np.ndarray,
    values: np.ndarray,
    out: np.ndarray,
) -> None:
    """Say u as it acts on the body (4), as the rotors make it."""
    faults = FaultTable(kinds, starts, ends, streams, first, values)
    put(wrench_felt(speeds, wrench, mixing, faults, k * n.h), out)


CONTINUOUS = Element(
    "continuous_plant",
    step=continuous_step,
    numbers=(
        Number("mass"),
        Number("inertia", (3,)),
        Number("kinematics", kind="i8"),
        Number("longest_step"),
        Number("max_speed"),
        Number("time_constant", (2,)),
        Number("h"),
    ),
    tables=(Array("wrench", 2), Array("mixing", 2), Array("unmixing", 2), *TABLES),
    state=(Array("body"),),
    shows="body",
    allocates=True,
)
STATE = Element("plant_state", out=plant_out)
ROTORS_FELT = Element(
    "rotors_felt",
    out=felt_out,
    numbers=(Number("h"),),
    tables=(Array("wrench", 2), Array("mixing", 2), *TABLES),
    allocates=True,
)


def continuous_boxes(scenario: Scenario, x_0: np.ndarray, samples: int, feels: bool) -> list[Box]:
    """Return the continuous plant: it reads the control (4) and the disturbance (6), and says x (12), `plant`.

    The control is what acts on the body; of rotors with dynamics it is what is commanded, and `rotors_felt`, if it is
    asked for, says what acts. `vehicle.passed` has rows of PASSED, what was passed inside the last tick, oldest first.

    Args:
        scenario: the scenario.
        x_0: state at the start (12).
        samples: of the fastest sensor in a tick.
        feels: whether it is asked for what acts on the body.
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
    tables = {"wrench": np.eye(N_U), "mixing": M, **faults._asdict()}
    passed = np.zeros((samples - 1) * PASSED)
    body = np.concatenate((x_0, speeds, passed))
    parts = {"x": (0, N_X), "speeds": (N_X, speeds.size), "passed": (N_X + speeds.size, passed.size)}
    given = Given(numbers, start={"body": body}, tables=tables | {"unmixing": M_inverse})
    boxes = [
        Box("vehicle", CONTINUOUS, body.size, given, parts=parts),
        Box("plant", STATE, N_X, reads={"body": "vehicle.x"}),
    ]
    if has_rotors and feels:
        felt = Given({"h": h}, tables=tables)
        boxes.append(Box("rotors_felt", ROTORS_FELT, N_U, felt, reads={"speeds": "vehicle.speeds"}))
    return boxes
