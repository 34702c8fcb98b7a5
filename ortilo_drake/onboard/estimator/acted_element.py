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
from ortilo_drake.onboard.estimator.intermittent_filter import FilterModel
from ortilo_drake.onboard.estimator.late_measurements import Slot, replay_in_place, with_acted
from ortilo_drake.onboard.estimator.replay_element import kept_in, open_all


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
    """Take what arrived in tick k and what is known to have acted, and predict tick k + 1.

    As replay_filter_step, with the mean over each tick of what acted in it in the place of the command that was sent.
    """
    hover = np.zeros(N_U)
    hover[0] = n.hover_thrust
    belief, history = kept_in(memory, slot)
    open_all(belief, history, slot, opening)
    start, end = k * n.h, (k + 1) * n.h
    sent = control - hover + hover  # rounded as in Drake, where the filter takes what differs from hover
    acted = with_command(unpacked(timeline), start + timeline[0], sent)
    put(with_acted(history, slot, belief, k, acted, hover, n.h, model, layout), belief)
    put(mean_control(acted, start, end) - hover, deviation)
    given = y, delta, V2, stamps, n.h, deviation, reference
    replay_in_place(rows, S, history, slot, belief, k, *given, model, layout)


def acted_box(replay: Box) -> Box:
    """Return the filter of replay_box that also reads the timeline of the commands, see commands/command_log.py."""
    element = replace(replay.element, name="acted_filter", step=acted_filter_step, allocates=True)
    return replace(replay, element=element).with_inputs(timeline="command_log")
