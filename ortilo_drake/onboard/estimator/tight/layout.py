"""The layout of the tight filter's state.

The nominal state has a position, a velocity, a unit quaternion and additive numbers, followed by the clones: the poses
of the last ticks. The error state has three numbers for an attitude, R_WB = R_hat exp([theta]x), theta in B:

    error    dp, dv, theta, db_g, db_a, the rest (additive), then (dp, theta) of each clone        (n)
    nominal  p_WB, v_WB, q_WB, b_g, b_a, the rest, then (p_WB, q_WB) of each clone                 (n + 1 + clones)

In all functions of the filter, x is the nominal state and C the covariance of the error state (n, n), both changed in
place; `layout` is the layout of both, and `taken` holds rows not yet subtracted from C (update.py).
"""

from typing import Final, NamedTuple

import numpy as np
from numba.extending import register_jitable

P: Final = 0  # p_WB [m]
V: Final = 3  # v_WB [m/s]
THETA: Final = 6  # attitude [rad]
GYRO: Final = 9  # bias of the body rates [rad/s]
ACCEL: Final = 12  # bias of the specific force [m/s^2]
N_INERTIAL: Final = 15
Q: Final = 6  # the quaternion in the nominal state (w, x, y, z)
ADDITIVE: Final = 10  # first index of the additive part in the nominal state; in the error state it is GYRO


class Layout(NamedTuple):
    """The first index, in the error state, of each group of states after the inertial ones; -1 for a missing group."""

    angles: int
    """errors of the imu's roll, pitch and yaw [rad] (3)."""
    clock: int
    """age of a uwb message and of a camera message beyond their stamps [s] (2)."""
    range_bias: int
    """constant error of each anchor's ranges [m]."""
    range_slow: int
    """slow error of each anchor's ranges [m]."""
    range_offset: int
    """common error of all ranges [m] (1): 0 until the watch opens it, see watch.py."""
    survey: int
    """true position of each landmark less its surveyed position [m] (3 each)."""
    pixel_slow: int
    """slow error of each landmark's box centre, u and v, divided by the error's standard deviation [1] (2 each)."""
    core: int
    """size of the error state without the clones."""
    clones: int
    """number of past poses that are kept."""
    n: int
    """size of the error state."""


GROUPS: Final = Layout._fields[:-3]


def make_layout(sizes: dict[str, int], clones: int) -> Layout:
    """Return the layout of groups with these sizes, in the order of Layout's fields; size 0 leaves a group out."""
    at, places = N_INERTIAL, {}
    for name in GROUPS:
        size = sizes.get(name, 0)
        places[name] = at if size else -1
        at += size
    return Layout(**places, core=at, clones=clones, n=at + 6 * clones)


def nominal_size(layout: Layout) -> int:
    """Return the size of the nominal state."""
    return layout.n + 1 + layout.clones


@register_jitable
def pose_of(x: np.ndarray, layout: Layout, clone: int) -> tuple[np.ndarray, np.ndarray]:
    """Return p_WB (3) and q_WB (4) of a clone; clone -1 is the present pose."""
    if clone < 0:
        return x[P : P + 3], x[Q : Q + 4]
    at = layout.core + 1 + 7 * clone
    return x[at : at + 3], x[at + 3 : at + 7]


@register_jitable
def put_places(layout: Layout, clone: int, where: np.ndarray) -> None:
    """Write the indices of a pose's (dp, theta) in the error state to the first six numbers of `where`."""
    for k in range(3):
        where[k] = P + k if clone < 0 else layout.core + 6 * clone + k
        where[3 + k] = THETA + k if clone < 0 else layout.core + 6 * clone + 3 + k
