"""The unknown errors of a scenario's truth, as states of the Cramer-Rao bound beside the vehicle's twelve.

Each error of ``truth`` (scenario/truth.py) is an unknown of mean zero, whose variance is its value squared plus its
spread squared: a team knows how large its errors may be, but neither their sign nor their size. Errors that change are
random walks or first-order Gauss-Markov noise, as the world draws them.

    x_{k+1} = Phi x_k + G e_k + ...,   e_{k+1} = F e_k + B_x^T x_k + w_e,   y = g^T x + c^T e + v

At hover, a wrong mass or lift acts as an unknown vertical force, an offset centre of gravity as an unknown torque.

**Force and accelerometer.** The specific force of a step is y_a = (d + w) / m + b + v, where d is the lasting part of
the force, w its white part of variance s_w^2, b the bias, and v noise of variance s_v^2 / m^2. With k = s_w^2 / (s_w^2
+ s_v^2) this gives two independent equations: the force of the step is k m (y_a - b) + (1 - k) d up to a variance k
s_v^2, and m y_a = d + m b up to a variance s_w^2 + s_v^2. The first enters the dynamics, the second is a row. Rotor
drag -D v is part of d.

If a bias was zeroed at standstill, only the rest that zeroing leaves counts: world/sensors/standstill.py.

Taken as known, which lowers the bound: the part of gravity that a tilted imu includes when it is zeroed; scale factors
of angles, rates, specific force, ranges and focal length; clocks, the landmarks' shapes, moments of inertia. A
registered sensor with an entry in ``truth.sensors`` has errors as large and as slow as the scenario's filter assumes
(estimator.biases.row_sd).
"""

import numpy as np

from ortilo_drake.model.hover import discretize, hover_A, hover_B_d
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import N_X, SENSORS
from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.scenario import Scenario
from ortilo_drake.sensors.described import described
from ortilo_drake.sensors.imu import inertial_biases
from ortilo_drake.sensors.unknown_error import Error, Seen, gauss_markov, one_per_source, spread, walk


def force_errors(scenario: Scenario, k: float) -> list[Error]:
    """Return the unknown errors of the force, the accelerometer and the torque; k as in unknown_errors."""
    vehicle, force, imu = scenario.truth.vehicle, scenario.truth.force, scenario.truth.imu
    m, h = scenario.vehicle.mass, scenario.h
    _, Gamma_d = discretize(hover_A(scenario.yaw), hover_B_d(scenario.vehicle), h)
    factors = (vehicle.mass_factor - 1.0, vehicle.mass_factor_sd, vehicle.thrust_factor - 1.0, vehicle.thrust_factor_sd)
    lift = tuple((0.0, 0.0, m * GRAVITY * factor) for factor in factors)
    lasting, push, pull = {"force": one_per_source(3)}, (1.0 - k) * Gamma_d[:, :3], -k * m * Gamma_d[:, :3]
    bias = inertial_biases(scenario)[1]
    off = spread(vehicle.center_of_gravity[::-1], vehicle.center_of_gravity_sd, number=2)
    return [
        walk(spread(force.mean, force.mean_sd, *lift), 0.0, lasting, push),
        gauss_markov(spread(force.gust_sd), force.gust_time, h, lasting, push),
        walk(bias, imu.specific_force_walk * np.sqrt(h), {"force": lambda rows: m * one_per_source(3)(rows)}, pull),
        walk(m * GRAVITY * off, 0.0, {}, Gamma_d[:, 3:5]),
    ]


def unknown_of(scenario: Scenario, room: Room, name: str) -> list[Error]:
    """Return a sensor's errors that the filter does not know: those of its description, else the filter's biases."""
    unknown = described(name).unknown
    if unknown is not None:
        return list(unknown(scenario, room))
    its = scenario.linear_filter
    if its is None or name not in dict(scenario.truth.sensors):
        return []
    biases = its.biases
    sd = np.array([dict(biases.row_sd).get(row.name, 0.0) for row in described(name).rows])
    return [gauss_markov(sd, biases.row_time, scenario.h, {name: one_per_source(len(sd))})]


def unknown_errors(scenario: Scenario, room: Room, k: float) -> Error:
    """Return all errors that a scenario's truth leaves unknown, stacked as one, without components that are certain.

    k is the weight of the specific force in the estimate of a tick's white force (see above); 0 where it is not read.
    """
    sensors = dict.fromkeys((*SENSORS, *scenario.sensors, *dict(scenario.truth.sensors)))
    every = [*force_errors(scenario, k), *(error for name in sensors for error in unknown_of(scenario, room, name))]
    unsure = [(error.sd > 0.0) | (error.step_sd > 0.0) | error.by_x.any(axis=0) for error in every]
    some = [(error, there) for error, there in zip(every, unsure, strict=True) if there.any()]

    def coefficients(kind: str) -> Seen:
        def of_rows(rows: np.ndarray) -> np.ndarray:
            found = np.zeros((len(rows), sum(there.sum() for _, there in some)))
            at = 0
            for error, there in some:
                if kind in error.sees:
                    found[:, at : at + there.sum()] = error.sees[kind](rows)[:, there]
                at += there.sum()
            return found

        return of_rows

    def all_of(name: str) -> np.ndarray:
        nothing = np.zeros((N_X, 0)) if name in ("G", "by_x") else np.zeros(0)
        return np.concatenate([nothing, *(getattr(error, name)[..., there] for error, there in some)], axis=-1)

    sees = {kind: coefficients(kind) for error, _ in some for kind in error.sees}
    return Error(all_of("sd"), all_of("step_sd"), all_of("keeps"), all_of("G"), all_of("by_x"), sees)


def start_covariance(scenario: Scenario) -> np.ndarray:
    """Return P_0 (12 x 12), the covariance of a flight's true start about the filter's first estimate."""
    start, sd = scenario.truth.start, np.zeros(N_X)
    sd[:3], sd[5] = spread(start.position, start.position_sd), np.hypot(start.yaw, start.yaw_sd)
    return np.diag(sd**2)
