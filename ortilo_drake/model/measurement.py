"""The layout of the measurement vector: each sensor's rows of y, the states in them, and the sensor's covariance in V2.

A list of sensors gives

    y = [y_1, ..., y_s]              the values, m_j rows of sensor j                                (p)
    delta = [delta_1, ..., delta_s]  1 if the sensor's value arrived in this tick, else 0            (s)
    V2 = [V_1, ..., V_s]             the covariances, each row by row                                (q = sum m_j^2)

The filter's model of the values is y_j = C_j x + v_j, v_j of covariance V_j.
"""

from collections.abc import Iterable
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from ortilo_drake.model.hover import hover_A
from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.signals import CONTROL_NAMES, N_X, N_XBAR, REFERENCE_SIZE, SENSORS, STATE_NAMES

POSITION: Final = STATE_NAMES[:3]


class Row(NamedTuple):
    """One row of y: its name, and the states on which it depends with their coefficients in C."""

    name: str
    sees: tuple[tuple[str, float], ...]


def row(name: str, **sees: float) -> Row:
    """Return a row of y with a name and the coefficients of states, as in ``row("z_alt", z=1.0)``.

    ValueError if a state is not in STATE_NAMES, or no state is given.
    """
    unknown = [state for state in sees if state not in STATE_NAMES]
    if unknown or not sees:
        raise ValueError(f"{name}: sees {unknown or 'nothing'}: must be among {', '.join(STATE_NAMES)}")
    return Row(name, tuple((state, float(c)) for state, c in sees.items()))


def rows_matrix(rows: Iterable[Row]) -> np.ndarray:
    """Return the matrix C of some rows over the states (m, 12)."""
    return np.array([[sum(c for state, c in own.sees if state == name) for name in STATE_NAMES] for own in rows], float)


def seen_earlier(own: Row, age: float, yaw: float = 0.0) -> Row:
    """Return the row, over the present state, of a value measured `age` [s] ago: C (I - age A), to first order.

    A is the matrix of the hover model at this yaw [rad] (model/hover.py). The control and the disturbance since then
    are neglected: a constant angular acceleration alpha gives an angle the additional change alpha age^2 / 2.
    """
    C = rows_matrix([own])[0]
    C = C - age * (C @ hover_A(yaw))
    return Row(own.name, tuple((STATE_NAMES[i], float(C[i])) for i in np.flatnonzero(C)))


Rows = tuple[tuple[str, tuple[Row, ...]], ...]  # a sensor's name and its rows, for each sensor
UWB: Final = tuple(row(f"{axis}_uwb", **{axis: 1.0}) for axis in POSITION)
CAMERA: Final = tuple(row(f"{axis}_cam", **{axis: 1.0}) for axis in POSITION)
ATTITUDE_CAMERA: Final = tuple(row(f"{angle}_cam", **{angle: 1.0}) for angle in STATE_NAMES[3:6])
IMU: Final = tuple(row(f"{angle}_imu", **{angle: 1.0}) for angle in STATE_NAMES[3:6])
PAPER: Final[Rows] = tuple(zip(SENSORS, (UWB, CAMERA, IMU), strict=True))


class Layout(NamedTuple):
    """The measurement's layout, in arrays for compiled functions."""

    C: np.ndarray
    """measurement matrix over the states (p, 12), or over more states, see Measurement."""
    states: np.ndarray
    """C as a sparse matrix: the indices of the states in each row (p, w), w the largest number of any row ..."""
    weights: np.ndarray
    """... and their coefficients (p, w), padded with 0."""
    first: np.ndarray
    """first row of each sensor, and p at the end (s + 1)."""
    block: np.ndarray
    """index in V2 at which each sensor's covariance begins, and q at the end (s + 1)."""
    is_position: np.ndarray
    """whether a sensor's first three rows are p_WB itself, which the integrator may use (s)."""


def _measures_position(rows: tuple[Row, ...]) -> bool:
    """Return whether three rows are p_WB, apart from terms of extra states such as biases."""
    of_vehicle = [tuple(seen for seen in r.sees if seen[0] in STATE_NAMES) for r in rows]
    return of_vehicle == [((axis, 1.0),) for axis in POSITION]


class Measurement:
    """The measurement of a list of sensors; make_measurement caches one for each list.

    Its arguments are each sensor's rows and the states over which C is defined; a filter with extra states has more
    than STATE_NAMES.

    Attributes:
        sensors: names of the sensors (s).
        outputs: names of the rows of y (p).
        layout: arrays for compiled functions.
        sizes: sizes of the signals y, delta and V2.
    """

    def __init__(self, rows: Rows, states: tuple[str, ...] = STATE_NAMES):
        self.rows, self.states, self.sensors = rows, states, tuple(name for name, _ in rows)
        self.outputs = tuple(r.name for _, own in rows for r in own)
        widest = max((len(r.sees) for _, own in rows for r in own), default=1)
        C = np.zeros((len(self.outputs), len(states)))
        seen, weights = np.zeros((len(C), widest), dtype=np.int64), np.zeros((len(C), widest))
        for i, r in enumerate(r for _, own in rows for r in own):
            for k, (state, coefficient) in enumerate(r.sees):
                seen[i, k], weights[i, k] = states.index(state), coefficient
                C[i, seen[i, k]] = coefficient
        lengths = np.array([len(own) for _, own in rows], dtype=np.int64)
        is_position = [_measures_position(own[:3]) for _, own in rows]
        first = np.concatenate(([0], np.cumsum(lengths)))
        block = np.concatenate(([0], np.cumsum(lengths**2)))
        self.layout = Layout(C, seen, weights, first, block, np.array(is_position, dtype=np.bool_))
        self.sizes = {"y": int(first[-1]), "delta": len(rows), "V2": int(block[-1])}

    @property
    def positions(self) -> tuple[str, ...]:
        """The sensors whose first three rows are p_WB."""
        return tuple(name for name, is_it in zip(self.sensors, self.layout.is_position, strict=True) if is_it)

    @property
    def inertial(self) -> int:
        """The index of the sensor that has the imu's rows; ValueError if there is none."""
        names = [[r.name for r in own] for _, own in self.rows]
        return names.index([r.name for r in IMU])

    def rows_of(self, sensor: str) -> slice:
        """Return the slice of a sensor's rows in y."""
        j = self.sensors.index(sensor)
        return slice(int(self.layout.first[j]), int(self.layout.first[j + 1]))

    def block_of(self, sensor: str) -> slice:
        """Return the slice of a sensor's covariance in V2."""
        j = self.sensors.index(sensor)
        return slice(int(self.layout.block[j]), int(self.layout.block[j + 1]))

    def C_of(self, sensor: str) -> np.ndarray:
        """Return a sensor's rows of C (m, 12)."""
        return np.array(self.layout.C[self.rows_of(sensor)])

    def by_row(self, delta: np.ndarray) -> np.ndarray:
        """Return delta (..., s) repeated for the rows of y (..., p): each row gets the arrival of its sensor."""
        return np.repeat(delta, np.diff(self.layout.first), axis=-1)

    def arrival_matrix(self, delta: np.ndarray) -> np.ndarray:
        """Return Delta_k (p x p): the arrivals on the diagonal, each once for every row of its sensor."""
        return np.diag(self.by_row(delta))

    def selection_matrix(self, delta: np.ndarray) -> np.ndarray:
        """Return E_k (3 x p), which selects the integrator's position: the first position sensor that arrived."""
        E = np.zeros((3, self.sizes["y"]))
        arrived = np.flatnonzero(self.layout.is_position & (np.asarray(delta) > 0.0))
        if arrived.size:
            start = self.layout.first[arrived[0]]
            E[:, start : start + 3] = np.eye(3)
        return E

    def matrix(self, V2: np.ndarray) -> np.ndarray:
        """Return the block diagonal covariance matrix (p x p) of V2 (q)."""
        V = np.zeros((self.sizes["y"],) * 2)
        for sensor in self.sensors:
            rows = self.rows_of(sensor)
            V[rows, rows] = V2[self.block_of(sensor)].reshape(rows.stop - rows.start, -1)
        return V

    def logged_sizes(self) -> dict[str, int]:
        """Return the names and sizes of the signals in a flight's log, in their order."""
        onboard = {"estimate": N_XBAR, "covariance": N_XBAR * N_XBAR, "reference": REFERENCE_SIZE}
        return {"state": N_X, "control": len(CONTROL_NAMES), **self.sizes, **onboard}


@lru_cache(maxsize=64)
def make_measurement(rows: Rows = PAPER) -> Measurement:
    """Return the measurement of a list of sensors, by default the paper's three.

    InputError if two sensors or two rows have the same name.
    """
    names = [name for name, _ in rows] + [r.name for _, own in rows for r in own]
    if len(set(names)) != len(names):
        raise InputError(f"sensors: {', '.join(names)}: every sensor and every row needs a name of its own")
    return Measurement(rows)
