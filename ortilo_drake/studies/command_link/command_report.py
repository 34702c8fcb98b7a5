"""The report on the command link: the loss and the delay that the flying loop tolerates."""

from dataclasses import dataclass

import numpy as np

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import CommandLink, LqServo, Scenario
from ortilo_drake.scenario.loss_chain import loss_of
from ortilo_drake.studies.command_link.command_delay import CriticalDelay, critical_delay
from ortilo_drake.studies.command_link.command_loop import STRATEGIES, commanded_loop
from ortilo_drake.studies.command_link.command_loss import (
    acknowledged_loop,
    largest_acknowledged_loss,
    largest_loss,
    lossy_loop,
)
from ortilo_drake.theory.jump_linear.jump_linear import JumpLinear, mean_square_radius, steady_second_moment

LOSSES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)
BURSTS = (6.0,)  # mean lengths [ticks]


@dataclass(frozen=True)
class LinkFigures:
    """Growth of the second moment per tick behind a link, and rms distance from r [m], None where it diverges."""

    growth: float
    rms: float | None


@dataclass(frozen=True)
class CommandReport:
    """The loss and the delay of commands that a loop bears at hover.

    Attributes:
        scenario: its name.
        period: of the sensors [ticks].
        growth: of the second moment per tick with a perfect link.
        largest_loss: by strategy, of independent losses and in bursts of a mean length [ticks].
        rms: distance from r [m] by strategy and independent loss, None where it diverges.
        acknowledged_loss: largest loss with the best gain for it, where arrivals are acknowledged and a lost command is
            zero.
        acknowledged_rms: distance from r [m] with that gain by independent loss, None where it diverges; empty with a
            servo of one's own, which has no weights.
        delay: that destabilises; None if it was stable with every one looked at.
        own_link: behind the scenario's own command link.
    """

    scenario: str
    period: int
    growth: float
    largest_loss: dict[str, dict[str, float]]
    rms: dict[str, dict[str, float | None]]
    acknowledged_loss: float
    acknowledged_rms: dict[str, float | None]
    delay: CriticalDelay | None
    own_link: LinkFigures


def _rms(system: JumpLinear) -> float | None:
    """Return the rms distance of the position from r [m], None where there is no steady one."""
    try:
        return float(np.sqrt(np.trace(steady_second_moment(system).mean(axis=0)[:3, :3])))
    except InputError:
        return None


def command_report(scenario: Scenario, V: np.ndarray) -> CommandReport:
    """Return the effect of lost and late commands on a scenario's loop at hover; V covers the measurements (p x p).

    The scenario's own command link enters under `own_link` alone. InputError if the loop is unstable with a perfect
    link, naming the modes.
    """
    loop, h, weighs = commanded_loop(scenario, V), scenario.h, isinstance(scenario.servo, LqServo)
    link = scenario.command_link
    own = lossy_loop(commanded_loop(scenario, V, delay=link.delay), link, h)
    return CommandReport(
        scenario=scenario.name,
        period=len(loop.F),
        growth=mean_square_radius(lossy_loop(loop, CommandLink(), h)),
        largest_loss={
            s: {"independent": largest_loss(scenario, V, s, tolerance=5e-3)}
            | {f"bursts_of_{b:g}": largest_loss(scenario, V, s, b, tolerance=5e-3) for b in BURSTS}
            for s in STRATEGIES
        },
        rms={
            s: {f"{p:g}": _rms(lossy_loop(loop, CommandLink(loss=loss_of(p), when_lost=s), h)) for p in LOSSES}
            for s in STRATEGIES
        },
        acknowledged_loss=largest_acknowledged_loss(scenario),
        acknowledged_rms={f"{p:g}": _rms(acknowledged_loop(scenario, V, p)) for p in LOSSES if weighs},
        delay=critical_delay(scenario, V),
        own_link=LinkFigures(mean_square_radius(own), _rms(own)),
    )
