"""The loss and the delay of control packets that the flying loop tolerates at hover.

When a packet is lost, the rotors keep the last command ('hold') or return to hover ('zero'). Filter and servo do not
know of the loss. The loop is then jump-linear (command_loop.py), and stable in mean square if and only if the second
moment's operator has spectral radius below 1 (jump_linear.py: Costa, Fragoso and Marques).

Mean-square instability is not loss of every flight: the second moment may diverge through rare bursts while almost
every flight converges. Nor does stability keep a flight near hover, where the matrices hold.

A constant delay tau = (d - theta) h with whole d and 0 <= theta < 1 leaves the loop linear: over a tick the rotors
still get u_{k-d} for the first (1 - theta) h and then u_{k-d+1}, so with Gamma(s) = int_0^s e^(A r) dr B

    x_{k+1} = Phi x_k + (Gamma(h) - Gamma(theta h)) u_{k-d} + Gamma(theta h) u_{k-d+1},

which is exact (K. J. Åström and B. Wittenmark, "Computer-Controlled Systems", on systems with time delay). The loop is
stable if and only if the product of the augmented matrices over the sensors' period has spectral radius below 1.
"""

import math
from dataclasses import dataclass

import numpy as np

from ortilo_drake.model.hover import discretize, hover_A, hover_B
from ortilo_drake.model.signals import N_X
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.servo.lq_gain import augmented_pair, weight_matrices
from ortilo_drake.scenario import CommandLink, Loss, LqServo, Scenario
from ortilo_drake.scenario.loss_chain import loss_chain, loss_of
from ortilo_drake.studies.command_link.command_loop import (
    STRATEGIES,
    CommandedLoop,
    behind_a_link,
    commanded_loop,
    delay_aware_loop,
    delay_line,
    growing_modes,
    last_stable,
    loop_at_once,
    over_a_period,
)
from ortilo_drake.studies.loop.hover_loop import hover_loop, loop_gain, over_names
from ortilo_drake.theory.jump_linear.jump_linear import MARGIN, JumpLinear, mean_square_radius, steady_second_moment
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
    theory/lossy_control/lossy_gain.py on the servo's own weights. It is not flown: the scenario's servo has the gain of
    a link without losses. The scenario's own command link and its settings for late commands are not used; V is the
    covariance of the measurements (p x p).
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


LONGEST = 100  # most ticks of delay that are tried


@dataclass(frozen=True)
class CriticalDelay:
    """The delay [s] at which a loop's growth first reaches 1, to 1e-6 ticks, and the same delay in ticks.

    whole_ticks is the least whole number of ticks with which the loop is unstable. growth is by whole ticks from 0 to
    whole_ticks + 1. `modes` names the modes that grow with whole_ticks.
    """

    delay: float
    ticks: float
    whole_ticks: int
    growth: dict[str, float]
    modes: str


def _ticks_above(delay: float) -> int:
    if not 0.0 <= delay < np.inf:
        raise InputError(f"delay: {delay}: must be 0 ticks or more")
    return math.ceil(delay)


def delayed_matrices(loop: CommandedLoop, delay: float, G_late: np.ndarray | None = None) -> np.ndarray:
    """Return the augmented dynamics over a period (T, size, size), with every command `delay` ticks late (tau / h).

    G_late (n, m) is G with Gamma(theta h) in place of Gamma; it is read if the delay is no whole number.
    """
    d = _ticks_above(delay)
    A, U = delay_line(loop, d, holds=False)
    G_late = np.zeros_like(loop.G) if G_late is None else G_late
    A[:, : len(loop.G)] += (loop.G - G_late) @ U[d]
    if d:
        A[:, : len(loop.G)] += G_late @ U[d - 1]
    return A


def growth(A: np.ndarray) -> float:
    """Return the spectral radius of A_{T-1} ... A_0 as growth per tick."""
    return float(np.max(np.abs(np.linalg.eigvals(over_a_period(A))))) ** (1.0 / len(A))


def delay_growth(scenario: Scenario, V: np.ndarray, delay: float, deltas: np.ndarray | None = None) -> float:
    """Return the loop's growth per tick with a delay [ticks, whole or not]; below 1 it is stable.

    The scenario's own command link is not used. V is the covariance of the measurements (p x p), for the filter's gain;
    deltas (T, s) are the arrivals over a period, by default of the sensors that are due.
    """
    return growth_with(loop_at_once(scenario, V, deltas), scenario, delay)


def growth_with(at_once: CommandedLoop, scenario: Scenario, delay: float) -> float:
    """Return delay_growth for a loop that loop_at_once returned."""
    loop = delay_aware_loop(at_once, scenario, delay)
    G_late = np.zeros_like(loop.G)
    theta = _ticks_above(delay) - delay
    if theta > 0.0:
        G_late += theta * loop.G  # the force state is held for that share of the tick
        _, G_late[:N_X] = discretize(hover_A(scenario.yaw), hover_B(scenario.vehicle), theta * scenario.h)
    return growth(delayed_matrices(loop, delay, G_late))


def critical_delay(scenario: Scenario, V: np.ndarray, deltas: np.ndarray | None = None) -> CriticalDelay | None:
    """Return the delay that destabilises the loop, None if the loop is stable with LONGEST ticks of delay.

    InputError if the loop is unstable without a delay.
    """
    loop = loop_at_once(scenario, V, deltas)

    def matrices(ticks: int) -> np.ndarray:
        return delayed_matrices(delay_aware_loop(loop, scenario, ticks), ticks)

    rates = [growth_with(loop, scenario, 0)]
    if rates[0] >= 1.0:
        raise InputError(f"command_link: unstable without any delay: {growing_modes(matrices(0))}")
    while rates[-1] < 1.0:
        if len(rates) > LONGEST:
            return None
        rates.append(growth_with(loop, scenario, len(rates)))
    whole = len(rates) - 1
    low = last_stable(lambda ticks: growth_with(loop, scenario, ticks) < 1.0, whole - 1.0, float(whole), 1e-6)
    return CriticalDelay(
        delay=low * scenario.h,
        ticks=low,
        whole_ticks=whole,
        growth={str(d): rate for d, rate in enumerate([*rates, growth_with(loop, scenario, whole + 1)])},
        modes=growing_modes(matrices(whole)),
    )


LOSSES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)
BURSTS = (6.0,)  # mean lengths [ticks]


@dataclass(frozen=True)
class LinkFigures:
    """Growth of the second moment per tick behind a link, and rms distance from r [m], None where it diverges."""

    growth: float
    rms: float | None


@dataclass(frozen=True)
class CommandReport:
    """The loss and the delay of commands that a loop tolerates at hover; `period` is that of the sensors [ticks].

    growth is that of the second moment per tick with a perfect link. largest_loss is by strategy, for independent
    losses and for bursts of a mean length [ticks]. rms is the distance from r [m] by strategy and independent loss,
    None where it diverges. acknowledged_loss and acknowledged_rms are with the best gain for the loss, if arrivals are
    acknowledged and a lost command is zero; a servo without weights has no acknowledged_rms. delay destabilises the
    loop; None if none up to LONGEST does. own_link is behind the scenario's own command link.
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
    """Return the effect of lost and late commands on a scenario's loop at hover; V (p x p) as in commanded_loop.

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
