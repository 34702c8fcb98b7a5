"""The Cramer-Rao floor: the least mean squared error that any estimator of the position can have.

It is the posterior bound for discrete-time filtering (Tichavsky, Muravchik and Nehorai, "Posterior Cramer-Rao bounds
for discrete-time nonlinear filtering", IEEE Trans. Signal Processing 46, 1998; Van Trees, 1968), for linear dynamics

    x_{k+1} = Phi x_k + Gamma u_k + w_k,   w_k normal of covariance W,

for the one-step prediction of x_k from the measurements before tick k. It is in covariance form because W has rank 6:

    P_{k+1} = Phi (P_k^-1 + J_k)^-1 Phi^T + W.

J_k is the information of the measurements that were taken in tick k and reached the vehicle. W is the covariance of the
world's disturbance, not the filter's. P_0 is 0 unless ``truth.start`` differs: flights start at the filter's first
estimate. The part of a camera's errors that persists from picture to picture is estimated as well
(information_filter.py), so it is not counted as new in every picture. So are the errors that the scenario's ``truth``
leaves unknown (unknown_errors.py): this floor is for an estimator that knows how large the errors may be.

Kind of bound. J_k is taken at each flight's true trajectory and arrivals, and the bounds are averaged over ticks and
flights. This is the covariance of an estimator that knows all Jacobians. With linear measurements it is the posterior
bound given the arrivals. Otherwise the two differ because the information varies over the estimator's error. The
difference is small if that error is small against the distance of anchors and landmarks.

Every approximation adds information, so it lowers the floor:
- a late measurement counts from the tick in which it was taken;
- the disturbance is taken not to act between the samples of a sensor faster than the tick;
- the landmark of each box, the excess of a range behind walls, and the control that acted count as known;
- messages that gave no fix, or were refused, count;
- a specific force counts from the start of the step that it is measured in, and in ticks without an imu message too.
Data that no filter here uses is left out: the sizes of boxes, boxes cut by the border, and the absence of a landmark or
a message. So are body rates and specific force unless the scenario's filter reads them (estimator.rates, force). Phi
is that of hover, with the rotors' drag, also for a vehicle that flies nonlinearly.

Which messages reached the vehicle: the link's noise is a pure function of (seed, stream, tick), so the link's own
functions repeat its decisions from the truth. The result includes messages that gave no fix and those that a gate
refused.
"""

import numpy as np
from scipy.linalg import block_diag

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.floor.information_filter import predicted_bound
from ortilo_drake.floor.unknown_errors import start_covariance, unknown_errors
from ortilo_drake.model.hover import discretize, disturbance_W, drag_D, hover_A, hover_B_d
from ortilo_drake.model.room import Room
from ortilo_drake.scenario import Scenario
from ortilo_drake.sensors.described import information_of
from ortilo_drake.sensors.imu import reads, specific_force_sd
from ortilo_drake.sensors.information_rows import by_tick
from ortilo_drake.world.radio.link import NOT_SENT, Radio, chain_after, delay_of_message, radio_of


@cached_njit
def messages_sent(truth: np.ndarray, radio: Radio, seed: int) -> np.ndarray:
    """Return whether each tick's message was sent and not lost (n), given the true states (n, 12)."""
    sent, bad = np.zeros(truth.shape[0], dtype=np.bool_), False
    for k in range(truth.shape[0]):
        sent[k] = delay_of_message(radio, k, truth[k], bad, seed) != NOT_SENT
        bad = chain_after(k, bad, radio.loss, seed, radio.stream)
    return sent


def arrived(scenario: Scenario, sensor: str, truth: np.ndarray) -> np.ndarray:
    """Return whether a sensor's measurement of each tick reached the vehicle, in that tick or later (n).

    The scenario holds the flight's seed; `truth` (n, 12) holds its true states x_k.
    """
    if sensor not in scenario.sensors:
        return np.zeros(len(truth), dtype=bool)
    radio = radio_of(sensor, scenario.link_of(sensor), scenario.every(sensor), scenario.h)
    return np.asarray(messages_sent(np.ascontiguousarray(truth), radio, scenario.seed))


VELOCITY = slice(6, 9)  # in x


def position_floor(scenario: Scenario, truth: np.ndarray) -> np.ndarray | None:
    """Return the least mean squared position error of x_{k|k-1} per axis at every tick of a flight [m^2] (n, 3).

    None where the errors of the camera's detector have not been measured. The scenario holds the flight's seed; `truth`
    (n, 12) holds its true states x_k.
    """
    bounds = state_bound(scenario, truth)
    return None if bounds is None else np.maximum(np.diagonal(bounds, axis1=1, axis2=2)[:, :3], 0.0)


def measured_share(scenario: Scenario) -> float:
    """Return k of unknown_errors.py: the weight of the measured specific force in a tick's estimated white force."""
    sigma = scenario.world.disturbance.sds(scenario.h)[0]
    if not reads(scenario, "force") or sigma == 0.0:
        return 0.0
    return sigma**2 / (sigma**2 + specific_force_sd(scenario) ** 2)


def rows_by_kind(
    scenario: Scenario, truth: np.ndarray, room: Room, with_errors: bool
) -> tuple[dict[str, np.ndarray], int] | None:
    """Return a flight's rows of information (l, 17) by kind (the sensor's name), and the slow errors' node spacing.

    None where the errors of the camera's detector have not been measured. The room may differ from the scenario's. With
    with_errors, the rows of Information.with_errors are included. Other arguments as for position_floor.
    """
    rows: dict[str, np.ndarray] = {}
    spacing = 1
    for name in scenario.measurement.sensors:
        if name not in scenario.sensors:
            continue
        found = information_of(name, scenario, room, truth, arrived(scenario, name, truth))
        if found is None:
            return None
        rows |= found.rows
        rows |= found.with_errors if with_errors else {}
        spacing = max(spacing, found.spacing)
    return rows, spacing


def information_rows(scenario: Scenario, truth: np.ndarray, room: Room) -> tuple[np.ndarray, int] | None:
    """Return rows_by_kind's rows without errors, in the order of ticks (l, 17), and the spacing; same arguments."""
    found = rows_by_kind(scenario, truth, room, with_errors=False)
    return None if found is None else (by_tick(*found[0].values()), found[1])


def dynamics(scenario: Scenario) -> tuple[np.ndarray, np.ndarray]:
    """Return Phi and W (12 x 12) of a tick, with the part of the world's disturbance and drag that is not measured."""
    Phi, Gamma_d = discretize(hover_A(scenario.yaw), hover_B_d(scenario.vehicle), scenario.h)
    unmeasured = 1.0 - measured_share(scenario)
    Phi[:, VELOCITY] -= unmeasured * Gamma_d[:, :3] @ drag_D(scenario.world.drag, scenario.yaw)
    force_sd, torque_sd = scenario.world.disturbance.sds(scenario.h)
    force_sd *= float(np.sqrt(unmeasured))
    return Phi, disturbance_W(scenario.vehicle, scenario.h, force_sd, torque_sd, scenario.yaw)


def state_bound(scenario: Scenario, truth: np.ndarray) -> np.ndarray | None:
    """Return the bound on the covariance of x_{k|k-1} at every tick (n, 12, 12). Arguments as position_floor."""
    room = scenario.load_room()
    found = rows_by_kind(scenario, truth, room, with_errors=True)
    if found is None:
        return None
    rows, spacing = found
    errors = unknown_errors(scenario, room, measured_share(scenario))
    (Phi, W), e = dynamics(scenario), len(errors.sd)

    def seen(kind: str, rows: np.ndarray) -> np.ndarray:
        return np.hstack([rows, errors.sees[kind](rows) if kind in errors.sees else np.zeros((len(rows), e))])

    Phi = np.block([[Phi, errors.G], [errors.by_x.T, np.diag(errors.keeps)]])
    W, P_0 = block_diag(W, np.diag(errors.step_sd**2)), block_diag(start_covariance(scenario), np.diag(errors.sd**2))
    whole = by_tick(*(seen(kind, its) for kind, its in rows.items()))
    return np.asarray(predicted_bound(whole, len(truth), Phi, W, P_0, spacing))
