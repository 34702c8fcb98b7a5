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
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.signals import ARRIVED, N_I, N_X, N_XBAR, PAYLOAD
from ortilo_drake.onboard.estimator.belief import known_part
from ortilo_drake.onboard.estimator.filter_loops import step_in_place
from ortilo_drake.onboard.estimator.imu_rows import with_imu_rows
from ortilo_drake.onboard.estimator.late_measurements import Slot, empty_history, replay_step
from ortilo_drake.onboard.estimator.measurement_handler import NEVER, stack_measurements
from ortilo_drake.onboard.ranging.fault_exclusion import Consistency
from ortilo_drake.onboard.ranging.multilateration import fix_message, tested_fix_message


class Memory(NamedTuple):
    """What the estimator keeps from tick to tick, changed in place.

    Attributes:
        belief: [xhat_{k|k-1}, P_k row by row] (n + n^2).
        messages: of a tick, and fixes, as FilterConstants.incoming has them.
        history: of the last ticks.
        refused: images that were refused in a row (1).
        clock: what is known of the clock of the ranges, see onboard/ranging/fault_exclusion.py (3).
        robust: what refuses and weighs values keeps.
    """

    belief: np.ndarray
    messages: np.ndarray
    history: np.ndarray
    refused: np.ndarray
    clock: np.ndarray
    robust: RobustMemory


@register_jitable
def first_memory(estimator: FilterConstants) -> Memory:
    """Return what is kept at first."""
    history, robust = first_history(estimator.slot, estimator.history), first_robust_memory(estimator.robust)
    return Memory(estimator.belief_0.copy(), np.zeros(estimator.size), history, np.zeros(1), np.zeros(3), robust)


@register_jitable(forceinline=True, error_model="numpy")
def known_of(estimator: FilterConstants, memory: Memory) -> np.ndarray:
    """Return the belief of [x; i] (240) that was predicted for this tick."""
    n = N_I + estimator.model.Phi.shape[0]
    return memory.belief if n == N_XBAR else known_part(memory.belief, n)


@register_jitable(forceinline=True, error_model="numpy")
def force_of(estimator: FilterConstants, memory: Memory) -> np.ndarray:
    """Return the force that is believed to act (3) [N], 0 where it is not estimated."""
    force = np.zeros(3)
    if estimator.knows_force:
        put(memory.belief[N_X : N_X + 3], force)
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
        put(after, clock)
    return fix


@register_jitable(forceinline=True, error_model="numpy")
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
    slot, n, robust, own = estimator.slot, N_I + estimator.model.Phi.shape[0], estimator.robust, memory.robust
    ranges, detections = heard(robust, ranges, own.uwb), heard(robust, detections, own.camera)
    about = belief_about(slot, memory.history, n, ranges, known, h)
    messages = memory.messages
    fill(messages, 0.0)
    if ranges[ARRIVED] != 0.0:
        place(fix_of_ranges(uwb, estimator.consistency, memory.clock, ranges, about), estimator.first[0], messages)
    place(heard(robust, imu, own.imu), estimator.first[1], messages)
    if detections[ARRIVED] != 0.0:
        about = belief_about(slot, memory.history, n, detections, known, h)
        by_boxes, refused = fix_of_boxes(camera, detections, about[:N_XBAR], about[N_XBAR:], memory.refused[0])
        memory.refused[0] = refused
        place(by_boxes, estimator.first[2], messages)
    seen = np.zeros((estimator.handled.first.size - 1 if len(others) > 0 else 0, PAYLOAD))
    solve_others(others, kept, (robust, slot, memory.history, n, known, h, messages, seen))
    judged = k if estimator.drops else NEVER
    xhat, P = known[:N_XBAR], known[N_XBAR:]
    handed = stack_measurements(messages, xhat, P, judged, h, estimator.incoming, estimator.handled)
    layout, history = estimator.handled, memory.history
    return used_of(robust, own, slot, history, memory.belief, layout, handed, ranges, detections, seen, k, h)


@register_jitable(forceinline=True, error_model="numpy")
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
    go_on_with(estimator.slot, memory.history, memory.belief, estimator, handed, imu, k, h, less, r)


@register_jitable
def first_history(slot: Slot | None, ticks: int) -> np.ndarray:
    """Return the filter's history at first: empty, and of no ticks where it keeps none."""
    if slot is None:
        return np.zeros((0, 0))
    return empty_history(ticks, slot)


@register_jitable(forceinline=True, error_model="numpy")
def place(message: np.ndarray, at: int, messages: np.ndarray) -> None:
    """Put a message or fix that arrived into the vector of all, where it begins at `at`."""
    if message[ARRIVED] != 0.0:
        put(message, messages, at)


@register_jitable(forceinline=True, error_model="numpy")
def go_on_with(
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
) -> None:
    """Change the belief to that after tick k, and the history.

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
        step_in_place(belief, y, delta, V2, u, r, estimator.model, estimator.layout)
        return
    stamps = np.empty(delta.size)
    fill(stamps, handed[p + s + q + j])
    put(handed[p + s + q :], stamps)
    after = replay_step(history, slot, belief, k, y, delta, V2, stamps, h, u, r, estimator.model, estimator.layout)
    put(after, belief)
