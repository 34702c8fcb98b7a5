"""The filter that learns from each fix how large the lasting part of the fix's error is.

    y_uwb = p + diag(rho) s + v,   rho_i = sigma_i / estimator.biases.uwb_sd_i

with sigma_i the sd of the lasting error that a fix gives for its row i (ranging/lasting_error.py). The state s is still
the Gauss-Markov process of that setting. Its coefficient rho_i follows the geometry and what the filter has learned of
the survey; it is 0 where no error lasts. A fix at another place keeps the share r_i of s_i,

    s_i <- r_i s_i + w_i,   w_i of variance (1 - r_i^2) uwb_sd_i^2.

A camera fix has a second lasting error, of the boxes themselves and independent of the survey: a Gauss-Markov process
of estimator.biases.camera_sd and camera_time. One state s stands for both,

    rho = sqrt(sigma^2 + c^2) / c,   r <- (r sigma^2 + exp(-h / camera_time) c^2) / (sigma^2 + c^2),   c = camera_sd

with r applied in every tick. The coefficients are computed at the estimated position of the vehicle: at the fix itself
they would be correlated with the fix's noise. A camera fix's coefficients are computed where its boxes were seen from,
which is known to centimetres. A run again from a past tick uses the present coefficients.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.loop.element import Box
from ortilo_drake.model.measurement import Layout, Measurement, Row
from ortilo_drake.model.placing import put
from ortilo_drake.model.scalars import values_of
from ortilo_drake.model.signals import N_I
from ortilo_drake.onboard.estimator.filter_element import filter_step
from ortilo_drake.onboard.estimator.intermittent_filter import FilterModel
from ortilo_drake.onboard.estimator.late_measurements import Slot
from ortilo_drake.onboard.estimator.replay_element import acted_filter_step, kept_in, replay_filter_step
from ortilo_drake.onboard.ranging.lasting_error import N_KEPT, N_LASTING


class LearnedCoefficients(NamedTuple):
    """The m coefficients in the measurement's layout that fixes set."""

    row: np.ndarray
    """row of y (m)."""
    column: np.ndarray
    """column in the layout's weights (m)."""
    at: np.ndarray
    """index of the lasting sd among the numbers of the fixes; the share that is kept stands N_KEPT later (m)."""
    state: np.ndarray
    """index of the state that the coefficient multiplies (m)."""
    sd: np.ndarray
    """sd of that state in the filter [m] (m)."""
    own: np.ndarray
    """sd of the second lasting error, which the fix does not give [m]; 0 if there is none (m)."""
    keeps: np.ndarray
    """share of the second lasting error that is left after a tick [1] (m)."""


class Sort(NamedTuple):
    """One kind of fix that gives its lasting error."""

    rows: tuple[Row, ...]
    """rows of the position."""
    sd: tuple[float, float, float]
    """sd of the state per axis, a setting of estimator.biases [m] (3)."""
    keeps: float | None = None
    """share that is left after a tick of a second lasting error of the same sd; None if there is no second one."""


def learned_coefficients_of(
    measurement: Measurement, ranges: Sort | None, boxes: Sort | None = None
) -> LearnedCoefficients:
    """Return the coefficients that fixes set in the filter's measurement; None stands for fixes that set none."""
    found = list[tuple[float, ...]]()
    for first, its in ((0, ranges), (N_LASTING, boxes)):
        for axis, row in enumerate(() if its is None else its.rows):
            bias = f"bias_{row.name}"
            if its is not None and bias in measurement.states:
                y, state = measurement.outputs.index(row.name), measurement.states.index(bias)
                column, sd = measurement.layout.states[y].tolist().index(state), its.sd[axis]
                own = (0.0, 1.0) if its.keeps is None else (sd, its.keeps)
                found.append((y, column, first + axis, state, sd, *own))
    columns = np.array(found, float).reshape(-1, 7).T
    indices = [column.astype(np.int64) for column in columns[:4]]
    return LearnedCoefficients(*indices, *(np.ascontiguousarray(column) for column in columns[4:]))


@register_jitable
def told_layout(layout: Layout, told: LearnedCoefficients, lasting: np.ndarray, weights: np.ndarray) -> Layout:
    """Return the layout with the coefficients that fixes set; they are written to `weights` (p, w)."""
    for i in range(weights.shape[0]):
        for j in range(weights.shape[1]):
            weights[i, j] = layout.weights[i, j]
    sds = values_of(lasting)
    for i in range(told.row.size):
        sd, own = sds[told.at[i]], told.own[i]
        weights[told.row[i], told.column[i]] = (sd if own == 0.0 else np.sqrt(sd**2 + own**2)) / told.sd[i]
    return Layout(layout.C, layout.states, weights, layout.first, layout.block, layout.is_position)


@register_jitable
def vary(belief: np.ndarray, n: int, told: LearnedCoefficients, lasting: np.ndarray) -> None:
    """Propagate the lasting errors in a belief (n + n^2): s <- r s + w, w of variance (1 - r^2) sd^2."""
    kept, P = values_of(lasting), belief[n:].reshape((n, n))
    for i in range(told.row.size):
        r, state, own = kept[told.at[i] + N_KEPT], told.state[i], told.own[i]
        if own != 0.0:
            sd = kept[told.at[i]]
            r = (r * sd**2 + told.keeps[i] * own**2) / (sd**2 + own**2)
        if r != 1.0:
            belief[state] *= r
            for j in range(n):
                P[state, j] *= r
            for j in range(n):  # a loop of its own, so that the row's adjacent numbers are processed together
                P[j, state] *= r
            P[state, state] += (1.0 - r * r) * told.sd[i] ** 2


@register_jitable
def vary_all(memory: np.ndarray, slot: Slot, n: int, told: LearnedCoefficients, lasting: np.ndarray) -> None:
    """Apply `vary` to the present belief and to those of the history, or else a run from a past tick would lose it."""
    belief, history = kept_in(memory, slot)
    vary(belief, n, told, lasting)
    for row in range(history.shape[0]):
        vary(history[row, slot.belief : slot.y], n, told, lasting)


def told_filter_step(
    n: Any,
    y: np.ndarray,
    delta: np.ndarray,
    V2: np.ndarray,
    control: np.ndarray,
    reference: np.ndarray,
    opening: np.ndarray,
    lasting: np.ndarray,
    camera_lasting: np.ndarray,
    belief: np.ndarray,
    rows: np.ndarray,
    S: np.ndarray,
    deviation: np.ndarray,
    weights: np.ndarray,
    both: np.ndarray,
    model: FilterModel,
    layout: Layout,
    told: LearnedCoefficients,
) -> None:
    """Do filter_step with the coefficients that the fixes set."""
    put(values_of(lasting), both)
    put(values_of(camera_lasting), both, N_LASTING)
    its = told_layout(layout, told, both, weights)
    vary(belief, layout.C.shape[1] + N_I, told, both)
    filter_step(n, y, delta, V2, control, reference, opening, belief, rows, S, deviation, model, its)


def told_replay_step(
    n: Any,
    k: int,
    y: np.ndarray,
    delta: np.ndarray,
    V2: np.ndarray,
    stamps: np.ndarray,
    control: np.ndarray,
    reference: np.ndarray,
    opening: np.ndarray,
    lasting: np.ndarray,
    camera_lasting: np.ndarray,
    memory: np.ndarray,
    rows: np.ndarray,
    S: np.ndarray,
    deviation: np.ndarray,
    weights: np.ndarray,
    both: np.ndarray,
    model: FilterModel,
    layout: Layout,
    told: LearnedCoefficients,
    slot: Slot,
) -> None:
    """Do replay_filter_step with the coefficients that the fixes set."""
    put(values_of(lasting), both)
    put(values_of(camera_lasting), both, N_LASTING)
    its = told_layout(layout, told, both, weights)
    vary_all(memory, slot, layout.C.shape[1] + N_I, told, both)
    given = y, delta, V2, stamps, control, reference, opening
    replay_filter_step(n, k, *given, memory, rows, S, deviation, model, its, slot)


def told_acted_step(
    n: Any,
    k: int,
    y: np.ndarray,
    delta: np.ndarray,
    V2: np.ndarray,
    stamps: np.ndarray,
    control: np.ndarray,
    timeline: np.ndarray,
    reference: np.ndarray,
    opening: np.ndarray,
    lasting: np.ndarray,
    camera_lasting: np.ndarray,
    memory: np.ndarray,
    rows: np.ndarray,
    S: np.ndarray,
    deviation: np.ndarray,
    weights: np.ndarray,
    both: np.ndarray,
    model: FilterModel,
    layout: Layout,
    told: LearnedCoefficients,
    slot: Slot,
) -> None:
    """Do acted_filter_step with the coefficients that the fixes set."""
    put(values_of(lasting), both)
    put(values_of(camera_lasting), both, N_LASTING)
    its = told_layout(layout, told, both, weights)
    vary_all(memory, slot, layout.C.shape[1] + N_I, told, both)
    given = y, delta, V2, stamps, control, timeline, reference, opening
    acted_filter_step(n, k, *given, memory, rows, S, deviation, model, its, slot)


STEPS: dict[str, Callable[..., None]] = {
    "filter": told_filter_step,
    "replay_filter": told_replay_step,
    "acted_filter": told_acted_step,
}


def told_box(filter_: Box, told: LearnedCoefficients) -> Box:
    """Return the filter's box, changed to also read the fixes' `lasting` and `camera_lasting` numbers (6 each)."""
    element = filter_.element
    element = replace(element, name=f"told_{element.name}", step=STEPS[element.name])
    shape = filter_.given.tables["layout_weights"].shape
    box = replace(filter_, element=element, work=filter_.work | {"weights": shape, "both": (2 * N_LASTING,)})
    return box.with_groups(told=told)
