"""The cost of lost control packets: mean-square stability and the second moment of the flying loop at hover.

When a packet is lost, the rotors keep the last command ('hold') or return to hover ('zero'). Filter and servo do not
know of the loss. The loop is then jump-linear (command_loop.py), and stable in mean square if and only if the second
moment's operator has spectral radius below 1 (jump_linear.py: Costa, Fragoso and Marques).

Mean-square instability is not loss of every flight: the second moment may diverge through rare bursts while almost
every flight converges. Nor does stability keep a flight near hover, where the matrices hold.
"""

import numpy as np

from ortilo_drake.model.signals import N_X
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.servo.lq_gain import augmented_pair, weight_matrices
from ortilo_drake.scenario import CommandLink, Loss, Scenario
from ortilo_drake.scenario.loss_chain import loss_chain, loss_of
from ortilo_drake.studies.command_link.command_loop import (
    CommandedLoop,
    behind_a_link,
    commanded_loop,
    growing_modes,
    last_stable,
    loop_at_once,
)
from ortilo_drake.studies.loop.hover_loop import hover_loop, loop_gain, over_names
from ortilo_drake.theory.jump_linear.jump_linear import MARGIN, JumpLinear, mean_square_radius
from ortilo_drake.theory.lossy_control.lossy_gain import acknowledged_gain, critical_command_rate


def lossy_loop(loop: CommandedLoop, link: CommandLink, h: float) -> JumpLinear:
    """Return the jump-linear system of a loop of ticks h [s] behind a command link."""
    A, N = behind_a_link(loop, link.when_lost, link.delay)
    return _jump_linear(A, N, link.loss, h)


def _jump_linear(A: np.ndarray, N: np.ndarray, loss: Loss, h: float) -> JumpLinear:
    transition, lost = loss_chain(loss, h)
    return JumpLinear(A, N, np.column_stack([1.0 - lost, lost]), transition)


def largest_loss(
    scenario: Scenario,
    V: np.ndarray,
    when_lost: str,
    burst: float | None = None,
    delay: int = 0,
    deltas: np.ndarray | None = None,
    tolerance: float = 1e-4,
) -> float:
    """Return the share of lost packets at which the loop ceases to be mean-square stable, by bisection to a tolerance.

    The radius rises with the share from well below 1 on the loops that fly here (tested on a grid); on a loop where it
    did not, this is one of the shares at which it crosses 1. Lost packets are answered by 'hold' or 'zero'. Bursts have
    a mean length [ticks], None for independent losses; the delay is in ticks. V (p x p) and deltas (T, s) are as
    commanded_loop has them; the scenario's own command link is not used. InputError if the loop is unstable without any
    loss, naming the modes.
    """
    A, N = behind_a_link(commanded_loop(scenario, V, deltas, delay), when_lost, delay)

    def is_stable(share: float) -> bool:
        return mean_square_radius(_jump_linear(A, N, loss_of(share, burst), scenario.h)) < 1.0 - MARGIN

    if not is_stable(0.0):
        raise InputError(f"command_link: unstable without any loss: {growing_modes(A[:, 0])}")
    high = 1.0 if burst is None else burst / (1.0 + burst)
    return high if is_stable(high) else last_stable(is_stable, 0.0, high, tolerance)


def largest_acknowledged_loss(scenario: Scenario) -> float:
    """Return the share of lost commands below which some gain keeps the loop stable, if arrivals are acknowledged."""
    return 1.0 - critical_command_rate(*augmented_pair(scenario.vehicle, scenario.h, scenario.yaw))


def acknowledged_loop(scenario: Scenario, V: np.ndarray, share: float) -> JumpLinear:
    """Return the jump-linear system of a scenario's loop with a share, in [0, 1), of its commands lost independently.

    A lost command is a control of zero. The filter predicts with what acted, and the gain is that of
    theory/lossy_control/lossy_gain.py on the servo's own weights. It is not flown: the scenario's servo has the gain
    of a link without losses. The scenario's own command link, and what it makes of late commands, are not used; V is
    the covariance of the measurements (p x p).
    """
    hover, loop = hover_loop(scenario), loop_at_once(scenario, V)
    pair = augmented_pair(scenario.vehicle, scenario.h, scenario.yaw)
    L, _ = acknowledged_gain(*pair, *weight_matrices(scenario.servo.weights), 1.0 - share)
    if len(hover.names) > N_X:
        L = over_names(L, hover.names, scenario.vehicle, scenario.yaw, counters=True)
    G_hat = np.zeros_like(loop.G)
    G_hat[hover.hats] = hover.Gamma
    acted = CommandedLoop(loop.F + G_hat @ loop.L, loop.G + G_hat, loop_gain(hover._replace(L=L)), loop.N)
    return lossy_loop(acted, CommandLink(loss=loss_of(share), when_lost="zero"), scenario.h)
