"""The extra states e that the filter estimates beside the vehicle's twelve: unknown quantities that vary slowly.

Each is a random walk or a Gauss-Markov process with its own standard deviations. The extra states stand between x and
the integral, xbar = [x; e; i]. Only the matrices of the paper's equations become larger:

    [x; e]_{k+1} = [[Phi, G], [0, F]] [x; e]_k + [Gamma; Gamma_e] u_k + w_k,   y_k = Delta_k ([C, C_e] [x; e]_k + v_k)

The integrator reads E_k y_k, whose rows depend on the same states as the rows of the selected sensor. So V12, E_k and
the integrator's known rows of K do not change.

    d     disturbance force in W [N]: adds Gamma_d d_k to x_{k+1}, Gamma_d = (h^2/2, h)/m on position and velocity
    f     'measured' only: force of the last step less the hover lift, f_{k+1} = d_k + f_T e_z + w [N], with w the new
          part of the disturbance force, whose variance is in W
    n     disturbance torque in B [N m], for instance of a centre of gravity off its place: adds its columns of Gamma_d,
          times n_k, to x_{k+1}; only where walks.torque_sd is not 0
    b     'measured' only: bias of the accelerometer [m/s^2]; its rows are f/m + b, see imu_rows.py
    c     bias of the gyroscope [rad/s], 'rates: measured' only: its rows are the Euler-angle rates + c
    s     lasting error of a fix [m], one process for each axis and kind of fix: the fix's rows are p + s. Without s the
          filter would average errors such as the survey's like noise; with s they stay in the covariance of p
    beta  bias of the imu's roll, pitch or yaw [rad]: psi_imu = psi + beta; or bias of any row of a sensor of one's own
"""

from typing import NamedTuple

import numpy as np

from ortilo_drake.model.hover import discretize, hover_A, hover_B_d
from ortilo_drake.model.measurement import CAMERA, IMU, UWB, Measurement, Row, Rows, row
from ortilo_drake.model.signals import N_U, N_X, STATE_NAMES
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.scenario import Biases
from ortilo_drake.scenario import IntermittentFilter as FilterSettings

D, F, B, N, C = (tuple(f"{letter}_{axis}" for axis in "xyz") for letter in "dfbnc")
# The sensors whose rows the filter makes from the imu's message: the states that they need, and the rows.
IMU_ROWS = {
    "accelerometer": (F, tuple(Row(f"a_{axis}", ()) for axis in "xyz")),
    "gyroscope": (C, tuple(row(f"{rate}_imu", **{rate: 1.0}) for rate in STATE_NAMES[9:])),
}
PAPERS_ROWS = tuple(row.name for row in (*UWB, *CAMERA, *IMU))


Sees = tuple[tuple[str, str, float], ...]  # (row, state, coefficient)


class Walk(NamedTuple):
    """A process e_{k+1} = keeps e_k + w_k; a random walk if keeps is 1."""

    initial_sd: float
    """standard deviation of e_0, whose estimate is 0; not used for a state that follows another one."""
    step_sd: float
    """standard deviation of w."""
    keeps: float = 1.0
    """share of the value that is left after one tick."""


def gauss_markov(sd: float, time: float, h: float) -> Walk:
    """Return the first-order Gauss-Markov process with a constant sd and a correlation time [s], for ticks of h [s]."""
    keeps = np.exp(-h / time)
    return Walk(sd, sd * np.sqrt(1.0 - keeps**2), keeps)


class Extra(NamedTuple):
    """A group of e extra states of the filter."""

    names: tuple[str, ...]
    """names of the states (e)."""
    walk: Walk
    """process that each state follows."""
    follows: tuple[str, ...]
    """for each state, the extra state whose value it keeps in the next tick; itself for a random walk (e)."""
    G: np.ndarray
    """input matrix of these states into x (12, e)."""
    Gamma: np.ndarray
    """input matrix of the control into these states (e, 4)."""
    Gamma_d: np.ndarray
    """input matrix of the new part of the disturbance's force and torque into these states (e, 6)."""
    sees: Sees
    """coefficients of these states in the rows of y."""


def _slow(names: tuple[str, ...], walk: Walk, sees: Sees, G: np.ndarray | None = None) -> Extra:
    """Return states that each follow their own past, without control and disturbance; arguments as Extra's fields."""
    e = len(names)
    G = np.zeros((N_X, e)) if G is None else G
    return Extra(names, walk, names, G, np.zeros((e, N_U)), np.zeros((e, 6)), sees)


def _each(rows: tuple[str, ...], states: tuple[str, ...], coefficient: float = 1.0) -> Sees:
    return tuple((row, state, coefficient) for row, state in zip(rows, states, strict=True))


def _names_of_rows(sensor: str) -> tuple[str, ...]:
    return tuple(its.name for its in IMU_ROWS[sensor][1])


def _biases(biases: Biases, h: float, flown: tuple[str, ...]) -> list[Extra]:
    sds = (*biases.uwb_sd, *biases.camera_sd, biases.level_sd, biases.level_sd, biases.yaw_sd)
    times = [biases.uwb_time] * 3 + [biases.camera_time] * 3 + [biases.imu_time] * 3
    rows = [(row.name, sd, time) for row, sd, time in zip((*UWB, *CAMERA, *IMU), sds, times, strict=True)]
    rows += [(name, sd, biases.row_time) for name, sd in dict(biases.row_sd).items()]
    found = []
    for name, sd, time in rows:
        if sd > 0.0 and name in flown:
            own = (f"bias_{name}",)
            found.append(_slow(own, gauss_markov(sd, time, h), _each((name,), own)))
    return found


def extra_states(
    settings: FilterSettings, vehicle: Vehicle, h: float, flown: tuple[str, ...] = PAPERS_ROWS, yaw: float = 0.0
) -> tuple[Extra, ...]:
    """Return the extra states of the scenario's filter in their order in xbar, the force first.

    Arguments as in filter_model; only rows of y named in `flown` get a bias.
    """
    if settings.force == "none":
        return ()
    walks, (_, Gamma_d) = settings.walks, discretize(hover_A(yaw), hover_B_d(vehicle), h)

    def walk(sd: float, rate: float) -> Walk:
        return Walk(sd, rate * np.sqrt(h))

    found = [_slow(D, walk(walks.force_sd, walks.force_rate), (), Gamma_d[:, :3])]
    if settings.force == "measured":
        e_z, rows = np.zeros((3, N_U)), _names_of_rows("accelerometer")
        e_z[2, 0] = 1.0
        found += [
            Extra(F, Walk(0.0, 0.0), D, np.zeros((N_X, 3)), e_z, np.eye(3, 6), _each(rows, F, 1.0 / vehicle.mass)),
            _slow(B, walk(walks.accelerometer_sd, walks.accelerometer_rate), _each(rows, B)),
        ]
    if walks.torque_sd != 0.0:
        found.append(_slow(N, walk(walks.torque_sd, walks.torque_rate), (), Gamma_d[:, 3:]))
    if settings.rates == "measured":
        found.append(_slow(C, walk(walks.gyroscope_sd, walks.gyroscope_rate), _each(_names_of_rows("gyroscope"), C)))
    return (*found, *_biases(settings.biases, h, flown))


def names_of(extras: tuple[Extra, ...]) -> tuple[str, ...]:
    """Return the names of all extra states."""
    return tuple(name for extra in extras for name in extra.names)


def augmented_rows(rows: Rows, extras: tuple[Extra, ...]) -> Measurement:
    """Return the filter's measurement: `rows` over [x; e], then the rows of IMU_ROWS whose states are in `extras`."""
    names = names_of(extras)
    rows = (*rows, *((sensor, its) for sensor, (states, its) in IMU_ROWS.items() if set(states) <= set(names)))

    def widened(r: Row) -> Row:
        return Row(r.name, (*r.sees, *((state, c) for e in extras for name, state, c in e.sees if name == r.name)))

    own = tuple((sensor, tuple(widened(r) for r in its)) for sensor, its in rows)
    return Measurement(own, (*STATE_NAMES, *names))
