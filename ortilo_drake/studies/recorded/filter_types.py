"""What goes into the filter on single ranges, what it holds between two events, and what comes out.

Shapes: n anchors, N = 15 + 2 n error states [dp, dv, dtheta, db_g, db_a, dc, dg]; see single_ranges.py.
"""

from typing import NamedTuple

import numpy as np

IMU, RANGE, QUERY = 0, 1, 2  # kinds of events
FIXED = 15  # error states before the anchors'


class Events(NamedTuple):
    """What happens in order of time: stamp [s], kind, index (IMU sample or anchor), range [m] (n each)."""

    t: np.ndarray
    kind: np.ndarray
    which: np.ndarray
    r: np.ndarray


class Noise(NamedTuple):
    """Noise of the filter; units in interop/recorded/map_file.py, FilterSettings."""

    acceleration: float
    rotation: float
    acceleration_bias: float
    rotation_bias: float
    range_white: float
    range_correlated: float
    correlation_time: float
    bias_walk: float
    gate: float


class Level(NamedTuple):
    """What is known of the height: the antenna's z and its deviation [m], and the deviation of v_z [m/s].

    An infinite deviation says that nothing is known.
    """

    height: float
    deviation: float
    climb: float


UNKNOWN_LEVEL = Level(0.0, np.inf, np.inf)


class State(NamedTuple):
    """The filter between two events.

    t [s]; nominal p, v (3), R (3, 3), biases of gyro and accelerometer (3), c, g (n); covariance P (N, N); the sample
    of the IMU that holds (6); transition Phi since the last epoch (N, N), for a smoother.
    """

    t: float
    p: np.ndarray
    v: np.ndarray
    R: np.ndarray
    gyro: np.ndarray
    accelerometer: np.ndarray
    c: np.ndarray
    g: np.ndarray
    P: np.ndarray
    sample: np.ndarray
    since: np.ndarray


class Anew(NamedTuple):
    """Position and velocity (6) with variances (6) for a filter to start anew; `opening` is added to P's diagonal (N).

    They enter as measurements of the first epoch. An infinite variance says that there are none.
    """

    x: np.ndarray
    variances: np.ndarray
    opening: np.ndarray


class Watch(NamedTuple):
    """When a run stops: at ranges from `wait` on [s] if the position's deviation exceeds `astray` [m].

    It also stops if more than `share` of the anchors, and at least two, were refused for so long, `refused` [s].
    """

    wait: float
    astray: float
    refused: float
    share: float


class Run(NamedTuple):
    """What a run gives, at each epoch (a stamp with ranges or a query) and for each range.

    t (m); x (m, 12 + 2 n) nominal [p, v, b_g, b_a, c, g]; R (m, 3, 3); P (m, 3, 3) of the position; innovation, its
    variance and whether it was taken (one for each range); and for a smoother the predictions before the ranges:
    x_before, R_before, whole covariances P_before and P_after, and the transition Phi from the epoch before.
    """

    t: np.ndarray
    x: np.ndarray
    R: np.ndarray
    P: np.ndarray
    innovation: np.ndarray
    variance: np.ndarray
    taken: np.ndarray
    x_before: np.ndarray
    R_before: np.ndarray
    P_before: np.ndarray
    P_after: np.ndarray
    Phi: np.ndarray
