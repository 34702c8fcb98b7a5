"""The filter whose uwb fixes say how large the part of their error is that lasts.

    y_uwb = p + diag(rho) s + v,   rho_i = sigma_i / estimator.biases.uwb_sd_i

with sigma_i the sd that a fix says of its row i (ranging/lasting_error.py). The state s is the Gauss-Markov process of
that setting still. It is seen by larger or smaller coefficients where the geometry, or what has been learned of the
survey, makes it larger or smaller, and not at all where nothing lasts; of it a fix elsewhere keeps r_i,

    s_i <- r_i s_i + w_i,   w_i of variance (1 - r_i^2) uwb_sd_i^2.

The coefficients are those where the vehicle is believed to be: at the fix itself they would be correlated with its
noise. What is run again from a past tick has the present ones.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.loop.element import Array, Box
from ortilo_drake.model.measurement import UWB, Layout, Measurement
from ortilo_drake.model.scalars import values_of
from ortilo_drake.model.signals import N_I
from ortilo_drake.onboard.estimator.acted_element import acted_filter_step
from ortilo_drake.onboard.estimator.filter_element import filter_step
from ortilo_drake.onboard.estimator.intermittent_filter import FilterModel
from ortilo_drake.onboard.estimator.late_measurements import Slot
from ortilo_drake.onboard.estimator.replay_element import belief_in, history_in, replay_filter_step


class Told(NamedTuple):
    """Which coefficients of the measurement's layout are told.

    Attributes:
        row: of y (m).
        column: of the layout's weights (m).
        axis: of what lasts (m).
        state: which state it is the coefficient of (m).
        sd: that the filter believes of the state [m] (m).
    """

    row: np.ndarray
    column: np.ndarray
    axis: np.ndarray
    state: np.ndarray
    sd: np.ndarray


def told_of(measurement: Measurement, uwb_sd: tuple[float, ...]) -> Told:
    """Return the coefficients of a filter's measurement that uwb fixes set; uwb_sd is its setting [m] (3)."""
    rows, columns, states, axes = list[int](), list[int](), list[int](), list[int]()
    for axis, own in enumerate(UWB):
        bias = f"bias_{own.name}"
        if bias in measurement.states:
            row, state = measurement.outputs.index(own.name), measurement.states.index(bias)
            rows.append(row)
            columns.append(measurement.layout.states[row].tolist().index(state))
            states.append(state)
            axes.append(axis)
    whole = [np.array(its, np.int64) for its in (rows, columns, axes, states)]
    return Told(whole[0], whole[1], whole[2], whole[3], np.array([uwb_sd[axis] for axis in axes], float))


@register_jitable
def told_layout(layout: Layout, told: Told, lasting: np.ndarray, weights: np.ndarray) -> Layout:
    """Return a layout with the coefficients that a fix tells, in an array to write to (p, w)."""
    for i in range(weights.shape[0]):
        for j in range(weights.shape[1]):
            weights[i, j] = layout.weights[i, j]
    sds = values_of(lasting)
    for i in range(told.row.size):
        weights[told.row[i], told.column[i]] = sds[told.axis[i]] / told.sd[i]
    return Layout(layout.C, layout.states, weights, layout.first, layout.block, layout.is_position)


@register_jitable
def vary(belief: np.ndarray, n: int, told: Told, lasting: np.ndarray) -> None:
    """Change a belief (n + n^2) by what a fix elsewhere keeps of what lasts: s <- r s + w, w of (1 - r^2) sd^2."""
    kept = values_of(lasting)
    for i in range(told.row.size):
        r, state = kept[3 + told.axis[i]], told.state[i]
        if r != 1.0:
            belief[state] *= r
            for j in range(n):
                belief[n + n * state + j] *= r
                belief[n + n * j + state] *= r
            belief[n + (n + 1) * state] += (1.0 - r * r) * told.sd[i] ** 2


@register_jitable
def vary_all(memory: np.ndarray, slot: Slot, n: int, told: Told, lasting: np.ndarray) -> None:
    """Change the present belief and those of the history by vary: run again from a past tick it would be forgotten."""
    vary(belief_in(memory, slot), n, told, lasting)
    history = history_in(memory, slot)
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
    belief: np.ndarray,
    rows: np.ndarray,
    S: np.ndarray,
    less: np.ndarray,
    weights: np.ndarray,
    model: FilterModel,
    layout: Layout,
    told: Told,
) -> None:
    """Take filter_step with the coefficients that are told."""
    its = told_layout(layout, told, lasting, weights)
    vary(belief, layout.C.shape[1] + N_I, told, lasting)
    filter_step(n, y, delta, V2, control, reference, opening, belief, rows, S, less, model, its)


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
    memory: np.ndarray,
    less: np.ndarray,
    weights: np.ndarray,
    model: FilterModel,
    layout: Layout,
    told: Told,
    slot: Slot,
) -> None:
    """Take replay_filter_step with the coefficients that are told."""
    its = told_layout(layout, told, lasting, weights)
    vary_all(memory, slot, layout.C.shape[1] + N_I, told, lasting)
    replay_filter_step(n, k, y, delta, V2, stamps, control, reference, opening, memory, less, model, its, slot)


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
    memory: np.ndarray,
    less: np.ndarray,
    weights: np.ndarray,
    model: FilterModel,
    layout: Layout,
    told: Told,
    slot: Slot,
) -> None:
    """Take acted_filter_step with the coefficients that are told."""
    its = told_layout(layout, told, lasting, weights)
    vary_all(memory, slot, layout.C.shape[1] + N_I, told, lasting)
    acted_filter_step(n, k, y, delta, V2, stamps, control, timeline, reference, opening, memory, less, model, its, slot)


STEPS: dict[str, Callable[..., None]] = {
    "filter": told_filter_step,
    "replay_filter": told_replay_step,
    "acted_filter": told_acted_step,
}


def told_box(filter_: Box, measurement: Measurement, uwb_sd: tuple[float, ...]) -> Box:
    """Return one of the paper's filters that reads what is `lasting` (6) of uwb fixes as well."""
    element = filter_.element
    work = (*element.work, Array("weights", 2))
    element = replace(element, name=f"told_{element.name}", step=STEPS[element.name], work=work)
    shape = measurement.layout.weights.shape
    box = replace(filter_, element=element, work=filter_.work | {"weights": shape})
    return box.taking(told=told_of(measurement, uwb_sd))
