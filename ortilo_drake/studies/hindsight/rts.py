"""The fixed-interval smoother of the paper's filter, with all further states of the filter.

The forward pass is the filter itself, by the step that flew (intermittent_filter.py), on [x; e] without the integral,
which is a known quantity. Each of its predictions gives

    S_k = H P_k H^T + V2,  L_k = Phi (I - P_k H^T S_k^-1 H),  e_k = y_k - H xhat_{k|k-1}

Backward, from r = 0 and N = 0 after the last tick,

    r <- H^T S_k^-1 e_k + L_k^T r,   xhat_{k|n} = xhat_{k|k-1} + P_k r
    N <- H^T S_k^-1 H + L_k^T N L_k,  P_{k|n} = P_k - P_k N P_k

This is the smoother of Rauch, Tung and Striebel (AIAA Journal 3, 1965) in the form of Bryson and Frazier (1963) and de
Jong (J. American Statistical Association 84, 1989). RTS inverts P_{k+1|k}, which is singular here: W has rank 6, and
states may begin without variance. This form inverts only S_k.

The tilted lift (intermittent_filter.tilted_lift) is a known input, which the filter adds.
"""

from typing import NamedTuple

import numpy as np

from ortilo_drake.flight.flight import logged_rows
from ortilo_drake.model.measurement import Measurement
from ortilo_drake.model.signals import ARRIVED, IMU_SIZE, N_I, N_X, PAYLOAD, samples_in
from ortilo_drake.onboard.estimator.at_rest import rest_of
from ortilo_drake.onboard.estimator.extra_states import augmented_rows, extra_states
from ortilo_drake.onboard.estimator.filter_model import augmented_model, initial_covariance
from ortilo_drake.onboard.estimator.imu_rows import imu_variances, with_imu_rows
from ortilo_drake.onboard.estimator.intermittent_filter import FilterModel, filter_step
from ortilo_drake.scenario import IntermittentFilter, Scenario
from ortilo_drake.studies.hindsight.recorded_flight import RecordedFlight


class Tick(NamedTuple):
    """The signals that a linear filter took in at a tick."""

    y: np.ndarray
    """values (p)."""
    delta: np.ndarray
    """arrivals (s)."""
    V2: np.ndarray
    """the sensors' covariances, each flattened row by row (q)."""
    u: np.ndarray
    """control less hover (4)."""


class Smoothed(NamedTuple):
    """The estimates of a flight of n ticks."""

    x: np.ndarray
    """[x; e] (n, N)."""
    P: np.ndarray
    """covariance (n, N, N)."""


class Forward(NamedTuple):
    """The forward pass of a filter over n ticks."""

    prior: Smoothed
    """xhat_{k|k-1} and P_k."""
    carries: np.ndarray
    """L_k (n, N, N)."""
    gradient: np.ndarray
    """H^T S^-1 e (n, N)."""
    information: np.ndarray
    """H^T S^-1 H (n, N, N)."""


def arrived(measurement: Measurement, tick: Tick) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the values that arrived (m), their rows over [x; e] (m, N) and their covariance (m, m)."""
    there = measurement.by_row(tick.delta) > 0.0
    return tick.y[there], measurement.layout.C[there], measurement.matrix(tick.V2)[np.ix_(there, there)]


def run_forward(
    model: FilterModel, measurement: Measurement, x_0: np.ndarray, P_0: np.ndarray, ticks: list[Tick]
) -> Forward:
    """Run the filter's recursion over ticks, from the first estimate x_0 of [x; e] (N) and its covariance P_0 (N, N).

    model: the filter's model of the vehicle, whose integrator is not used; measurement: the rows over [x; e].
    """
    n, N = len(ticks), len(x_0)
    found = Forward(
        Smoothed(np.empty((n, N)), np.empty((n, N, N))), np.empty((n, N, N)), np.zeros((n, N)), np.zeros((n, N, N))
    )
    belief = np.concatenate((x_0, np.zeros(N_I), np.pad(P_0, (0, N_I)).ravel()))
    for k, tick in enumerate(ticks):
        x, P = found.prior.x[k], found.prior.P[k]
        x[:], P[:] = belief[:N], belief[N + N_I :].reshape(N + N_I, N + N_I)[:N, :N]
        y, H, V = arrived(measurement, tick)
        HT_S = np.linalg.solve(H @ P @ H.T + V, H).T  # H^T S^-1
        found.gradient[k], found.information[k] = HT_S @ (y - H @ x), HT_S @ H
        found.carries[k] = model.Phi @ (np.eye(N) - P @ found.information[k])
        belief = filter_step(belief, *tick, np.zeros(N_I), model, measurement.layout)
    return found


def smooth(found: Forward) -> Smoothed:
    """Return the smoothed estimates of a run, each by all measurements."""
    (x, P), out = found.prior, Smoothed(np.empty_like(found.prior.x), np.empty_like(found.prior.P))
    r, N = np.zeros(x.shape[1]), np.zeros(P.shape[1:])
    for k in range(len(x) - 1, -1, -1):
        L = found.carries[k]
        r = found.gradient[k] + L.T @ r
        N = found.information[k] + L.T @ N @ L
        out.x[k], out.P[k] = x[k] + P[k] @ r, P[k] - P[k] @ N @ P[k]
    return out


def is_linear(scenario: Scenario) -> bool:
    """Return whether a run of the scenario's filter can be smoothed here: the filter is linear, and never runs again.

    A filter that learns the anchors' survey is not linear: the learned survey changes its fixes. A learned scale of the
    ranges' noise changes only the V of the fixes, and a log has the V of each fix.
    """
    settings, learns = scenario.estimator, scenario.multilateration.bias_bank is not None
    return isinstance(settings, IntermittentFilter) and settings.delay != "replay" and not learns


def linear_problem(
    recorded: RecordedFlight,
) -> tuple[FilterModel, Measurement, np.ndarray, np.ndarray, list[Tick]]:
    """Return the model, the measurement, first estimate, its covariance, and the ticks of a flight by a linear filter.

    The values are those that the filter took in: fixes as they were made and gated in flight.
    """
    scenario, flight = recorded.scenario, recorded.flight
    belief = scenario.belief
    settings, vehicle = belief.estimator, belief.vehicle
    extras = extra_states(settings, vehicle, belief.h, belief.flown_rows, belief.yaw)
    model = augmented_model(settings, vehicle, settings.integrator, belief.h, extras, belief.yaw)
    measurement = augmented_rows(belief.measurement.rows, extras)
    N = len(model.Phi)
    x_0 = np.zeros(N)
    x_0[:N_X] = flight["estimate"].values[0, :N_X]
    variances, hover = imu_variances(belief), np.array([vehicle.hover_thrust, 0.0, 0.0, 0.0])
    ticks = []
    for row, messages in zip(logged_rows(flight), recorded.messages, strict=True):
        signals = row["y"], row["delta"], np.nan_to_num(row["V2"])
        if variances is not None:
            j = belief.measurement.inertial
            imu = _one_sample(messages.get(belief.measurement.sensors[j]), belief.imu_samples)
            signals = with_imu_rows(*signals, imu, j, variances)
        ticks.append(Tick(*signals, row["control"] - hover))
    return model, measurement, x_0, initial_covariance(settings, extras, rest_of(belief), belief.yaw)[:N, :N], ticks


def _one_sample(message: np.ndarray | None, n: int) -> np.ndarray:
    """Return an imu message of one sample: the mean of a tick's n samples, as in onboard/sample_mean.py."""
    if message is None:
        return np.zeros(IMU_SIZE)
    if n == 1:
        return message
    samples = samples_in(message, n)
    mean = np.concatenate((message[:PAYLOAD], samples[:, PAYLOAD:].mean(axis=0)))
    return mean if samples[:, ARRIVED].all() else np.zeros(IMU_SIZE)


def smoothed(recorded: RecordedFlight) -> Smoothed:
    """Return the smoothed estimates of a flight with a linear filter, see is_linear."""
    return smooth(run_forward(*linear_problem(recorded)))
