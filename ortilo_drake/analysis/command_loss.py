"""What losing control packets costs: mean-square stability and the second moment of the flying loop at hover.

A packet lost in a tick leaves the rotors with the last command ('hold') or at hover ('zero'), and filter and servo do
not learn of it. The loop is then jump-linear (command_loop.py), and stable in mean square if and only if the second
moment's operator has spectral radius below 1 (jump_linear.py: Costa, Fragoso and Marques).

Mean-square instability is not loss of every flight: the second moment may diverge through rare bursts while almost
every flight converges. Nor does stability keep a flight near hover, where the matrices hold.
"""

import numpy as np

from ortilo_drake.analysis.command_loop import CommandedLoop, behind_a_link, commanded_loop, growing_modes
from ortilo_drake.analysis.jump_linear import MARGIN, JumpLinear, loss_chain, mean_square_radius, steady_second_moment
from ortilo_drake.model.signals import N_X
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import BernoulliLoss, CommandLink, GilbertElliottLoss, Loss, Scenario


def lossy_loop(loop: CommandedLoop, link: CommandLink) -> JumpLinear:
    """Return the jump-linear system of a loop behind a command link."""
    A, N = behind_a_link(loop, link.when_lost, link.delay)
    return JumpLinear(A, N, *loss_chain(link.loss))


def loss_of(share: float, burst: float | None = None) -> Loss:
    """Return the loss that loses a share of the packets, independently or in bursts.

    Args:
        share: of the packets that are lost, in [0, 1].
        burst: mean length of a burst [ticks], at least 1; None for independent losses, whose bursts are 1 / (1 - share)
            long on average.

    Raises:
        InputError: if there is no such loss.
    """
    if not 0.0 <= share <= 1.0:
        raise InputError(f"loss: {share}: must be in [0, 1]")
    if burst is None:
        return BernoulliLoss(kind="bernoulli", probability=share)
    if not 1.0 <= burst < np.inf:
        raise InputError(f"burst: {burst}: must be 1 tick or more")
    if share > burst / (1.0 + burst):
        raise InputError(f"loss: {share}: bursts of {burst} ticks with a gap of one lose at most {burst / (1 + burst)}")
    good_to_bad = min(share / (1.0 - share) / burst, 1.0)  # at most 1 but for rounding
    return GilbertElliottLoss(kind="gilbert_elliott", good_to_bad=good_to_bad, bad_to_good=1.0 / burst)


def largest_loss(
    scenario: Scenario,
    V: np.ndarray,
    when_lost: str,
    burst: float | None = None,
    delay: int = 0,
    deltas: np.ndarray | None = None,
    tolerance: float = 1e-4,
) -> float:
    """Return the share of lost packets at which the loop ceases to be mean-square stable, by bisection.

    The radius rises with the share from well below 1 on the loops that fly here (tested on a grid); on a loop where it
    did not, this is one of the shares at which it crosses 1.

    Args:
        scenario: the scenario; its own command link is not used.
        V: covariance of the measurements uwb, camera, imu (9 x 9).
        when_lost: 'hold' or 'zero'.
        burst: mean length of a burst [ticks], None for independent losses.
        delay: of the link [ticks].
        deltas: arrivals over a period (T, 3); by default what is due.
        tolerance: of the share.

    Raises:
        InputError: if the loop is unstable without any loss, naming the modes.
    """
    loop = commanded_loop(scenario, V, deltas)

    def is_stable(share: float) -> bool:
        A, N = behind_a_link(loop, when_lost, delay)
        return mean_square_radius(JumpLinear(A, N, *loss_chain(loss_of(share, burst)))) < 1.0 - MARGIN

    if not is_stable(0.0):
        A, _ = behind_a_link(loop, when_lost, delay)
        raise InputError(f"command_link: unstable without any loss: {growing_modes(A[:, 0])}")
    low, high = 0.0, 1.0 if burst is None else burst / (1.0 + burst)
    if is_stable(high):
        return high
    while high - low > tolerance:
        middle = (low + high) / 2.0
        low, high = (middle, high) if is_stable(middle) else (low, middle)
    return low


def deviation(scenario: Scenario, V: np.ndarray, deltas: np.ndarray | None = None) -> np.ndarray:
    """Return E[x x^T] (12 x 12), hovering behind the scenario's command link, the mean over a period.

    Noise is as the filter believes it: W of the scenario and this V.

    Raises:
        InputError: if the loop is not mean-square stable.
    """
    system = lossy_loop(commanded_loop(scenario, V, deltas), scenario.command_link)
    return steady_second_moment(system).mean(axis=0)[:N_X, :N_X]
