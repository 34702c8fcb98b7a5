"""The arrivals of uwb and camera behind their links, as one Markov chain."""

from math import lcm

import numpy as np

from ortilo_drake.scenario.link import Link
from ortilo_drake.scenario.loss_chain import loss_chain
from ortilo_drake.theory.arrivals.markov_riccati import ArrivalChain, arrival_chain


def link_chain(uwb: Link | None, camera: Link | None, h: float) -> ArrivalChain:
    """Return the chain of uwb and camera as their links have it; patterns as arrivals.PATTERN_ROWS.

    Modes: tick within the senders' common period, times the loss chains of both, which step once a tick. Blackouts and
    delays are left out.

    Args:
        uwb: link of the uwb fixes, or None where the sensor does not fly.
        camera: link of the camera fixes, or None.
        h: tick [s].
    """
    never = np.ones((1, 1)), np.ones(1)
    chains = [never if link is None else loss_chain(link.loss, h) for link in (uwb, camera)]
    (T_u, lost_u), (T_c, lost_c) = chains
    every = [1 if link is None else link.every(h) for link in (uwb, camera)]
    period = lcm(*every)
    T = np.kron(np.roll(np.eye(period), 1, axis=1), np.kron(T_u, T_c))
    probabilities = []
    for tick in range(period):
        for u in (1.0 - lost_u) * (tick % every[0] == 0):
            for c in (1.0 - lost_c) * (tick % every[1] == 0):
                probabilities.append([(1 - u) * (1 - c), u * (1 - c), (1 - u) * c, u * c])
    return arrival_chain(T, np.array(probabilities))
