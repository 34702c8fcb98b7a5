"""The layout of the tight filter's state.

The nominal state is a position, a velocity, a unit quaternion and additive numbers; then come the clones, poses of the
last ticks. The error state has three numbers for an attitude, R_WB = R_hat exp([theta]x), theta in B:

    error    dp, dv, theta, db_g, db_a, the rest (additive), then (dp, theta) of each clone        (n)
    nominal  p_WB, v_WB, q_WB, b_g, b_a, the rest, then (p_WB, q_WB) of each clone                 (n + 1 + clones)

In all functions of the filter x is the nominal state and C the covariance of the error state (n, n), which they change,
layout that of both, and taken the rows that are not yet settled (update.py).
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
ADDITIVE: Final = 10  # where the additive part begins in the nominal state; GYRO is its place in the error state


class Layout(NamedTuple):
    """The first index of the states beside the inertial ones in the error state; -1 where there are none."""

    angles: int
    """errors of the imu's roll, pitch and yaw [rad] (3)."""
    clock: int
    """how much older than its stamp a uwb, a camera message is [s] (2)."""
    range_bias: int
    """constant error of each anchor's ranges [m]."""
    range_slow: int
    """slow error of each anchor's ranges [m]."""
    range_offset: int
    """error that all ranges have in common [m] (1): 0 until the watch opens it, see watch.py."""
    survey: int
    """from where each landmark was surveyed to where it is [m] (3 each)."""
    pixel_slow: int
    """slow error of each landmark's box centre, u and v, in units of its standard deviation (2 each)."""
    core: int
    """numbers without the clones."""
    clones: int
    """poses of past ticks that are kept."""
    n: int
    """all numbers of the error state."""


GROUPS: Final = Layout._fields[:-3]


def make_layout(sizes: dict[str, int], clones: int) -> Layout:
    """Return the layout of the groups with these sizes, 0 leaving one out, in the order of Layout's fields."""
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
    """Return p_WB (3) and q_WB (4) of a clone, or of the present at clone -1."""
    if clone < 0:
        return x[P : P + 3], x[Q : Q + 4]
    at = layout.core + 1 + 7 * clone
    return x[at : at + 3], x[at + 3 : at + 7]


@register_jitable
def put_places(layout: Layout, clone: int, where: np.ndarray) -> None:
    """Write where (dp, theta) of that pose stand in the error state to the first six of an array."""
    for k in range(3):
        where[k] = P + k if clone < 0 else layout.core + 6 * clone + k
        where[3 + k] = THETA + k if clone < 0 else layout.core + 6 * clone + 3 + k
