"""The paper's estimator in a compiled flight: solvers of fixes, handler and filter."""

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.flight.compiled.boxes import fix_of_boxes
from ortilo_drake.flight.compiled.constants import CameraConstants, OtherConstants, UwbConstants
from ortilo_drake.flight.compiled.constants_onboard import FilterConstants
from ortilo_drake.flight.compiled.kept import Sensed, SensorMemory
from ortilo_drake.flight.compiled.others import solve_others
from ortilo_drake.flight.compiled.past import belief_about
from ortilo_drake.flight.compiled.robust import RobustMemory, first_robust_memory, hear, open_beliefs, used_of
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.signals import ARRIVED, N_I, N_U, N_X, N_XBAR, PAYLOAD
from ortilo_drake.model.triples import Triple, triple
from ortilo_drake.onboard.estimator.belief import put_known_part
from ortilo_drake.onboard.estimator.filter_loops import step_in_place, to_work_in
from ortilo_drake.onboard.estimator.imu_rows import put_imu_rows
from ortilo_drake.onboard.estimator.late_measurements import Slot, empty_history, replay_step
from ortilo_drake.onboard.estimator.measurement_handler import NEVER, put_measurements
from ortilo_drake.onboard.ranging.fault_exclusion import Consistency
from ortilo_drake.onboard.ranging.multilateration import fix_message, tested_fix_message


class Memory(NamedTuple):
    """What the estimator keeps from tick to tick, changed in place.

    Attributes:
        belief: [xhat_{k|k-1}, P_k row by row] (n + n^2).
        known: the belief of [x; i] alone (240), where the filter has other states besides.
        messages: of a tick, and fixes, as FilterConstants.incoming has them.
        handed: the handler's [y, delta, V2, stamps].
        rows: [y, delta, V2] with the rows made of the imu's message.
        less: control less hover (4).
        seen: arrived and stamp of each sensor that is judged by the belief of its stamp (s, 2).
        work: see filter_loops.to_work_in.
        S: likewise.
        history: of the last ticks.
        refused: images that were refused in a row (1).
        clock: what is known of the clock of the ranges, see onboard/ranging/fault_exclusion.py (3).
        robust: what refuses and weighs values keeps.
    """

    belief: np.ndarray
    known: np.ndarray
    messages: np.ndarray
    handed: np.ndarray
    rows: np.ndarray
    less: np.ndarray
    seen: np.ndarray
    work: np.ndarray
    S: np.ndarray
    history: np.ndarray
    refused: np.ndarray
    clock: np.ndarray
    robust: RobustMemory


@register_jitable
def first_memory(estimator: FilterConstants) -> Memory:
    """Return what is kept at first."""
    first, all_first, n = estimator.handled.first, estimator.layout.first, N_I + estimator.model.Phi.shape[0]
    s = first.size - 1
    handed = np.zeros(first[-1] + 2 * s + estimator.handled.block[-1])
    rows = np.zeros(all_first[-1] + all_first.size - 1 + estimator.layout.block[-1])
    work, S = to_work_in(n, all_first[-1])
    history, robust = first_history(estimator.slot, estimator.history), first_robust_memory(estimator.robust)
    return Memory(
        estimator.belief_0.copy(),
        np.zeros(N_XBAR + N_XBAR * N_XBAR),
        np.zeros(estimator.size),
        handed,
        rows,
        np.zeros(N_U),
        np.zeros((s, PAYLOAD)),
        work,
        S,
        history,
        np.zeros(1),
        np.zeros(3),
        robust,
    )


@register_jitable(forceinline=True, error_model="numpy")
def known_of(estimator: FilterConstants, memory: Memory) -> np.ndarray:
    """Return the belief of [x; i] (240) that was predicted for this tick."""
    n = N_I + estimator.model.Phi.shape[0]
    if n == N_XBAR:
        return memory.belief
    put_known_part(memory.known, memory.belief, n)
    return memory.known


@register_jitable(forceinline=True, error_model="numpy")
def force_of(estimator: FilterConstants, memory: Memory) -> Triple:
    """Return the force that is believed to act [N], 0 where it is not estimated."""
    return triple(memory.belief[N_X:]) if estimator.knows_force else (0.0, 0.0, 0.0)


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
    sensed: Sensed,
    known: np.ndarray,
    k: int,
    h: float,
    others: tuple[OtherConstants, ...],
    kept: tuple[SensorMemory, ...],
) -> np.ndarray:
    """Return the handler's [y, delta, V2, stamps] of tick k.

    Args:
        estimator: handler and filter.
        memory: what is kept.
        uwb: ranging.
        camera: the camera.
        sensed: the messages of uwb, imu and camera.
        known: belief of [x; i] (240).
        k: tick.
        h: tick [s].
        others: the other sensors.
        kept: of them.
    """
    slot, n, robust, own = estimator.slot, N_I + estimator.model.Phi.shape[0], estimator.robust, memory.robust
    hear(robust, sensed.uwb.message, sensed.uwb.said)
    hear(robust, sensed.imu.message, sensed.imu.said)
    hear(robust, sensed.camera.message, sensed.camera.said)
    ranges, detections = sensed.uwb.message, sensed.camera.message
    about = belief_about(slot, memory.history, n, ranges, known, h)
    messages = memory.messages
    fill(messages, 0.0)
    if ranges[ARRIVED] != 0.0:
        place(fix_of_ranges(uwb, estimator.consistency, memory.clock, ranges, about), estimator.first[0], messages)
    place(sensed.imu.message, estimator.first[1], messages)
    if detections[ARRIVED] != 0.0:
        about = belief_about(slot, memory.history, n, detections, known, h)
        by_boxes, refused = fix_of_boxes(camera, detections, about[:N_XBAR], about[N_XBAR:], memory.refused[0])
        memory.refused[0] = refused
        place(by_boxes, estimator.first[2], messages)
    memory.seen[:, ARRIVED] = 0.0
    solve_others(others, kept, (robust, slot, memory.history, n, known, h, messages, memory.seen))
    judged = k if estimator.drops else NEVER
    xhat, P = known[:N_XBAR], known[N_XBAR:]
    handed, layout, history = memory.handed, estimator.handled, memory.history
    fill(handed, 0.0)
    put_measurements(handed, messages, xhat, P, judged, h, estimator.incoming, layout)
    return used_of(robust, own, slot, history, memory.belief, layout, handed, ranges, detections, memory.seen, k, h)


@register_jitable(forceinline=True, error_model="numpy")
def take(
    estimator: FilterConstants,
    memory: Memory,
    handed: np.ndarray,
    sensed: Sensed,
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
        sensed: the messages of uwb, imu and camera.
        k: tick.
        h: tick [s].
        u: control of tick k (4).
        hover: thrust about which the filter is linear [N].
        r: reference of tick k (9).
    """
    put(u, memory.less)
    memory.less[0] -= hover
    open_beliefs(estimator.robust, memory.robust, estimator.slot, memory.history, memory.belief)
    go_on_with(estimator.slot, memory, estimator, handed, sensed.imu.message, k, h, r)


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
    memory: Memory,
    estimator: FilterConstants,
    handed: np.ndarray,
    imu: np.ndarray,
    k: int,
    h: float,
    r: np.ndarray,
) -> None:
    """Change the belief to that after tick k, and the history.

    Args:
        slot: of the estimator.
        memory: what is kept, with the control less hover.
        estimator: handler and filter.
        handed: what the handler handed over.
        imu: the imu's message.
        k: tick.
        h: tick [s].
        r: reference of tick k (9).
    """
    first, block, j = estimator.handled.first, estimator.handled.block, estimator.imu_number
    p, s, q = first[-1], first.size - 1, block[-1]
    y, delta, V2, stamped = handed[:p], handed[p : p + s], handed[p + s : p + s + q], handed[p + s + q :]
    if estimator.imu_variances.size > 0:
        p, s, rows = estimator.layout.first[-1], estimator.layout.first.size - 1, memory.rows
        all_y, all_delta, all_V2 = rows[:p], rows[p : p + s], rows[p + s :]
        put_imu_rows(all_y, all_delta, all_V2, y, delta, V2, imu, j, estimator.imu_variances)
        y, delta, V2 = all_y, all_delta, all_V2
    belief, u, model, layout = memory.belief, memory.less, estimator.model, estimator.layout
    if slot is None:
        step_in_place(memory.work, memory.S, belief, y, delta, V2, u, r, model, layout)
        return
    stamps = np.empty(delta.size)
    fill(stamps, stamped[j])
    put(stamped, stamps)
    put(replay_step(memory.history, slot, belief, k, y, delta, V2, stamps, h, u, r, model, layout), belief)
