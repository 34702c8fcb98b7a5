"""The delay of the commands that destabilises the flying loop at hover.

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
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.command_link.command_loop import (
    CommandedLoop,
    delay_aware_loop,
    delay_line,
    growing_modes,
    last_stable,
    loop_at_once,
    over_a_period,
)

LONGEST = 100  # ticks of delay to look at


@dataclass(frozen=True)
class CriticalDelay:
    """The delay that destabilises a loop: where growth first reaches 1, to 1e-6 ticks [s], and the same in ticks.

    whole_ticks is the least whole number with which the loop is unstable, growth is by whole ticks from 0 to one beyond
    that, and the modes are what grows with whole_ticks.
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
    """Return the augmented dynamics over a period (T, size, size), every command late by so many ticks (tau / h).

    G_late (n, m) has Gamma(theta h) in the place of Gamma in G; it is read for a delay that is no whole number.
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
    the arrivals over a period (T, s) are by default what is due.
    """
    return growth_with(loop_at_once(scenario, V, deltas), scenario, delay)


def growth_with(at_once: CommandedLoop, scenario: Scenario, delay: float) -> float:
    """Return delay_growth of the loop that loop_at_once returned."""
    loop = delay_aware_loop(at_once, scenario, delay)
    G_late = np.zeros_like(loop.G)
    theta = _ticks_above(delay) - delay
    if theta > 0.0:
        G_late += theta * loop.G  # of a force held for that share of the tick
        _, G_late[:N_X] = discretize(hover_A(scenario.yaw), hover_B(scenario.vehicle), theta * scenario.h)
    return growth(delayed_matrices(loop, delay, G_late))


def critical_delay(scenario: Scenario, V: np.ndarray, deltas: np.ndarray | None = None) -> CriticalDelay | None:
    """Return the delay that destabilises the loop, None if it is stable with LONGEST ticks of it.

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
