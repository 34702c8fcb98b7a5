"""The Gilbert-Elliott chain of a link's loss: its parameters from the settings, or from a loss rate and burst length.

A Markov chain with a good and a bad state steps once a tick. The state sets the probability that a packet is lost
(E. N. Gilbert, "Capacity of a burst-noise channel", 1960; E. O. Elliott, 1963). The chain starts in the good state.
Independent (Bernoulli) loss has the same probability in both states.
"""

import numpy as np

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario.link import BernoulliLoss, GilbertElliottLoss, Loss


def loss_parameters(loss: Loss, h: float) -> np.ndarray:
    """Return the probabilities good to bad, bad to good, loss while good, loss while bad of any loss, for ticks h [s].

    InputError if bursts are shorter than a tick, or too short for their share of losses.
    """
    match loss.kind:
        case "bursts":
            ticks = loss.mean_length / h
            if ticks < 1.0 - 1e-9:
                raise InputError(f"mean_length: {loss.mean_length}: must be at least a tick, {h:.6g} s")
            return loss_parameters(loss_of(loss.loss, max(ticks, 1.0)), h)
        case "gilbert_elliott":
            return np.array([loss.good_to_bad, loss.bad_to_good, loss.loss_good, loss.loss_bad])
        case "bernoulli":
            return np.array([0.0, 0.0, loss.probability, loss.probability])
    return np.zeros(4)


def loss_chain(loss: Loss, h: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the transition matrix T (M x M) of the modes in a tick, and the probability of loss in each mode (M).

    The chain starts in the first mode; if it never leaves that mode, M is 1. Errors as in loss_parameters.
    """
    to_bad, to_good, good, bad = loss_parameters(loss, h)
    if to_bad == 0.0:
        return np.ones((1, 1)), np.array([good])
    return np.array([[1.0 - to_bad, to_bad], [to_good, 1.0 - to_good]]), np.array([good, bad])


def mean_loss(loss: Loss, h: float) -> float:
    """Return the share of packets that are lost in the long run. Arguments and errors as in loss_parameters."""
    to_bad, to_good, good, bad = loss_parameters(loss, h)
    return float(good if to_bad == 0.0 else (to_good * good + to_bad * bad) / (to_good + to_bad))


def loss_of(share: float, burst: float | None = None) -> Loss:
    """Return the settings of a link that loses a share of its packets, in [0, 1], independently or in bursts.

    `burst` is the mean length of a burst, at least 1 [ticks]. Every packet is lost while the chain is bad, none while
    it is good, and it stays good for at least a tick. With burst None losses are independent; their bursts then have a
    mean length of 1 / (1 - share). InputError if there is no such loss.
    """
    if not 0.0 <= share <= 1.0:
        raise InputError(f"loss: {share}: must be in [0, 1]")
    if burst is None:
        return BernoulliLoss(kind="bernoulli", probability=share)
    if not 1.0 <= burst < np.inf:
        raise InputError(f"burst: {burst}: must be at least 1 tick")
    if share > burst / (1.0 + burst):
        most = burst / (1.0 + burst)
        raise InputError(f"loss: {share}: must be at most {most} in bursts of {burst} ticks with a gap of one")
    good_to_bad = min(share / (1.0 - share) / burst, 1.0)  # at most 1, apart from rounding
    return GilbertElliottLoss(kind="gilbert_elliott", good_to_bad=good_to_bad, bad_to_good=1.0 / burst)
