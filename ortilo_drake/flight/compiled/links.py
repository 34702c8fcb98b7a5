"""The links of a compiled flight: which message is sent, which one lands."""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.flight.compiled.constants import LinkConstants
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.signals import STAMP
from ortilo_drake.world.radio.link import NOT_SENT, chain_after, delay_of_tick, landing_row, put_in_flight


@register_jitable
def empty_link(link: LinkConstants, size: int) -> np.ndarray:
    """Return what a link has in flight at first: nothing, rows (tick of arrival, message of that size)."""
    flying = np.zeros((link.delays[0] + link.delays[1], 1 + size))
    flying[:, 0] = -1.0
    return flying


@register_jitable(forceinline=True, error_model="numpy")
def delay_through(link: LinkConstants, k: int, x: np.ndarray, bad: bool, seed: int) -> int:
    """Return the delay of the message of tick k [ticks], NOT_SENT where none is sent."""
    if link.every == 0:
        return NOT_SENT
    return delay_of_tick(k, link.every, x, bad, link.loss, link.blackouts, link.delays, seed, link.stream)


@register_jitable(forceinline=True, error_model="numpy")
def deliver(message: np.ndarray, delay: int, flying: np.ndarray, k: int) -> None:
    """Overwrite the message of tick k by the one that lands in it, zeros if none does; put it in flight if it is late.

    Args:
        message: of this tick, read where it is sent (n).
        delay: of delay_through.
        flying: what is in flight.
        k: tick.
    """
    if flying.shape[0] == 0:  # of a link that is never late
        if delay == NOT_SENT:
            fill(message, 0.0)
        return
    landed = landing_row(flying, k, message[STAMP] if delay == 0 else -np.inf)
    late = flying[landed, 1:].copy() if landed != NOT_SENT else message
    if delay > 0:
        put_in_flight(flying, k + delay, message)
    if landed != NOT_SENT:
        put(late, message)
    elif delay != 0:
        fill(message, 0.0)


@register_jitable(forceinline=True, error_model="numpy")
def step_chain(link: LinkConstants, k: int, bad: np.ndarray, seed: int) -> None:
    """Change whether the link's chain is bad (1) from what it is at tick k to what it is at tick k + 1."""
    if link.has_chain:
        bad[0] = chain_after(k, bad[0], link.loss, seed, link.stream)
