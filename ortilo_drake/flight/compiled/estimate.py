"""Handler and filter of a compiled flight."""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.flight.compiled.constants import FilterConstants
from ortilo_drake.model.signals import ARRIVED, N_XBAR
from ortilo_drake.onboard.estimator.filter_loops import filter_step
from ortilo_drake.onboard.estimator.imu_rows import with_imu_rows
from ortilo_drake.onboard.estimator.late_measurements import Slot, empty_history, past_belief, replay_step
from ortilo_drake.onboard.estimator.measurement_handler import NEVER, stack_measurements


@register_jitable
def first_history(slot: Slot | None, ticks: int) -> np.ndarray:
    """Return the filter's history at first: empty, and of no ticks where it keeps none."""
    if slot is None:
        return np.zeros((0, 0))
    return empty_history(ticks, slot)


@register_jitable
def belief_about(
    slot: Slot | None, history: np.ndarray, n: int, message: np.ndarray, known: np.ndarray, h: float
) -> np.ndarray:
    """Return the belief of [x; i] about which a message is solved: the present one where no history is kept."""
    if slot is None:
        return known
    return past_belief(history, slot, n, message, known, h)


@register_jitable
def handed_over(
    estimator: FilterConstants,
    ranges: np.ndarray,
    imu: np.ndarray,
    boxes: np.ndarray,
    known: np.ndarray,
    k: int,
    h: float,
) -> np.ndarray:
    """Return the handler's [y, delta, V2, stamps] of tick k.

    Args:
        estimator: handler and filter.
        ranges: fix of ranges.
        imu: the imu's message.
        boxes: fix of boxes.
        known: belief of [x; i] (240).
        k: tick.
        h: tick [s].
    """
    messages = np.zeros(estimator.size)
    for j, message in enumerate((ranges, imu, boxes)):
        if message[ARRIVED] != 0.0:
            messages[estimator.first[j] : estimator.first[j] + message.size] = message
    judged = k if estimator.drops else NEVER
    xhat, P = known[:N_XBAR], known[N_XBAR:]
    return stack_measurements(messages, xhat, P, judged, h, estimator.incoming, estimator.handled)


@register_jitable
def belief_after(
    slot: Slot | None,
    history: np.ndarray,
    belief: np.ndarray,
    estimator: FilterConstants,
    handed: np.ndarray,
    imu: np.ndarray,
    k: int,
    h: float,
    u: np.ndarray,
    r: np.ndarray,
) -> np.ndarray:
    """Return the belief after tick k; changes the history.

    Args:
        slot: of the estimator.
        history: of the last ticks.
        belief: [xhat_{k|k-1}, P_k row by row].
        estimator: handler and filter.
        handed: what the handler handed over.
        imu: the imu's message.
        k: tick.
        h: tick [s].
        u: control of tick k less hover (4).
        r: reference of tick k (9).
    """
    first, block = estimator.handled.first, estimator.handled.block
    p, s, q = first[-1], first.size - 1, block[-1]
    j, variances = estimator.imu_number, estimator.imu_variances
    y, delta, V2 = with_imu_rows(handed[:p], handed[p : p + s], handed[p + s : p + s + q], imu, j, variances)
    if slot is None:
        return filter_step(belief, y, delta, V2, u, r, estimator.model, estimator.layout)
    stamps = np.empty(delta.size)
    stamps[:s], stamps[s:] = handed[p + s + q :], handed[p + s + q + j]
    return replay_step(history, slot, belief, k, y, delta, V2, stamps, h, u, r, estimator.model, estimator.layout)
