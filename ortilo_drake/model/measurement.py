"""The measurement vector: which rows of y each sensor fills, which states they see, and where its covariance stands.

A list of sensors gives

    y = [y_1, ..., y_s]            the values, m_j rows of sensor j                                  (p)
    delta = [delta_1, ..., delta_s]  1 where the sensor's value arrived in this tick                 (s)
    V2 = [V_1, ..., V_s]           their covariances, each row by row                                (q = sum m_j^2)

The filter's model of the values is y_j = C_j x + v_j, v_j of covariance V_j.
"""

from collections.abc import Iterable
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from ortilo_drake.model.hover import hover_A
from ortilo_drake.model.signals import CONTROL_NAMES, N_X, N_XBAR, REFERENCE_SIZE, SENSORS, STATE_NAMES

POSITION: Final = STATE_NAMES[:3]


class Row(NamedTuple):
    """One row of y: its name, and the states that it sees with their coefficients in C."""

    name: str
    sees: tuple[tuple[str, float], ...]


def row(name: str, **sees: float) -> Row:
    """Name a row of y and the states that it sees, as in ``row("z_alt", z=1.0)``.

    ValueError if a state is none of STATE_NAMES, or none is seen.
    """
    unknown = [state for state in sees if state not in STATE_NAMES]
    if unknown or not sees:
        raise ValueError(f"{name}: sees {unknown or 'nothing'}: must be among {', '.join(STATE_NAMES)}")
    return Row(name, tuple((state, float(c)) for state, c in sees.items()))


def rows_matrix(rows: Iterable[Row]) -> np.ndarray:
    """Return the rows of C over the states (m, 12)."""
    return np.array([[sum(c for state, c in own.sees if state == name) for name in STATE_NAMES] for own in rows], float)


def seen_earlier(own: Row, age: float, yaw: float = 0.0) -> Row:
    """Return the row of a value that is some time old [s], over the state of now: C (I - age A), to first order.

    A is the hover model's under that yaw [rad] (model/hover.py). Left out are the control and the disturbance that
    acted since: a constant angular acceleration alpha changes an angle by alpha age^2 / 2 beyond it.
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
    """The measurement's layout as compiled functions take it."""

    C: np.ndarray
    """rows of y over the states (p, 12), or more, see Measurement."""
    states: np.ndarray
    """the same sparsely: which states a row sees (p, w), w the most of any row ..."""
    weights: np.ndarray
    """... and with which coefficients (p, w), 0 where it sees fewer."""
    first: np.ndarray
    """first row of each sensor, and p (s + 1)."""
    block: np.ndarray
    """where each sensor's covariance begins in V2, and q (s + 1)."""
    is_position: np.ndarray
    """whether a sensor's first three rows are p_WB itself, which the integrator may take (s)."""


def _measures_position(rows: tuple[Row, ...]) -> bool:
    """Return whether three rows are p_WB, whatever else than the vehicle's states they see."""
    of_vehicle = [tuple(seen for seen in r.sees if seen[0] in STATE_NAMES) for r in rows]
    return of_vehicle == [((axis, 1.0),) for axis in POSITION]


class Measurement:
    """The measurement of a list of sensors; make_measurement keeps one for each list.

    It is made of each sensor's rows, and of the states that C is over, more than STATE_NAMES in a filter that carries
    more.

    Attributes:
        sensors: their names (s).
        outputs: names of the rows of y (p).
        layout: for compiled functions.
        sizes: of the signals y, delta and V2.
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
        """The number of the sensor whose rows are the imu's; ValueError if there is none."""
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
        """Return delta (..., s) spread over the rows of y: each row's sensor (..., p)."""
        return np.repeat(delta, np.diff(self.layout.first), axis=-1)

    def arrival_matrix(self, delta: np.ndarray) -> np.ndarray:
        """Return Delta_k (p x p): each arrival on the diagonal, once for each of its sensor's rows."""
        return np.diag(self.by_row(delta))

    def selection_matrix(self, delta: np.ndarray) -> np.ndarray:
        """Return E_k (3 x p), the position that the integrator takes: of the first position sensor that arrived."""
        E = np.zeros((3, self.sizes["y"]))
        arrived = np.flatnonzero(self.layout.is_position & (np.asarray(delta) > 0.0))
        if arrived.size:
            start = self.layout.first[arrived[0]]
            E[:, start : start + 3] = np.eye(3)
        return E

    def matrix(self, V2: np.ndarray) -> np.ndarray:
        """Return V2 (q) as the block diagonal matrix that it stands for (p x p)."""
        V = np.zeros((self.sizes["y"],) * 2)
        for sensor in self.sensors:
            rows = self.rows_of(sensor)
            V[rows, rows] = V2[self.block_of(sensor)].reshape(rows.stop - rows.start, -1)
        return V

    def logged_sizes(self) -> dict[str, int]:
        """Return the signals of a flight's log with their sizes, in their order."""
        onboard = {"estimate": N_XBAR, "covariance": N_XBAR * N_XBAR, "reference": REFERENCE_SIZE}
        return {"state": N_X, "control": len(CONTROL_NAMES), **self.sizes, **onboard}


@lru_cache(maxsize=64)
def make_measurement(rows: Rows = PAPER) -> Measurement:
    """Return the measurement of a list of sensors; of the paper's three by default.

    ValueError if two sensors or two rows have the same name.
    """
    names = [name for name, _ in rows] + [r.name for _, own in rows for r in own]
    if len(set(names)) != len(names):
        raise ValueError(f"{', '.join(names)}: every sensor and every row needs a name of its own")
    return Measurement(rows)
