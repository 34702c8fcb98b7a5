"""The robust form of the paper's estimator in a compiled flight: see onboard/estimator/robust."""

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.measurement import Layout
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.signals import ARRIVED, PAYLOAD, STAMP
from ortilo_drake.onboard.estimator.late_measurements import Slot, row_of_past
from ortilo_drake.onboard.estimator.robust.stuck_gate import repeats
from ortilo_drake.onboard.estimator.robust.weights import Weighing, judge, weighed


class RobustConstants(NamedTuple):
    """What refuses and weighs values.

    Attributes:
        weighing: what decides.
        opening: variances added to P by what of it is opened (3, n).
        stuck: so many messages in a row that say the same say that a sensor is stuck; inf for never.
        late: numbers of the sensors of ranges and boxes, judged by the belief of their stamp; -1 of none (2).
        state: of each sensor at first (s, 3).
        seen: when each state was seen, at first (12).
    """

    weighing: Weighing
    opening: np.ndarray
    stuck: float
    late: tuple[int, int]
    state: np.ndarray
    seen: np.ndarray


class RobustMemory(NamedTuple):
    """What it keeps from tick to tick, changed in place; nothing where nothing is refused or weighed.

    Attributes:
        state: of each sensor, see weights.py (s, 3).
        seen: when each state was seen (12).
        mean: average innovation (3).
        opening: what is added to the diagonal of P in this tick (n).
    """

    state: np.ndarray
    seen: np.ndarray
    mean: np.ndarray
    opening: np.ndarray


@register_jitable
def first_robust_memory(robust: RobustConstants | None) -> RobustMemory:
    """Return what is kept at first."""
    if robust is None:
        none = np.zeros(0)
        return RobustMemory(np.zeros((0, 3)), none, none, none)
    return RobustMemory(robust.state.copy(), robust.seen.copy(), np.zeros(3), np.zeros(robust.opening.shape[1]))


@register_jitable(forceinline=True, error_model="numpy")
def hear(robust: RobustConstants | None, message: np.ndarray, last: np.ndarray) -> None:
    """Change a message that landed to zeros where its sensor is stuck, and what it said last."""
    if robust is None or message[ARRIVED] == 0.0:
        return
    said = message[PAYLOAD:]
    last[0] = repeats(said, last)
    put(said, last, 1)
    if last[0] >= robust.stuck:
        fill(message, 0.0)


@register_jitable
def _belief_of(slot: Slot | None, history: np.ndarray, message: np.ndarray, belief: np.ndarray, h: float) -> np.ndarray:
    """Return the belief of the tick of a message's stamp, the present one where that is not kept."""
    if slot is None or message[ARRIVED] == 0.0:
        return belief
    row = row_of_past(history, tick_of(message[STAMP], h))
    return history[row, slot.belief : slot.y] if row >= 0 else belief


@register_jitable(forceinline=True, error_model="numpy")
def used_of(
    robust: RobustConstants | None,
    memory: RobustMemory,
    slot: Slot | None,
    history: np.ndarray,
    belief: np.ndarray,
    layout: Layout,
    handed: np.ndarray,
    ranges: np.ndarray,
    detections: np.ndarray,
    seen: np.ndarray,
    k: int,
    h: float,
) -> np.ndarray:
    """Return [y, delta, V2, stamps] of what is used of what the handler handed over, weighed; changes what is kept.

    Args:
        robust: what decides.
        memory: what is kept.
        slot: of the history.
        history: of the filter.
        belief: [xhat, P row by row] of this tick (n + n^2).
        layout: of y, delta and V2.
        handed: the handler's.
        ranges: the uwb message.
        detections: the detections message.
        seen: arrived and stamp of each of the other sensors' messages that are judged so (s, 2), or none.
        k: tick.
        h: tick [s].
    """
    if robust is None:
        return handed
    p, s, q = layout.first[-1], layout.first.size - 1, layout.block[-1]
    y, delta, V2 = handed[:p], handed[p : p + s], handed[p + s : p + s + q]
    beliefs = np.empty((s, belief.size))
    for j in range(s):
        beliefs[j] = belief
    for j, message in ((robust.late[0], ranges), (robust.late[1], detections)):
        if j >= 0:
            beliefs[j] = _belief_of(slot, history, message, belief, h)
    for j in range(seen.shape[0]):
        if seen[j, ARRIVED] != 0.0:
            beliefs[j] = _belief_of(slot, history, seen[j], belief, h)
    weighing = robust.weighing
    factors, state, last_seen, mean, opens = judge(
        y, delta, V2, beliefs, memory.state, memory.seen, memory.mean, k * h, weighing
    )
    memory.state[:], memory.seen[:], memory.mean[:] = state, last_seen, mean
    memory.opening[:] = robust.opening[opens]
    used = handed.copy()
    used[: p + s + q] = weighed(y, delta, V2, factors, weighing.first, weighing.block)
    return used


@register_jitable(forceinline=True, error_model="numpy")
def open_beliefs(
    robust: RobustConstants | None, memory: RobustMemory, slot: Slot | None, history: np.ndarray, belief: np.ndarray
) -> None:
    """Add what is opened to the diagonal of P, of the belief and of all ticks that are kept; changes both."""
    if robust is None:
        return
    n = memory.opening.size
    for i in range(n):
        if memory.opening[i] != 0.0:
            at = n + (n + 1) * i
            belief[at] += memory.opening[i]
            if slot is not None:
                for row in range(history.shape[0]):
                    history[row, slot.belief + at] += memory.opening[i]
