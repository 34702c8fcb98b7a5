"""Late measurements processed in the tick of their stamp: the filter runs again from this tick.

A measurement taken at t_j that arrives at t_k, j < k, depends on x_j. To use it exactly, keep the filter's belief and
inputs of each of the last N ticks,

    slot j = [j, xhat_{j|j-1}, P_j, y_j, delta_j, V2_j, u_j, r_j],

write the measurement into slot j and repeat the filter's steps from j to k. The result equals the filter that received
everything in order. Y. Bar-Shalom, "Update with out-of-sequence measurements in tracking: exact solution", IEEE Trans.
Aerospace and Electronic Systems 38 (2002), has the same result without the repetition, one measurement at a time.
A past tick keeps its reference. It also keeps its control, unless the control that acted is known.

With the integrators 'literal' and 'hold' the integral depends on the arrivals, i_{j+1} = i_j + r_j - E_j y_j, so it is
recomputed too. In the tick in which a late position arrives, u jumps by the integral gain times the correction.
'literal' has integrated r_j alone by then; the repetition undoes this.

The control that acted on the rotors is also known only later. with_acted writes it into the ticks in which it acted,
and repeats the steps from there in the same way.
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
from ortilo_drake.onboard.estimator.intermittent_filter import FilterModel, step_in_place, to_work_in


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
    """Return the slot for this measurement and a belief of n states."""
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
    """Write one sensor's value and covariance to the history row of a slot; False if the row already holds them."""
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
    """Return whether the history holds every tick from j to k; a restart leaves a gap."""
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
    """Write the belief of tick k + 1 to `after` by repeating the steps from tick `first`; updates the history between.

    rows and S are work memory, see to_work_in.
    """
    N = history.shape[0]
    for j in range(first, k + 1):
        row = history[j % N]
        belief = history[(j + 1) % N, slot.belief : slot.y] if j < k else after
        put(row[slot.belief : slot.y], belief)
        taken = row[slot.y : slot.delta], row[slot.delta : slot.V2], row[slot.V2 : slot.u]
        step_in_place(rows, S, belief, *taken, row[slot.u : slot.r], row[slot.r : slot.size], model, layout)


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
    """Return the belief [xhat_{k|k-1}, P_k row by row] given the control that acted in past ticks; updates the history.

    Each slot's u becomes the mean, over the slot's tick, of the control that acted. The filter runs again from the
    first tick whose u changes. Ticks before the start of the timeline stay as they are.

    `rows` is the timeline (n, 5), see onboard/commands/timeline.py; `hover` is the control at hover (4); the history
    does not yet hold tick k. Other arguments as in replay_in_place.
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
    """Replace the belief of tick k by the belief of tick k + 1, given all arrivals up to tick k; updates the history.

    Three kinds of measurement are not used: older than the history or than a gap in it, stamped later than t_k, or a
    second one of the same sensor and tick.

    rows and S are work memory, see to_work_in. The history holds the last N ticks (N, slot.size); the
    belief is [xhat_{k|k-1}, P_k row by row] (n + n^2). y (p), arrivals delta (s), covariances V2 (q) and stamps (s) [s]
    are the measurements that arrived in tick k. u is the control less hover (4); only the first three entries of the
    reference r are read.
    """
    N = history.shape[0]
    now = history[k % N]
    fill(now, 0.0)
    now[slot.tick] = k
    put(belief, now[slot.belief : slot.y])  # a slice, because compiled code then copies several numbers at once
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
    """Return the index of the history row of tick j; the oldest row if j is older than all rows, otherwise -1."""
    N = history.shape[0]
    if j >= 0 and history[j % N, 0] == j:
        return j % N
    oldest, row = np.inf, -1
    for i in range(N):
        if 0.0 <= history[i, 0] < oldest:
            oldest, row = history[i, 0], i
    return row if j < oldest and row >= 0 else -1
