"""The flying loop behind a link that acknowledges the commands that arrive, with the gain that is best for it.

A lost command is a control of zero. The filter predicts with what acted, and the servo's gain is that of
theory/lossy_control/acknowledged.py on the servo's own weights and the link's share of losses. It is not flown: the
scenario's servo has the gain of a link without losses.
"""

import numpy as np

from ortilo_drake.model.signals import N_X
from ortilo_drake.onboard.servo.lq_gain import augmented_pair, weight_matrices
from ortilo_drake.scenario import CommandLink, Scenario
from ortilo_drake.scenario.loss_chain import loss_of
from ortilo_drake.studies.command_link.command_loop import CommandedLoop, loop_at_once
from ortilo_drake.studies.command_link.command_loss import lossy_loop
from ortilo_drake.studies.loop.hover_loop import hover_loop, loop_gain, over_names
from ortilo_drake.theory.jump_linear.jump_linear import JumpLinear
from ortilo_drake.theory.lossy_control.acknowledged import acknowledged_gain, critical_command_rate


def largest_acknowledged_loss(scenario: Scenario) -> float:
    """Return the share of lost commands below which some gain keeps the loop stable, if arrivals are acknowledged."""
    return 1.0 - critical_command_rate(*augmented_pair(scenario.vehicle, scenario.h, scenario.yaw))


def acknowledged_loop(scenario: Scenario, V: np.ndarray, share: float) -> JumpLinear:
    """Return the jump-linear system of a scenario's loop with that share of its commands lost, each independently.

    Args:
        scenario: the scenario; its own command link, and what it makes of late commands, are not used.
        V: covariance of the measurements (p x p).
        share: of lost commands, in [0, 1).
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
