"""Late measurements put where they belong: the filter run again from the tick of a stamp.

A measurement taken at t_j that arrives at t_k, j < k, says something of x_j. The exact answer goes back: keep, for each
of the last N ticks, what the filter believed and what it was given,

    slot j = [j, xhat_{j|j-1}, P_j, y_j, delta_j, V2_j, u_j, r_j],

put the measurement into slot j's own rows and repeat the filter's step from j to k. The result is the filter that had
received everything in order; Y. Bar-Shalom, "Update with out-of-sequence measurements in tracking: exact solution",
IEEE Trans. Aerospace and Electronic Systems 38 (2002), gets there without the repetition, one measurement at a time.
The reference of a tick that is past is what it was, and so is the control unless it is known what acted.

With the integrators 'literal' and 'hold' the integral depends on what arrived, i_{j+1} = i_j + r_j - E_j y_j, so it
is done again as well: it becomes what it would have been, and in the tick in which a late position arrives u jumps by
the integral gain times the correction. 'literal' has by then integrated r_j itself, which the repetition takes back.

What acted on the rotors is known only later too. with_acted puts it into the ticks in which it acted, and repeats the
steps from there in the same way.
"""

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.measurement import Layout, Measurement
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.signals import N_I, N_U, N_XBAR
from ortilo_drake.onboard.commands.timeline import mean_control
from ortilo_drake.onboard.estimator.filter_loops import step_in_place, to_work_in
from ortilo_drake.onboard.estimator.intermittent_filter import FilterModel


class Slot(NamedTuple):
    """The first index of each part of a slot of the history; an empty slot has tick -1. Slot j is row j mod N."""

    tick: int
    belief: int
    y: int
    delta: int
    V2: int
    u: int
    r: int
    size: int


def slot_of(measurement: Measurement, n: int = N_XBAR) -> Slot:
    """Return the slot that holds such a measurement, and the belief of n states."""
    sizes = (1, n + n * n, *measurement.sizes.values(), N_U, N_I)
    return Slot(*(int(n) for n in np.cumsum((0, *sizes))))


@register_jitable
def empty_history(ticks: int, slot: Slot) -> np.ndarray:
    """Return a history in which every slot is empty (N, slot.size)."""
    history = np.zeros((ticks, slot.size))
    history[:, slot.tick] = -1.0
    return history


@cached_njit
def put_in(
    row: np.ndarray, slot: Slot, y: np.ndarray, V2: np.ndarray, sensor: int, first: np.ndarray, block: np.ndarray
) -> bool:
    """Put one sensor's value and covariance into a slot's row; False, and nothing done, if it has them already."""
    if row[slot.delta + sensor] != 0.0:
        return False
    row[slot.delta + sensor] = 1.0
    for i in range(first[sensor], first[sensor + 1]):
        row[slot.y + i] = y[i]
    for i in range(block[sensor], block[sensor + 1]):
        row[slot.V2 + i] = V2[i]
    return True


@cached_njit
def reaches_back(history: np.ndarray, j: int, k: int) -> bool:
    """Return whether the history holds every tick from j to k; after a restart it has a gap."""
    if not 0 <= j <= k or k - j >= history.shape[0]:
        return False
    there = True
    for i in range(j, k + 1):
        there = there and history[i % history.shape[0], 0] == i
    return there


@register_jitable(_nrt=False)
def run_again(
    rows: np.ndarray,
    S: np.ndarray,
    history: np.ndarray,
    slot: Slot,
    first: int,
    k: int,
    after: np.ndarray,
    model: FilterModel,
    layout: Layout,
) -> None:
    """Write the belief after tick k from that of tick first; changes the beliefs of the history in between.

    It works in rows and S, see filter_loops.to_work_in.
    """
    N = history.shape[0]
    for j in range(first, k + 1):
        row = history[j % N]
        belief = history[(j + 1) % N, slot.belief : slot.y] if j < k else after
        put(row[slot.belief : slot.y], belief)
        step_in_place(
            rows,
            S,
            belief,
            row[slot.y : slot.delta],
            row[slot.delta : slot.V2],
            row[slot.V2 : slot.u],
            row[slot.u : slot.r],
            row[slot.r : slot.size],
            model,
            layout,
        )


@cached_njit
def with_acted(
    history: np.ndarray,
    slot: Slot,
    belief: np.ndarray,
    k: int,
    rows: np.ndarray,
    hover: np.ndarray,
    h: float,
    model: FilterModel,
    layout: Layout,
) -> np.ndarray:
    """Return [xhat_{k|k-1}, P_k row by row] as if it had been known what acted in the past ticks; changes the history.

    In the place of a slot's u comes the mean over its tick of what acted. From the first tick in which that is another
    than was assumed, the filter runs again. A tick that the timeline does not reach back to stays as it is.

    Arguments as replay_in_place, with the timeline's rows (n, 5), see onboard/commands/timeline.py, and the control at
    hover (4); the history is without tick k.
    """
    N, first, j = history.shape[0], k, k - 1
    while j > k - N and reaches_back(history, j, k - 1) and j * h >= rows[0, 0]:
        u = mean_control(rows, j * h, (j + 1) * h) - hover
        row = history[j % N, slot.u : slot.r]
        if np.any(u != row):
            put(u, row)
            first = j
        j -= 1
    after = belief.copy()
    if first < k:
        work = to_work_in(model.Phi.shape[0] + N_I, layout.first[-1])
        run_again(*work, history, slot, first, k - 1, after, model, layout)
    return after


@cached_njit(_nrt=False)
def replay_in_place(
    rows: np.ndarray,
    S: np.ndarray,
    history: np.ndarray,
    slot: Slot,
    belief: np.ndarray,
    k: int,
    y: np.ndarray,
    delta: np.ndarray,
    V2: np.ndarray,
    stamps: np.ndarray,
    h: float,
    u: np.ndarray,
    r: np.ndarray,
    model: FilterModel,
    layout: Layout,
) -> None:
    """Change a belief of tick k to that of k + 1, from all that has arrived up to tick k; changes the history.

    Not used are measurements older than the history or than a gap in it, ones stamped later than t_k, and a second one
    of the same sensor and tick.

    It works in rows and S, see filter_loops.to_work_in. The history has the last ticks (N, slot.size); the belief is
    [xhat_{k|k-1}, P_k row by row] (n + n^2). In tick k came y (p) of the sensors delta (s) with covariances V2 (q),
    each true at its stamp [s] (s). u is the control less hover (4); of the reference r the first three entries are
    read.
    """
    N = history.shape[0]
    now = history[k % N]
    fill(now, 0.0)
    now[slot.tick] = k
    put(belief, now[slot.belief : slot.y])  # a part: compiled code copies several numbers at once
    put(u, now, slot.u)
    put(r[:3], now, slot.r)
    first = k
    for sensor in range(delta.size):
        j = tick_of(stamps[sensor], h)
        there = delta[sensor] != 0.0 and reaches_back(history, j, k)
        if there and put_in(history[j % N], slot, y, V2, sensor, layout[3], layout[4]):
            first = min(first, j)
    run_again(rows, S, history, slot, first, k, belief, model, layout)


@cached_njit
def row_of_past(history: np.ndarray, j: int) -> int:
    """Return the history's row of tick j, the oldest row if j is older, -1 if j is newer than all of it."""
    N = history.shape[0]
    if j >= 0 and history[j % N, 0] == j:
        return j % N
    oldest, row = np.inf, -1
    for i in range(N):
        if 0.0 <= history[i, 0] < oldest:
            oldest, row = history[i, 0], i
    return row if j < oldest and row >= 0 else -1
