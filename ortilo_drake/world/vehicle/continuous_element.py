"""The continuous vehicle as elements of the loop, see continuous.py."""

from typing import Any

import numpy as np

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.equations import KINEMATICS, velocity_rate
from ortilo_drake.model.placing import put
from ortilo_drake.model.signals import N_U, N_X
from ortilo_drake.model.vehicle import mixing_inverse, mixing_matrix
from ortilo_drake.scenario import Scenario
from ortilo_drake.world.faults.table import FaultTable
from ortilo_drake.world.faults.vehicle_faults import wrench_table
from ortilo_drake.world.vehicle.continuous import PASSED, Physics, integrate, put_control, put_felt, steps_a_tick
from ortilo_drake.world.vehicle.rotors import commanded_speeds


def continuous_step(
    n: Any,
    k: int,
    body: np.ndarray,
    control: np.ndarray,
    disturbance: np.ndarray,
    wrench: np.ndarray,
    mixing: np.ndarray,
    unmixing: np.ndarray,
    faults: FaultTable,
    rates: np.ndarray,
    u: np.ndarray,
    room: np.ndarray,
) -> None:
    """Advance by a tick under held u and d; keep the states at the instants in between that divide it evenly."""
    physics = Physics(n.mass, n.inertia, n.kinematics, n.longest_step, n.time_constant, wrench, mixing, faults)
    size = N_X + mixing.shape[1]
    state, passed = body[:size], body[size:]
    commanded = commanded_speeds(control, unmixing, n.max_speed) if size > N_X else control
    parts = passed.size // PASSED + 1
    start = k * n.h
    for i in range(1, parts):
        time = n.h * (i / parts) + k * n.h
        integrate(physics, state, commanded, control, disturbance, start, time, rates, u, room)
        put_control(physics, state, control, time, u, room)
        put(state[:N_X], passed, (i - 1) * PASSED)
        put(velocity_rate(state, u, disturbance, n.mass, n.kinematics), passed, (i - 1) * PASSED + N_X)
        start = time
    integrate(physics, state, commanded, control, disturbance, start, (k + 1) * n.h, rates, u, room)


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
    """Output u as it acts on the body (4), as the rotors make it."""
    put_felt(out, speeds, wrench, mixing, faults, k * n.h, room)


CONTINUOUS = Element("continuous_plant", step=continuous_step, shows="body", allocates=True)
STATE = Element("plant_state", out=plant_out)
ROTORS_FELT = Element("rotors_felt", out=felt_out, allocates=True)


def continuous_boxes(scenario: Scenario, x_0: np.ndarray, samples: int, needs_forces: bool) -> list[Box]:
    """Return the continuous plant: it reads the control (4) and the disturbance (6), and outputs x (12), `plant`.

    The control acts on the body. With rotors' dynamics it is the command, and `rotors_felt`, if asked for, is the
    control that acts. `vehicle.passed` has rows of PASSED, what was passed inside the last tick, oldest first, as many
    as the fastest sensor has samples, less 1. It starts at x_0 (12).
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
    tables = {"wrench": np.eye(N_U), "mixing": M}
    passed = np.zeros((samples - 1) * PASSED)
    body = np.concatenate((x_0, speeds, passed))
    parts = {"x": (0, N_X), "speeds": (N_X, speeds.size), "passed": (N_X + speeds.size, passed.size)}
    given = Values(numbers, start={"body": body}, tables=tables | {"unmixing": M_inverse})
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
