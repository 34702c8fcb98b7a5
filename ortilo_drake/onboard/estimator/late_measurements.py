"""Late measurements put where they belong: the filter run again from the tick of a stamp.

A measurement taken at t_j that arrives at t_k, j < k, says something of x_j. The exact answer goes back: keep, for each
of the last N ticks, what the filter believed and what it was given,

    slot j = [j, xhat_{j|j-1}, P_j, (y_j, Delta_j, V2_j), u_j, r_j],

put the measurement into slot j's own rows and repeat the filter's step from j to k. The result is the filter that had
received everything in order; Y. Bar-Shalom, "Update with out-of-sequence measurements in tracking: exact solution",
IEEE Trans. Aerospace and Electronic Systems 38 (2002), gets there without the repetition, one measurement at a time.
Control and reference of a tick that is past are what they were.

With the integrators 'literal' and 'hold' the integral depends on what arrived, i_{j+1} = i_j + r_j - E_j y_j, so it
is done again as well: it becomes what it would have been, and in the tick in which a late position arrives u jumps by
the integral gain times the correction. 'literal' has by then integrated r_j itself, which the repetition takes back.
"""

import numpy as np
from numba import njit

from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.signals import MEASUREMENT_SIZE, N_I, N_U, N_XBAR
from ortilo_drake.onboard.estimator.intermittent_filter import filter_step

# A slot of the history, in order; an empty one has tick -1. Slot j is row j mod N.
TICK = 0
XHAT = 1
COVARIANCE = XHAT + N_XBAR
MEASUREMENT = COVARIANCE + N_XBAR * N_XBAR
DELTA = MEASUREMENT + 9
V2_BLOCKS = DELTA + 3
CONTROL = MEASUREMENT + MEASUREMENT_SIZE
REFERENCE = CONTROL + N_U
SLOT_SIZE = REFERENCE + N_I


def history_ticks(horizon: float, h: float) -> int:
    """Return N, the ticks to keep: the present one and all whose age does not exceed the horizon [s]."""
    return int(horizon / h + 1e-6) + 1  # an age that is the horizon up to rounding is within it


def empty_history(ticks: int) -> np.ndarray:
    """Return a history in which every slot is empty (N, SLOT_SIZE)."""
    history = np.zeros((ticks, SLOT_SIZE))
    history[:, TICK] = -1.0
    return history


@njit(cache=True)
def put_in(slot: np.ndarray, measurement: np.ndarray, sensor: int) -> bool:
    """Put one sensor's rows of a measurement (39) into a slot; False, and nothing done, if it has them already."""
    if slot[DELTA + sensor] != 0.0:
        return False
    slot[DELTA + sensor] = 1.0
    for i in range(3):
        slot[MEASUREMENT + 3 * sensor + i] = measurement[3 * sensor + i]
    for i in range(9):
        slot[V2_BLOCKS + 9 * sensor + i] = measurement[12 + 9 * sensor + i]
    return True


@njit(cache=True)
def reaches_back(history: np.ndarray, j: int, k: int) -> bool:
    """Return whether the history holds every tick from j to k; after a restart it has a gap."""
    if not 0 <= j <= k or k - j >= history.shape[0]:
        return False
    ticks = np.arange(j, k + 1)
    return bool(np.all(history[ticks % history.shape[0], TICK] == ticks))


@njit(cache=True)
def replay_step(
    history: np.ndarray,
    xhat: np.ndarray,
    P_flat: np.ndarray,
    k: int,
    measurement: np.ndarray,
    stamps: np.ndarray,
    h: float,
    u: np.ndarray,
    r: np.ndarray,
    Phi: np.ndarray,
    Gamma: np.ndarray,
    W: np.ndarray,
    integrator: int,
) -> np.ndarray:
    """Return [xhat_{k+1|k}, P_{k+1} row by row] (240) from all that has arrived up to tick k; changes the history.

    Not used are measurements older than the history or than a gap in it, ones stamped later than t_k, and a second one
    of the same sensor and tick.

    Args:
        history: the last ticks (N, SLOT_SIZE).
        xhat: xhat_{k|k-1} (15).
        P_flat: P_k row by row (225).
        k: tick.
        measurement: what arrived in tick k (39), see model/signals.py.
        stamps: when each sensor's measurement was true [s] (3); read where it arrived.
        h: tick [s].
        u: control of tick k less hover (4).
        r: reference of tick k, of which the first three entries are read.
        Phi: discrete hover dynamics (12, 12).
        Gamma: discrete control input (12, 4).
        W: process noise covariance (12, 12).
        integrator: INTEGRATOR_ESTIMATE, INTEGRATOR_LITERAL or INTEGRATOR_HOLD.
    """
    N = history.shape[0]
    now = history[k % N]
    now[:] = 0.0
    now[TICK] = k
    now[XHAT:COVARIANCE] = xhat
    now[COVARIANCE:MEASUREMENT] = P_flat
    now[CONTROL:REFERENCE] = u
    now[REFERENCE:SLOT_SIZE] = r[:3]
    first = k
    for sensor in range(3):
        j = tick_of(stamps[sensor], h)
        there = measurement[9 + sensor] != 0.0
        if there and reaches_back(history, j, k) and put_in(history[j % N], measurement, sensor):
            first = min(first, j)
    out = np.empty(N_XBAR + N_XBAR * N_XBAR)
    for j in range(first, k + 1):
        slot = history[j % N]
        out = filter_step(
            slot[XHAT:COVARIANCE],
            slot[COVARIANCE:MEASUREMENT],
            slot[MEASUREMENT:CONTROL],
            slot[CONTROL:REFERENCE],
            slot[REFERENCE:SLOT_SIZE],
            Phi,
            Gamma,
            W,
            integrator,
        )
        if j < k:
            history[(j + 1) % N, XHAT:MEASUREMENT] = out
    return out


@njit(cache=True)
def row_of_past(history: np.ndarray, j: int) -> int:
    """Return the history's row of tick j, the oldest row if j is older, -1 if j is newer than all of it."""
    N = history.shape[0]
    if j >= 0 and history[j % N, TICK] == j:
        return j % N
    oldest, row = np.inf, -1
    for i in range(N):
        if 0.0 <= history[i, TICK] < oldest:
            oldest, row = history[i, TICK], i
    return row if j < oldest and row >= 0 else -1
