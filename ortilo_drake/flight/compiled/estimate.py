"""The paper's estimator in a compiled flight: solvers of fixes, handler and filter."""

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.flight.compiled.boxes import fix_of_boxes
from ortilo_drake.flight.compiled.constants import CameraConstants, OtherConstants, UwbConstants
from ortilo_drake.flight.compiled.constants_onboard import FilterConstants
from ortilo_drake.flight.compiled.others import OtherMemory, solve_others
from ortilo_drake.flight.compiled.past import belief_about
from ortilo_drake.flight.compiled.robust import RobustMemory, first_robust_memory, heard, open_beliefs, used_of
from ortilo_drake.model.signals import ARRIVED, N_X, N_XBAR, PAYLOAD
from ortilo_drake.onboard.estimator.belief import known_part
from ortilo_drake.onboard.estimator.filter_loops import filter_step
from ortilo_drake.onboard.estimator.imu_rows import with_imu_rows
from ortilo_drake.onboard.estimator.late_measurements import Slot, empty_history, replay_step
from ortilo_drake.onboard.estimator.measurement_handler import NEVER, stack_measurements
from ortilo_drake.onboard.ranging.fault_exclusion import Consistency
from ortilo_drake.onboard.ranging.multilateration import fix_message, tested_fix_message


class Memory(NamedTuple):
    """What the estimator keeps from tick to tick, changed in place.

    Attributes:
        belief: [xhat_{k|k-1}, P_k row by row] (n + n^2).
        history: of the last ticks.
        refused: images that were refused in a row (1).
        clock: what is known of the clock of the ranges, see onboard/ranging/fault_exclusion.py (3).
        robust: what refuses and weighs values keeps.
    """

    belief: np.ndarray
    history: np.ndarray
    refused: np.ndarray
    clock: np.ndarray
    robust: RobustMemory


@register_jitable
def first_memory(estimator: FilterConstants) -> Memory:
    """Return what is kept at first."""
    history, robust = first_history(estimator.slot, estimator.history), first_robust_memory(estimator.robust)
    return Memory(estimator.belief_0.copy(), history, np.zeros(1), np.zeros(3), robust)


@register_jitable
def known_of(estimator: FilterConstants, memory: Memory) -> np.ndarray:
    """Return the belief of [x; i] (240) that was predicted for this tick."""
    n = N_XBAR + len(estimator.model.extra)
    return memory.belief if n == N_XBAR else known_part(memory.belief, n)


@register_jitable
def force_of(estimator: FilterConstants, memory: Memory) -> np.ndarray:
    """Return the force that is believed to act (3) [N], 0 where it is not estimated."""
    force = np.zeros(3)
    if estimator.knows_force:
        force[:] = memory.belief[N_X : N_X + 3]
    return force


@register_jitable
def fix_of_ranges(
    uwb: UwbConstants, consistency: Consistency | None, clock: np.ndarray, message: np.ndarray, about: np.ndarray
) -> np.ndarray:
    """Return the fix of the ranges that landed, zeros if there is none, about a belief of [x; i] (240).

    What is known of their clock is changed.
    """
    if message[ARRIVED] == 0.0:
        return np.zeros(PAYLOAD)
    if consistency is None:
        return fix_message(message, uwb.surveyed, uwb.noise, about[:N_XBAR], uwb.three)
    fix, after = tested_fix_message(message, uwb.surveyed, uwb.noise, about[:N_XBAR], clock, consistency)
    if consistency.clock:
        clock[:] = after
    return fix


@register_jitable
def handed_of(
    estimator: FilterConstants,
    memory: Memory,
    uwb: UwbConstants,
    camera: CameraConstants | None,
    ranges: np.ndarray,
    imu: np.ndarray,
    detections: np.ndarray,
    known: np.ndarray,
    k: int,
    h: float,
    others: tuple[OtherConstants, ...],
    kept: tuple[OtherMemory, ...],
) -> np.ndarray:
    """Return the handler's [y, delta, V2, stamps] of tick k.

    Args:
        estimator: handler and filter.
        memory: what is kept.
        uwb: ranging.
        camera: the camera.
        ranges: the uwb message.
        imu: the imu's message.
        detections: the detections message.
        known: belief of [x; i] (240).
        k: tick.
        h: tick [s].
        others: the other sensors.
        kept: of them.
    """
    slot, n, robust, own = estimator.slot, N_XBAR + len(estimator.model.extra), estimator.robust, memory.robust
    ranges, detections = heard(robust, ranges, own.uwb), heard(robust, detections, own.camera)
    about = belief_about(slot, memory.history, n, ranges, known, h)
    by_ranges = fix_of_ranges(uwb, estimator.consistency, memory.clock, ranges, about)
    about = belief_about(slot, memory.history, n, detections, known, h)
    by_boxes, refused = fix_of_boxes(camera, detections, about[:N_XBAR], about[N_XBAR:], memory.refused[0])
    memory.refused[0] = refused
    messages, layout, history = np.zeros(estimator.size), estimator.handled, memory.history
    seen = np.zeros((layout.first.size - 1 if len(others) > 0 else 0, PAYLOAD))
    solve_others(others, kept, (robust, slot, history, n, known, h, messages, seen))
    handed = handed_over(estimator, messages, by_ranges, heard(robust, imu, own.imu), by_boxes, known, k, h)
    return used_of(robust, own, slot, history, memory.belief, layout, handed, ranges, detections, seen, k, h)


@register_jitable
def take(
    estimator: FilterConstants,
    memory: Memory,
    handed: np.ndarray,
    ranges: np.ndarray,
    imu: np.ndarray,
    detections: np.ndarray,
    k: int,
    h: float,
    u: np.ndarray,
    hover: float,
    r: np.ndarray,
) -> None:
    """Go on to the belief of the next tick; changes what is kept.

    Args:
        estimator: handler and filter.
        memory: what is kept.
        handed: of handed_of.
        ranges: the uwb message.
        imu: the imu's message.
        detections: the detections message.
        k: tick.
        h: tick [s].
        u: control of tick k (4).
        hover: thrust about which the filter is linear [N].
        r: reference of tick k (9).
    """
    less = u.copy()
    less[0] -= hover
    open_beliefs(estimator.robust, memory.robust, estimator.slot, memory.history, memory.belief)
    memory.belief[:] = belief_after(
        estimator.slot, memory.history, memory.belief, estimator, handed, imu, k, h, less, r
    )


@register_jitable
def first_history(slot: Slot | None, ticks: int) -> np.ndarray:
    """Return the filter's history at first: empty, and of no ticks where it keeps none."""
    if slot is None:
        return np.zeros((0, 0))
    return empty_history(ticks, slot)


@register_jitable
def handed_over(
    estimator: FilterConstants,
    messages: np.ndarray,
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
        messages: the vector that the handler takes, with the fixes of the other sensors; changed.
        ranges: fix of ranges.
        imu: the imu's message.
        boxes: fix of boxes.
        known: belief of [x; i] (240).
        k: tick.
        h: tick [s].
    """
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
