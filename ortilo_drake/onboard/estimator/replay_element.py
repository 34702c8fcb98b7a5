"""The filter that processes late measurements in the tick of their stamp, as elements of the loop.

REPLAY   the filter with its history, see late_measurements.py
PAST     the belief at the tick of a message's stamp

The filter of acted_box also puts commands into the ticks in which they acted.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.measurement import Layout, Measurement
from ortilo_drake.model.placing import put
from ortilo_drake.model.signals import ARRIVED, N_I, N_U, STAMP
from ortilo_drake.onboard.commands.timeline import mean_control, unpacked, with_command
from ortilo_drake.onboard.estimator.filter_element import open_belief, work_of
from ortilo_drake.onboard.estimator.intermittent_filter import FilterModel
from ortilo_drake.onboard.estimator.late_measurements import (
    Slot,
    empty_history,
    replay_in_place,
    row_of_past,
    slot_of,
    with_acted,
)


@register_jitable
def kept_in(memory: np.ndarray, slot: Slot) -> tuple[np.ndarray, np.ndarray]:
    """Return the two parts of the filter's memory: the present belief (n + n^2) and the history (N, slot.size)."""
    size = slot.y - slot.belief
    return memory[:size], memory[size:].reshape(((memory.size - size) // slot.size, slot.size))


@register_jitable
def open_all(belief: np.ndarray, history: np.ndarray, slot: Slot, opening: np.ndarray) -> None:
    """Add `opening` to P of the present belief and of the history, or else a run from a past tick would lose it."""
    opens = False
    for i in range(opening.size):
        opens = opens or opening[i] != 0.0
    if opens:
        open_belief(belief, opening)
        for row in range(history.shape[0]):
            open_belief(history[row, slot.belief : slot.y], opening)


@register_jitable
def replay_filter_step(
    n: Any,
    k: int,
    y: np.ndarray,
    delta: np.ndarray,
    V2: np.ndarray,
    stamps: np.ndarray,
    control: np.ndarray,
    reference: np.ndarray,
    opening: np.ndarray,
    memory: np.ndarray,
    rows: np.ndarray,
    S: np.ndarray,
    deviation: np.ndarray,
    model: FilterModel,
    layout: Layout,
    slot: Slot,
) -> None:
    """Process the arrivals of tick k, each in the tick of its stamp, and predict tick k + 1, see replay_in_place."""
    put(control, deviation)
    deviation[0] -= n.hover_thrust
    belief, history = kept_in(memory, slot)
    open_all(belief, history, slot, opening)
    given = y, delta, V2, stamps, n.h, deviation, reference
    replay_in_place(rows, S, history, slot, belief, k, *given, model, layout)


def belief_at_stamp_out(n: Any, message: np.ndarray, memory: np.ndarray, slot: Slot, out: np.ndarray) -> None:
    """Output the belief [xhat, P row by row] (n + n^2) at the tick of a message's stamp, given all arrivals since.

    The output is the present belief if no message arrived or its stamp is of this tick or later. If the stamp is older
    than the history, the output is the belief of the oldest tick kept.
    """
    present, history = kept_in(memory, slot)
    row = row_of_past(history, tick_of(message[STAMP], n.h)) if message[ARRIVED] != 0.0 else -1
    put(history[row, slot.belief : slot.y] if row >= 0 else present, out)


REPLAY = Element("replay_filter", step=replay_filter_step, shows="memory")
PAST = Element("belief_at_stamp", out=belief_at_stamp_out)


def replay_box(
    model: FilterModel, measurement: Measurement, hover_thrust: float, belief_0: np.ndarray, ticks: int, h: float
) -> Box:
    """Return the filter's box; it reads y, delta, V2, stamps, the control, the reference and the variances added to P.

    The box outputs the `belief`, [xhat, P row by row] of all its states, followed by the history.

    `ticks` is the number of ticks kept in the history, h the tick [s]; other arguments as in filter_box.
    """
    n = len(model.Phi) + N_I
    slot = slot_of(measurement, n)
    memory = np.concatenate((belief_0, empty_history(ticks, slot).ravel()))
    given, parts = Values({"hover_thrust": hover_thrust, "h": h}, {"memory": memory}), {"belief": (0, belief_0.size)}
    box = Box("filter", REPLAY, memory.size, given, work_of(n, measurement.sizes["y"]), parts=parts)
    return box.with_groups(model=model, layout=measurement.layout, slot=slot)


def belief_at_stamp_box(name: str, measurement: Measurement, n: int, h: float) -> Box:
    """Return the box of the belief at the tick of a message's stamp; it reads the message and the filter's `memory`.

    `measurement` is the filter's; n is the number of the filter's states with the integral; h is the tick [s].
    """
    return Box(name, PAST, n + n * n, Values({"h": h})).with_groups(slot=slot_of(measurement, n))


@register_jitable
def acted_filter_step(
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
    memory: np.ndarray,
    rows: np.ndarray,
    S: np.ndarray,
    deviation: np.ndarray,
    model: FilterModel,
    layout: Layout,
    slot: Slot,
) -> None:
    """Process the arrivals of tick k and the control known to have acted, and predict tick k + 1.

    Same as replay_filter_step, with the mean control that acted in each tick in place of the command that was sent.
    """
    hover = np.zeros(N_U)
    hover[0] = n.hover_thrust
    belief, history = kept_in(memory, slot)
    open_all(belief, history, slot, opening)
    start, end = k * n.h, (k + 1) * n.h
    sent = control - hover + hover  # rounds as in Drake, where the filter reads the difference from hover
    acted = with_command(unpacked(timeline), start + timeline[0], sent)
    put(with_acted(history, slot, belief, k, acted, hover, n.h, model, layout), belief)
    put(mean_control(acted, start, end) - hover, deviation)
    given = y, delta, V2, stamps, n.h, deviation, reference
    replay_in_place(rows, S, history, slot, belief, k, *given, model, layout)


def acted_box(replay: Box) -> Box:
    """Return the box of replay_box, changed to also read the timeline of the commands, see commands/timeline.py."""
    element = replace(replay.element, name="acted_filter", step=acted_filter_step, allocates=True)
    return replace(replay, element=element).with_inputs(timeline="command_log")
