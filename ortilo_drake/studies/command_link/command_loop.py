"""The flying loop with a link between the command and the rotors, as matrices.

At hover z_{k+1} = F z_k + G a_k + n_k. The state is z = [x; xhat; i], the command is u_k = -L z_k, and a_k is the
control that reaches the rotors. Filter and integrator know the command, not a_k, so their response to it is in F.
Behind a link of delay d the state grows to

    [z; a_{k-1}; u_{k-1}; ...; u_{k-d}]    (a_{k-1} only where lost packets are held),

a_k is u_{k-d} if that arrives, else a_{k-1} ('hold') or 0 ('zero'). The delay is constant, so a packet lost at sending
and one lost at arrival have the same statistics.

With commands.filter 'acted' xhat is the estimate once the filter knows a_k, by a report without loss or delay: its
response to a_k is then in G. A servo that accounts for late commands has u_k = -L z_k - sum_j L_j u_{k-j}, see
late_servo.py.
"""

import math
from collections.abc import Callable
from functools import reduce
from typing import Literal, NamedTuple

import numpy as np

from ortilo_drake.model.signals import N_I, N_X, STATE_NAMES
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.estimator.extra_states import D
from ortilo_drake.onboard.estimator.kalman import predicted_covariance, predictor_gain
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.command_link.late_servo import late_gains
from ortilo_drake.studies.loop.hover_loop import (
    HoverLoop,
    arrivals_of,
    filter_measurement,
    filter_V,
    hover_loop,
    message_of,
    open_loop,
)
from ortilo_drake.theory.modes.modes import unseen_modes

SETTLED = 1e-13  # relative change of the periodic covariance at which it counts as steady
DIVERGED = 1e14  # growth of the covariance, over tr W, at which it counts as diverging
STRATEGIES: tuple[Literal["hold", "zero"], ...] = ("hold", "zero")


class CommandedLoop(NamedTuple):
    """The loop of a scenario, open at the rotors, over a period of T ticks; F (T, n, n) and G (n, m), n = 27 in flight.

    The command is u_k = -L z_k - sum_j L_u[j] u_{k-1-j} with L (m, n) and L_u (D, m, m); L_u is (0, 0, 0) if the servo
    assumes that commands act at once. N (T, n, n) is the covariance of n_k. G_hat (n, m) is the effect of u_k through a
    filter that assumes it to act at once; it is read only with L_u. by_v (T, n, p) is the effect of the measurements'
    noise and errors in each tick; empty where it is not needed.
    """

    F: np.ndarray
    G: np.ndarray
    L: np.ndarray
    N: np.ndarray
    L_u: np.ndarray = np.zeros((0, 0, 0))
    G_hat: np.ndarray = np.zeros((0, 0))
    by_v: np.ndarray = np.zeros((0, 0, 0))


def schedule(scenario: Scenario) -> np.ndarray:
    """Return delta of each tick of a period (T, s): 1 for the sensors that are due by their rates, nothing lost."""
    measurement = filter_measurement(scenario)
    sensors = [message_of(s, measurement) for s in measurement.sensors]
    every = [scenario.every(s) if s in scenario.sensors else 1 for s in sensors]
    there = arrivals_of(scenario.sensors, measurement)
    T = math.lcm(*every)
    return np.array([[there[s] * (k % every[s] == 0) for s in range(len(sensors))] for k in range(T)])


def over_arrivals(
    Phi: np.ndarray, C: np.ndarray, W: np.ndarray, V: np.ndarray, there: np.ndarray, P: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return K_k (T, n, p) and P_k (T, n, n) of the one-step predictor over arrivals (T, p) from P, and P after them.

    Phi and W are (n, n), C is (p, n), V is (p, p). Columns of K_k for rows that do not arrive are 0.
    """
    Ks, Ps = np.zeros((len(there), *C.T.shape)), np.zeros((len(there), *Phi.shape))
    for k, seen in enumerate(map(np.flatnonzero, there)):
        Ps[k], H = P, C[seen]
        Ks[k][:, seen] = K = predictor_gain(Phi, H, V[np.ix_(seen, seen)], P)
        P = predicted_covariance(Phi, H, W, P, K)
    return Ks, Ps, P


def periodic_predictor(
    Phi: np.ndarray, C: np.ndarray, W: np.ndarray, V: np.ndarray, there: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return K_k (T, n, p) and P_k (T, n, n) of the steady one-step predictor over a period of arrivals.

    The Riccati recursion of over_arrivals is iterated until it repeats; S. Bittanti and P. Colaneri, "Periodic Systems"
    (Springer, 2009), show that it converges where (Phi, C) is detectable over the period. InputError if it does not
    settle, as where an unstable state stays unseen.
    """
    P = np.trace(W) * np.eye(len(Phi))
    for _ in range(20_000):
        before = P
        Ks, Ps, P = over_arrivals(Phi, C, W, V, there, P)
        if np.max(np.abs(P - before)) <= SETTLED * np.max(np.abs(P)):
            return Ks, Ps
        if np.max(np.abs(P)) > DIVERGED * np.trace(W):
            break
    raise InputError("filter: its covariance does not settle with these arrivals")


def commanded_loop(
    scenario: Scenario, V: np.ndarray, deltas: np.ndarray | None = None, delay: float = 0.0
) -> CommandedLoop:
    """Return a scenario's loop, open at the rotors; its sensors' losses, delays and blackouts do not enter.

    V is the covariance of the measurements (p x p), deltas are arrivals of the sensors at each tick of a period (T, s),
    by default the sensors that are due. `delay` [ticks], after which commands act, is read if the servo accounts for
    it. InputError naming the modes of the vehicle that the sensors leave unseen.
    """
    return delay_aware_loop(loop_at_once(scenario, V, deltas), scenario, delay)


def delay_aware_loop(loop: CommandedLoop, scenario: Scenario, delay: float) -> CommandedLoop:
    """Return the loop of loop_at_once with the filter and servo that account for commands `delay` ticks late."""
    filter_acts, servo = scenario.commands.filter, scenario.commands.servo
    if filter_acts == "sent" and servo == "present":
        return loop
    hover = hover_loop(scenario)
    n, m = loop.G.shape
    G_hat = np.zeros((n, m))
    G_hat[hover.hats] = hover.Gamma
    F = loop.F + G_hat @ loop.L  # with a filter that assumes no command
    of_xbar, of_force, L_u = late_gains(scenario, delay)
    L = np.zeros((m, n))
    L[:, hover.hats.start : hover.hats.start + N_X] = of_xbar[:, :N_X]
    L[:, hover.hats.stop :] = of_xbar[:, N_X:]
    if set(D) <= set(hover.names):
        L[:, [hover.hats.start + hover.names.index(name) for name in D]] = of_force
    if filter_acts == "acted":
        return CommandedLoop(F, loop.G + G_hat, L, loop.N, L_u, np.zeros((n, m)), loop.by_v)
    return CommandedLoop(F - G_hat @ L, loop.G, L, loop.N, L_u, G_hat, loop.by_v)


def loop_at_once(scenario: Scenario, V: np.ndarray, deltas: np.ndarray | None = None) -> CommandedLoop:
    """Return the loop whose filter and servo assume that commands act at once; arguments, errors: commanded_loop's."""
    loop, V = hover_loop(scenario), filter_V(scenario, V)
    deltas = schedule(scenario) if deltas is None else deltas
    unseen = unseen_modes(loop.Phi, loop.C[loop.measurement.by_row(np.any(deltas, axis=0))], loop.names)
    if unseen:
        states = ", ".join(f"eigenvalue {mode.eigenvalue.real:g} of {' '.join(mode.states)}" for mode in unseen)
        raise InputError(f"sensors: {', '.join(scenario.sensors) or 'none'}: leave unseen {states}")
    Ks, _ = periodic_predictor(loop.Phi, loop.C, loop.W, V, loop.measurement.by_row(deltas))
    ticks = [open_loop(loop, K, delta) for K, delta in zip(Ks, deltas, strict=True)]
    F = np.array([tick.A for tick in ticks])
    by_v = np.array([_by_v(loop, K, delta) for K, delta in zip(Ks, deltas, strict=True)])
    N = by_v @ V @ by_v.transpose(0, 2, 1)
    world = list(loop.world)
    N[:, : len(world), : len(world)] += loop.W[np.ix_(world, world)]
    return CommandedLoop(F, ticks[0].B, ticks[0].C, N, by_v=by_v)


def _by_v(loop: HoverLoop, K: np.ndarray, delta: np.ndarray) -> np.ndarray:
    """Return v's input matrix on z (27 x p): [0; K Delta; -E], with 0 for -E if the integrator is 'estimate'."""
    hats = loop.hats
    from_v = np.zeros((hats.stop + N_I, len(loop.C)))
    from_v[hats] = K @ loop.measurement.arrival_matrix(delta)
    if loop.integrator != "estimate":
        from_v[hats.stop :] = -loop.measurement.selection_matrix(delta)
    return from_v


def delay_line(loop: CommandedLoop, delay: int, holds: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the loop behind a link while nothing acts on the rotors, and the rows that pick the commands.

    Returns:
        A (T, size, size): dynamics of [z; a; u_{k-1}; ...; u_{k-d}] with a_k = 0, and all u_{k-j} that the servo reads.
        U (d + 1 or more, m, size): U[j] picks u_{k-j}.
    """
    n, m = loop.G.shape
    first, kept = n + m * holds, max(delay, len(loop.L_u))
    size = first + m * kept
    U = np.zeros((kept + 1, m, size))
    U[0, :, :n] = -loop.L
    for j in range(1, kept + 1):
        U[j, :, first + m * (j - 1) : first + m * j] = np.eye(m)
    A = np.zeros((len(loop.F), size, size))
    A[:, :n, :n] = loop.F
    for j, L_j in enumerate(loop.L_u):
        own = slice(first + m * j, first + m * (j + 1))
        U[0, :, own] = -L_j
        A[:, :n, own] -= loop.G_hat @ L_j
    for j in range(kept):
        A[:, first + m * j : first + m * (j + 1)] = U[j]
    return A, U


def behind_a_link(loop: CommandedLoop, when_lost: str, delay: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return the matrices (T, 2, size, size) of a tick with arrival and one with loss, and N (T, size, size).

    InputError if the strategy is neither 'hold' nor 'zero' or the delay is no whole number of ticks.
    """
    if when_lost not in STRATEGIES:
        raise InputError(f"when_lost: {when_lost!r}: must be one of {', '.join(STRATEGIES)}")
    if not (isinstance(delay, int) and delay >= 0):
        raise InputError(f"delay: {delay!r}: must be a whole number of ticks, 0 or more")
    n, m = loop.G.shape
    holds = when_lost == "hold"
    idle, U = delay_line(loop, delay, holds)
    arrived, lost = idle.copy(), idle.copy()
    arrived[:, :n] += loop.G @ U[delay]
    if holds:
        arrived[:, n : n + m] = U[delay]
        lost[:, :n, n : n + m] += loop.G
        lost[:, n : n + m, n : n + m] = np.eye(m)
    N = np.zeros_like(idle)
    N[:, :n, :n] = loop.N
    return np.stack([arrived, lost], axis=1), N


def last_stable(is_stable: Callable[[float], bool], stable: float, unstable: float, tolerance: float) -> float:
    """Return the number at which stability ends between two numbers, on the stable side, by bisection."""
    while abs(unstable - stable) > tolerance:
        middle = (stable + unstable) / 2.0
        stable, unstable = (middle, unstable) if is_stable(middle) else (stable, middle)
    return stable


def over_a_period(A: np.ndarray) -> np.ndarray:
    """Return A_{T-1} ... A_0 of A (T, n, n)."""
    return reduce(lambda product, A_k: A_k @ product, A)


def growing_modes(A: np.ndarray) -> str:
    """Return, in words, the eigenvalues of a period's product A_{T-1} ... A_0 that do not decay, and their states.

    Each mode is named by the state of the vehicle that moves most in it, scaled by the tick; growth is per tick.
    """
    values, vectors = np.linalg.eig(over_a_period(A))
    growth = np.abs(values) ** (1.0 / len(A))
    found = []
    for j in np.argsort(-growth):
        if growth[j] >= 1.0 - 1e-9 and values[j].imag >= 0.0:
            name = STATE_NAMES[int(np.argmax(np.abs(vectors[:6, j])))]
            found.append(f"{name} by {growth[j]:.4f} a tick")
    return ", ".join(found) or "none"
