"""What a scenario's truth leaves unknown, as states of the Cramer-Rao bound beside the vehicle's twelve.

Each error of ``truth`` (scenario/truth.py) is an unknown of mean zero, whose variance is its value's square plus its
spread's: a team knows how large its errors may be, and neither their sign nor their size. Those that change are
random walks or first-order Gauss-Markov noise, as the world draws them.

    x_{k+1} = Phi x_k + G e_k + ...,   e_{k+1} = F e_k + w_e,   y = g^T x + c^T e + v

A wrong mass or lift is an unknown vertical force, a centre of gravity that is off an unknown torque, as at hover.

**Force and accelerometer.** The specific force y_a = (d + w) / m + b + v of a step, d all that lasts of the force, w
its white part of variance s_w^2 and v of s_v^2 / m^2 in force, says two independent things: with k = s_w^2 / (s_w^2 +
s_v^2) the force of the step is k m (y_a - b) + (1 - k) d up to a variance k s_v^2, and m y_a = d + m b up to a variance
s_w^2 + s_v^2. The first goes into the dynamics, the second is a row.

A bias that was zeroed while the vehicle stood still is what that leaves of it: world/sensors/standstill.py.

Taken as known, which lowers the bound: what an unlevel imu turns of gravity while it is zeroed, factors of angles,
rates, specific force, ranges and focal length, clocks, the landmarks' shapes, moments of inertia. Of a registered
sensor with an entry in ``truth.sensors`` the errors are as large and as slow as the scenario's filter believes
(estimator.biases.row_sd).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ortilo_drake.floor.information_rows import GRADIENT, SOURCE
from ortilo_drake.model.hover import discretize, hover_A, hover_B_d
from ortilo_drake.model.parts import find_sensor
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import N_X
from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.scenario import Scenario
from ortilo_drake.world.sensors.standstill import left_at_rest

Seen = Callable[[np.ndarray], np.ndarray]  # rows (l, 17) -> their coefficients of an error's e components (l, e)


class Error(NamedTuple):
    """An unknown error: independent components, all of the same kind.

    Attributes:
        sd: standard deviations at first (e).
        step_sd: of what is added in a tick (e).
        keeps: share of the value that is left a tick later (e).
        G: how the components drive x (12, e).
        sees: by the kind of rows the coefficients of the components in them.
    """

    sd: np.ndarray
    step_sd: np.ndarray
    keeps: np.ndarray
    G: np.ndarray
    sees: dict[str, Seen]


def walk(sd: np.ndarray, step_sd: np.ndarray | float, sees: dict[str, Seen], G: np.ndarray | None = None) -> Error:
    """Return a random walk; a constant where step_sd is 0."""
    e = len(sd)
    return Error(sd, np.broadcast_to(step_sd, e), np.ones(e), np.zeros((N_X, e)) if G is None else G, sees)


def gauss_markov(sd: np.ndarray, time: float, h: float, sees: dict[str, Seen], G: np.ndarray | None = None) -> Error:
    """Return first-order Gauss-Markov noise of those sds at all times and that correlation time [s]."""
    keeps = np.full(len(sd), np.exp(-h / time))
    return walk(sd, sd * np.sqrt(1.0 - keeps**2), sees, G)._replace(keeps=keeps)


def own(number: int, each: int = 1) -> Seen:
    """Return coefficients 1 of the component that has the number of a row's source; each so many sources have one."""
    return lambda rows: np.eye(number)[rows[:, SOURCE].astype(int) // each]


def moved(sign: float, number: int = 1, each: int = 1) -> Seen:
    """Return coefficients of what moves as p does, or against it: one vector for all rows, or one for each source."""

    def coefficients(rows: np.ndarray) -> np.ndarray:
        g = sign * rows[:, GRADIENT][:, :3]
        whose = np.ones((len(rows), 1)) if number == 1 else own(number, each)(rows)
        return (whose[:, :, np.newaxis] * g[:, np.newaxis]).reshape(len(rows), 3 * whose.shape[1])

    return coefficients


def _sd(*parts: tuple[float, ...] | float, number: int = 3) -> np.ndarray:
    return np.sqrt(sum(np.broadcast_to(part, number).astype(float) ** 2 for part in parts))


def _imu_biases(scenario: Scenario) -> tuple[np.ndarray, np.ndarray]:
    """Return how large the biases of body rates and specific force are (3 each), or what zeroing leaves of them."""
    if scenario.samples_at_rest:
        return left_at_rest(scenario)
    imu = scenario.truth.imu
    return _sd(imu.rates, imu.rates_sd), _sd(imu.specific_force, imu.specific_force_sd)


def _forces(scenario: Scenario, k: float) -> list[Error]:
    vehicle, force, imu = scenario.truth.vehicle, scenario.truth.force, scenario.truth.imu
    m, h = scenario.vehicle.mass, scenario.h
    _, Gamma_d = discretize(hover_A(scenario.yaw), hover_B_d(scenario.vehicle), h)
    factors = (vehicle.mass_factor - 1.0, vehicle.mass_factor_sd, vehicle.thrust_factor - 1.0, vehicle.thrust_factor_sd)
    lift = tuple((0.0, 0.0, m * GRAVITY * factor) for factor in factors)
    lasting, push, pull = {"force": own(3)}, (1.0 - k) * Gamma_d[:, :3], -k * m * Gamma_d[:, :3]
    bias = _imu_biases(scenario)[1]
    off = _sd(vehicle.center_of_gravity[::-1], vehicle.center_of_gravity_sd, number=2)
    return [
        walk(_sd(force.mean, force.mean_sd, *lift), 0.0, lasting, push),
        gauss_markov(_sd(force.gust_sd), force.gust_time, h, lasting, push),
        walk(bias, imu.specific_force_walk * np.sqrt(h), {"force": lambda rows: m * own(3)(rows)}, pull),
        walk(m * GRAVITY * off, 0.0, {}, Gamma_d[:, 3:5]),
    ]


def _of_sensors(scenario: Scenario, room: Room) -> list[Error]:
    truth, h = scenario.truth, scenario.h
    imu, uwb, survey, camera = truth.imu, truth.uwb, truth.survey, truth.camera
    anchors, landmarks = len(room.anchor_positions), len(room.landmark_positions)
    angles = np.array([*_sd(imu.level, imu.level_sd, number=2), np.hypot(imu.yaw, imu.yaw_sd)])
    walks = np.array([imu.level_walk, imu.level_walk, imu.yaw_walk]) * np.sqrt(h)
    turn = np.cross(np.eye(3), room.camera.position)  # of the camera's centre by each angle

    def turned(rows: np.ndarray) -> np.ndarray:
        g = rows[:, GRADIENT]
        return np.asarray(g[:, 3:6] - g[:, :3] @ turn.T)

    return [
        walk(angles, walks, {"imu": own(3)}),
        walk(_imu_biases(scenario)[0], imu.rates_walk * np.sqrt(h), {"rates": own(3)}),
        walk(_sd(uwb.bias, number=1), 0.0, {"uwb": lambda rows: np.ones((len(rows), 1))}),
        walk(_sd(uwb.bias_sd, number=anchors), 0.0, {"uwb": own(anchors)}),
        gauss_markov(_sd(uwb.slow_sd, number=anchors), uwb.slow_time, h, {"uwb": own(anchors)}),
        walk(_sd(survey.anchors), 0.0, {"uwb": moved(-1.0)}),
        walk(_sd(survey.anchors_sd, number=3 * anchors), 0.0, {"uwb": moved(-1.0, anchors)}),
        walk(_sd(survey.landmarks), 0.0, {"camera": moved(-1.0)}),
        walk(_sd(survey.landmarks_sd, number=3 * landmarks), 0.0, {"camera": moved(-1.0, landmarks, 2)}),
        walk(_sd(camera.position, camera.position_sd), 0.0, {"camera": moved(1.0)}),
        walk(_sd(camera.angles, camera.angles_sd), 0.0, {"camera": turned}),
    ]


def _of_registered(scenario: Scenario) -> list[Error]:
    biases, found = getattr(scenario.estimator, "biases", None), []
    for name in dict(scenario.truth.sensors):
        sensor = find_sensor(name)
        if biases is not None and sensor is not None:
            sd = np.array([dict(biases.row_sd).get(row.name, 0.0) for row in sensor.rows])
            found.append(gauss_markov(sd, biases.row_time, scenario.h, {name: own(len(sd))}))
    return found


def unknown_errors(scenario: Scenario, room: Room, k: float) -> Error:
    """Return all that a scenario's truth leaves unknown, as one error; none of its components is certain.

    Args:
        scenario: the scenario flown.
        room: its anchors and landmarks.
        k: the share of the specific force in what is known of a step's force, see above; 0 where it is not read.
    """
    every = [*_forces(scenario, k), *_of_sensors(scenario, room), *_of_registered(scenario)]
    unsure = [(error.sd > 0.0) | (error.step_sd > 0.0) for error in every]
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
        nothing = np.zeros((N_X, 0)) if name == "G" else np.zeros(0)
        return np.concatenate([nothing, *(getattr(error, name)[..., there] for error, there in some)], axis=-1)

    sees = {kind: coefficients(kind) for error, _ in some for kind in error.sees}
    return Error(all_of("sd"), all_of("step_sd"), all_of("keeps"), all_of("G"), sees)


def start_covariance(scenario: Scenario) -> np.ndarray:
    """Return P_0 (12 x 12): how far from the first estimate a flight starts."""
    start, sd = scenario.truth.start, np.zeros(N_X)
    sd[:3], sd[5] = _sd(start.position, start.position_sd), np.hypot(start.yaw, start.yaw_sd)
    return np.diag(sd**2)
