"""The arrivals of a flight: which messages reached the vehicle.

The link's noise is a pure function of (seed, stream, tick), so the link's own functions repeat its decisions from the
truth. The result includes messages that gave no fix and those that a gate refused.
"""

import numpy as np
from numba import njit

from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.loss_chain import loss_parameters
from ortilo_drake.world.noise import stream_id
from ortilo_drake.world.radio.link import NOT_SENT, blackout_rows, chain_after, delay_of_message


@njit(cache=True)
def messages_sent(
    truth: np.ndarray,
    every: int,
    loss: np.ndarray,
    blackouts: np.ndarray,
    delays: tuple[int, int],
    seed: int,
    stream: np.uint64,
) -> np.ndarray:
    """Return whether each tick's message was sent and not lost (n). Arguments as delay_of_message, truth (n, 12)."""
    sent, bad = np.zeros(truth.shape[0], dtype=np.bool_), False
    for k in range(truth.shape[0]):
        if k % every == 0:
            sent[k] = delay_of_message(k, truth[k], bad, loss, blackouts, delays, seed, stream) != NOT_SENT
        bad = chain_after(k, bad, loss, seed, stream)
    return sent


def arrived(scenario: Scenario, sensor: str, truth: np.ndarray) -> np.ndarray:
    """Return whether a sensor's measurement of each tick reached the vehicle, in that tick or later (n).

    The flight's seed is the scenario's, the truth its true states x_k (n, 12).
    """
    if sensor not in scenario.sensors:
        return np.zeros(len(truth), dtype=bool)
    link = scenario.link_of(sensor)
    return np.asarray(
        messages_sent(
            np.ascontiguousarray(truth),
            scenario.every(sensor),
            loss_parameters(link.loss, scenario.h),
            blackout_rows(link, scenario.h),
            (link.delay, link.random_delay),
            scenario.seed,
            stream_id(f"link/{sensor}"),
        )
    )
