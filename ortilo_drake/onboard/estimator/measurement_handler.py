"""The intermittent measurements handler (paper, section IV-B).

It stacks what arrived in this tick into y_k, says by Delta_k which of it is there, and gives each sensor's
noise covariance. The filter forms H_k = Delta_k Cbar and E_k from the arrivals, row by row, in intermittent_filter.py
(STATE_OF_ROW, integrated_sensor); arrival_matrix and selection_matrix below are the same at full size, as the paper
writes them.

What becomes of a measurement that comes late is the scenario's to say (estimator.delay). With 'ignore' it enters as
if it were current and its stamp is not used; with 'drop' it must not be older than MAX_AGE ticks, and then enters as
if it were current; with 'replay' the stamps go to the filter, see late_measurements.py.
"""

from collections.abc import Callable

import numpy as np
from numba import njit
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.signals import FIX_SIZE, IMU_SIZE, MEASUREMENT_SIZE, N_XBAR, SENSORS, STAMP
from ortilo_drake.onboard.gate import squared_gate
from ortilo_drake.scenario import Noise
from ortilo_drake.scenario.onboard import Gates

MAX_AGE = 1  # of a measurement that 'drop' still uses [ticks]: a detector takes one, so none would leave no camera


@njit(cache=True)
def squared_distance(fix: np.ndarray, xhat: np.ndarray, P: np.ndarray, V: np.ndarray, size: int) -> float:
    """Return the squared Mahalanobis distance e^T (P_pp + V)^-1 e of a fix from the predicted position.

    It is infinite where the prediction is no longer finite.
    """
    S = np.empty((3, 3))
    e = np.empty(3)
    for i in range(3):
        e[i] = fix[2 + i] - xhat[i]
        for j in range(3):
            S[i, j] = P[i * size + j] + V[3 * i + j]
    if not (np.all(np.isfinite(S)) and np.all(np.isfinite(e))):  # solve would raise
        return np.inf
    return float(e @ np.linalg.solve(S, e))


@njit(cache=True)
def stack_measurements(
    uwb: np.ndarray,
    camera: np.ndarray,
    imu: np.ndarray,
    xhat: np.ndarray,
    P: np.ndarray,
    V: np.ndarray,
    from_fix: np.ndarray,
    gates: np.ndarray,
) -> np.ndarray:
    """Return [y, delta, V2's blocks] of this tick (39).

    y = [uwb position, camera position, imu angles]; delta_j = 1 where sensor j's measurement is there and, for a
    position, within its gate. Rows that did not arrive hold 0.

    Args:
        uwb: fix message (14).
        camera: fix message (14).
        imu: imu message (11).
        xhat: prediction (15), for the gates.
        P: its covariance, row by row (225).
        V: constant noise covariances of the three sensors, row by row (3, 9).
        from_fix: 1 where a position sensor's covariance comes with each fix (2).
        gates: largest squared Mahalanobis distance of each position sensor, inf for none (2).
    """
    out = np.zeros(39)
    for j in range(2):
        fix = uwb if j == 0 else camera
        block = fix[5:14] if from_fix[j] else V[j]
        out[12 + 9 * j : 21 + 9 * j] = block
        if fix[0] == 0.0:
            out[12 + 9 * j : 21 + 9 * j] = V[j]
        elif np.isinf(gates[j]) or squared_distance(fix, xhat, P, block, 15) <= gates[j]:
            out[3 * j : 3 * j + 3] = fix[2:5]
            out[9 + j] = 1.0
    if imu[0] != 0.0:
        out[6:9] = imu[2:5]
        out[11] = 1.0
    out[30:39] = V[2]
    return out


@njit(cache=True)
def drop_late(measurement: np.ndarray, stamps: np.ndarray, k: int, h: float) -> None:
    """Take out of a measurement (39) of tick k what is older than MAX_AGE ticks, by the stamps (3)."""
    for j in range(3):
        if k - tick_of(stamps[j], h) > MAX_AGE:
            measurement[3 * j : 3 * j + 3] = 0.0
            measurement[9 + j] = 0.0


def arrival_matrix(delta: np.ndarray) -> np.ndarray:
    """Return Delta_k (9 x 9): each arrival repeated three times on the diagonal."""
    return np.diag(np.repeat(delta, 3))


def selection_matrix(delta: np.ndarray) -> np.ndarray:
    """Return E_k = [Delta_1, not Delta_1 and Delta_2, 0] (3 x 9): the position the integrator uses."""
    E = np.zeros((3, 9))
    E[:, 0:3] = np.eye(3) * delta[0]
    E[:, 3:6] = np.eye(3) * (1.0 - delta[0]) * delta[1]
    return E


def _always(value: np.ndarray) -> Callable[[Context], np.ndarray]:
    """Return what stands in for a port that is not there."""
    return lambda _: value


class MeasurementHandler(LeafSystem):
    """Turns fixes and imu angles into y_k, the arrivals and V2.

    Ports:
        uwb (14), camera (14): fix messages; each only if its sensor flies.
        imu (11): imu message; only if it flies.
        estimate (15): xhat_k|k-1; only if there is a gate.
        covariance (225): P_k row by row; only if there is a gate.
        measurement (39, output): y (9), delta (3), V2's three blocks row by row (27).
        stamps (3, output): when each sensor's measurement was true [s], 0 where none arrived; only with 'replay'.

    Memoryless, but for the time that 'drop' reads. A sensor that does not fly never arrives. A gate judges a late fix
    by the present prediction.

    Args:
        gates: probability of each gate, by sensor.
        noise: V.
        h: tick [s], by which 'drop' judges.
        sensors: which of uwb, camera and imu fly.
        delay: 'ignore', 'drop' or 'replay': what becomes of a late measurement.
    """

    def __init__(
        self,
        gates: Gates,
        noise: Noise,
        h: float,
        sensors: tuple[str, ...] = SENSORS,
        delay: str = "ignore",
    ):
        super().__init__()
        self.set_name("measurement_handler")
        variances = (noise.uwb, noise.camera, noise.imu)
        self._V = np.array([np.diag(v if v is not None else (1.0, 1.0, 1.0)).ravel() for v in variances])
        self._from_fix = np.array([noise.uwb is None, noise.camera is None])
        gate_of, is_gated = dict(gates), bool(gates)
        self._gates = np.array([squared_gate(gate_of[s], 3) if s in gate_of else np.inf for s in SENSORS[:2]])
        sizes = {"uwb": FIX_SIZE, "camera": FIX_SIZE, "imu": IMU_SIZE}
        ports = [self.DeclareVectorInputPort(s, sizes[s]) if s in sensors else None for s in SENSORS]
        ports += [
            self.DeclareVectorInputPort(name, size) if is_gated else None
            for name, size in (("estimate", N_XBAR), ("covariance", N_XBAR * N_XBAR))
        ]
        absent = [np.zeros(n) for n in (FIX_SIZE, FIX_SIZE, IMU_SIZE, N_XBAR, N_XBAR * N_XBAR)]
        self._inputs = [
            _always(zeros) if port is None else port.Eval for port, zeros in zip(ports, absent, strict=True)
        ]
        self._h, messages = h, ports[: len(SENSORS)]
        needs = {port.ticket() for port in ports if port is not None} or {self.nothing_ticket()}
        if delay == "drop":
            calc, needs = self._calc_recent, needs | {self.time_ticket()}
        else:
            calc = self._calc_measurement
        self.DeclareVectorOutputPort("measurement", MEASUREMENT_SIZE, calc, prerequisites_of_calc=needs)
        if delay == "replay":
            needs = {port.ticket() for port in messages if port is not None} or {self.nothing_ticket()}
            self.DeclareVectorOutputPort("stamps", len(SENSORS), self._calc_stamps, prerequisites_of_calc=needs)

    def _calc_measurement(self, context: Context, output: BasicVector) -> None:
        inputs = [value(context) for value in self._inputs]
        output.SetFromVector(stack_measurements(*inputs, self._V, self._from_fix, self._gates))

    def _stamps(self, context: Context) -> np.ndarray:
        return np.array([value(context)[STAMP] for value in self._inputs[: len(SENSORS)]])

    def _calc_recent(self, context: Context, output: BasicVector) -> None:
        inputs = [value(context) for value in self._inputs]
        measurement = stack_measurements(*inputs, self._V, self._from_fix, self._gates)
        drop_late(measurement, self._stamps(context), tick_of(context.get_time(), self._h), self._h)
        output.SetFromVector(measurement)

    def _calc_stamps(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._stamps(context))
