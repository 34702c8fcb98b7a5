"""The states that the filter carries beside the vehicle's twelve: what is unknown and varies slowly.

Each is a random walk of its own standard deviations. They stand between x and the integral, xbar = [x; e; i], and
enter the paper's equations by larger matrices alone:

    [x; e]_{k+1} = [[Phi, G], [0, F]] [x; e]_k + [Gamma; Gamma_e] u_k + w_k,   y_k = Delta_k ([C, C_e] [x; e]_k + v_k)

The rows of E_k y_k that the integrator takes see what its sensor's rows see, so V12, E_k and the integrator's known
rows of K stay as they are.

    d     disturbance force in W [N]: x_{k+1} takes Gamma_d d_k, Gamma_d = (h^2/2, h)/m on position and velocity
    f     'measured' only: force of the step just flown less the hover lift, f_{k+1} = d_k + f_T e_z + w [N], w the new
          part of the disturbance force that W holds
    b     'measured' only: bias of the accelerometer [m/s^2]; its rows are f/m + b, see specific_force.py
"""

from typing import NamedTuple

import numpy as np

from ortilo_drake.model.hover import discretize, hover_A, hover_B_d
from ortilo_drake.model.measurement import Measurement, Row, Rows
from ortilo_drake.model.signals import N_U, N_X, STATE_NAMES
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.scenario import IntermittentFilter as FilterSettings

ACCELEROMETER = "accelerometer"  # the sensor whose rows the filter makes of the imu's specific force
D, F, B = (tuple(f"{letter}_{axis}" for axis in "xyz") for letter in "dfb")
_A = tuple(f"a_{axis}" for axis in "xyz")  # its rows


class Walk(NamedTuple):
    """A random walk: standard deviations of its first value and of what is new in a tick."""

    initial_sd: float
    step_sd: float


class Extra(NamedTuple):
    """States that the filter carries beside the vehicle's.

    Attributes:
        names: of the states (e).
        walk: how uncertain they are at first, when they are believed 0, and what is new in them in a tick.
        follows: names of the extra states whose values they take in the next tick, their own for a random walk (e).
        G: how they drive x (12, e).
        Gamma: how the control drives them (e, 4).
        Gamma_d: how the new part of the disturbance's force and torque drives them (e, 6).
        sees: rows of y that see them, (row, state, coefficient).
    """

    names: tuple[str, ...]
    walk: Walk
    follows: tuple[str, ...]
    G: np.ndarray
    Gamma: np.ndarray
    Gamma_d: np.ndarray
    sees: tuple[tuple[str, str, float], ...]


def random_walk(
    names: tuple[str, ...], walk: Walk, sees: tuple[tuple[str, str, float], ...], G: np.ndarray | None = None
) -> Extra:
    """Return states that walk; arguments as Extra's."""
    e = len(names)
    G = np.zeros((N_X, e)) if G is None else G
    return Extra(names, walk, names, G, np.zeros((e, N_U)), np.zeros((e, 6)), sees)


def extra_states(settings: FilterSettings, vehicle: Vehicle, h: float) -> tuple[Extra, ...]:
    """Return the extra states of a scenario's filter, in their order in xbar."""
    if settings.force == "none":
        return ()
    _, Gamma_d = discretize(hover_A(), hover_B_d(vehicle), h)
    walks = settings.walks
    found = [random_walk(D, Walk(walks.force_sd, walks.force_rate * np.sqrt(h)), (), Gamma_d[:, :3])]
    if settings.force == "measured":
        e_z = np.zeros((3, N_U))
        e_z[2, 0] = 1.0
        rows = tuple((row, state, 1.0 / vehicle.mass) for row, state in zip(_A, F, strict=True))
        found.append(Extra(F, Walk(0.0, 0.0), D, np.zeros((N_X, 3)), e_z, np.eye(3, 6), rows))
        bias = Walk(walks.accelerometer_sd, walks.accelerometer_rate * np.sqrt(h))
        found.append(random_walk(B, bias, tuple((r, b, 1.0) for r, b in zip(_A, B, strict=True))))
    return tuple(found)


def names_of(extras: tuple[Extra, ...]) -> tuple[str, ...]:
    """Return the names of all extra states."""
    return tuple(name for extra in extras for name in extra.names)


def augmented_rows(rows: Rows, extras: tuple[Extra, ...]) -> Measurement:
    """Return the measurement that the filter gets: rows over [x; e], and the accelerometer's where f is a state."""
    names = names_of(extras)
    if set(F) <= set(names):
        rows = (*rows, (ACCELEROMETER, tuple(Row(name, ()) for name in _A)))

    def widened(r: Row) -> Row:
        return Row(r.name, (*r.sees, *((state, c) for e in extras for name, state, c in e.sees if name == r.name)))

    own = tuple((sensor, tuple(widened(r) for r in its)) for sensor, its in rows)
    return Measurement(own, (*STATE_NAMES, *names))
