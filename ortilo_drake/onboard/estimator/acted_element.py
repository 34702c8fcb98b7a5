"""The filter that puts late measurements into the tick of their stamp, and commands into the ticks they acted in."""

from dataclasses import replace
from typing import Any

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.loop.element import Box
from ortilo_drake.model.measurement import Layout
from ortilo_drake.model.placing import put
from ortilo_drake.model.signals import N_U
from ortilo_drake.onboard.commands.timeline import mean_control, unpacked, with_command
from ortilo_drake.onboard.estimator.filter_element import open_belief
from ortilo_drake.onboard.estimator.intermittent_filter import FilterModel
from ortilo_drake.onboard.estimator.late_measurements import Slot, replay_step, with_acted
from ortilo_drake.onboard.estimator.replay_element import belief_in, history_in


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
    deviation: np.ndarray,
    model: FilterModel,
    layout: Layout,
    slot: Slot,
) -> None:
    """Take what arrived in tick k and what is known to have acted, and predict tick k + 1.

    As replay_filter_step, with the mean over each tick of what acted in it in the place of the command that was sent.
    """
    hover = np.zeros(N_U)
    hover[0] = n.hover_thrust
    belief, history = belief_in(memory, slot), history_in(memory, slot)
    open_belief(belief, opening)
    for row in range(history.shape[0]):
        open_belief(history[row, slot.belief : slot.y], opening)
    start, end = k * n.h, (k + 1) * n.h
    sent = control - hover + hover  # rounded as in Drake, where the filter takes what differs from hover
    rows = with_command(unpacked(timeline), start + timeline[0], sent)
    put(with_acted(history, slot, belief, k, rows, hover, n.h, model, layout), belief)
    put(mean_control(rows, start, end) - hover, deviation)
    put(replay_step(history, slot, belief, k, y, delta, V2, stamps, n.h, deviation, reference, model, layout), belief)


def acted_box(replay: Box) -> Box:
    """Return the filter of replay_box that also reads the timeline of the commands, see commands/command_log.py."""
    element = replace(replay.element, name="acted_filter", step=acted_filter_step)
    return replace(replay, element=element).with_inputs(timeline="command_log")
