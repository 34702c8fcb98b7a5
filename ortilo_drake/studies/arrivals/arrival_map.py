"""Bounds on the mean error covariance over a grid of arrival rates, or of arrival rate and burst length."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from math import lcm
from typing import NamedTuple

import numpy as np

from ortilo_drake.model.signals import N_X, SENSORS, STATE_NAMES
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario.link import BernoulliLoss, Link
from ortilo_drake.scenario.loss_chain import loss_chain, loss_of
from ortilo_drake.studies.loop.hover_loop import HoverLoop
from ortilo_drake.theory.arrivals.arrivals import Model, check_model, check_rate, never_seen, pattern_probabilities
from ortilo_drake.theory.arrivals.critical_rate import CriticalRate, critical_rate
from ortilo_drake.theory.arrivals.expected_riccati import (
    ROTATION,
    TRANSLATION,
    ArrivalChain,
    arrival_chain,
    average_over_modes,
    markov_translation_lower_bound,
    solve_coupled,
    vehicle_model,
)
from ortilo_drake.theory.riccati.riccati import solve


class ArrivalMap(NamedTuple):
    """Bounds on the diagonal of the limit of E[P_k] over a grid of row values (n) and column values (m).

    upper and lower (n, m, 12) bound the variances of the twelve states; NaN where no such arrival process exists, inf
    where a state is never seen.
    """

    rows: np.ndarray
    columns: np.ndarray
    upper: np.ndarray
    lower: np.ndarray


class _Point(NamedTuple):
    """The two bounds' diagonals (12) at a grid point, and X of each mode, from which a neighbour's iteration starts."""

    upper: np.ndarray
    lower: np.ndarray
    X: np.ndarray | None


_NO_POINT = _Point(np.full(N_X, np.nan), np.full(N_X, np.nan), None)


def diagonals(model: Model, chain: ArrivalChain, start: np.ndarray | None = None) -> _Point:
    """Return the bounds' diagonals for one arrival process, a chain over arrivals.PATTERN_ROWS.

    Upper: the fixed point of the (coupled) expected Riccati equation. Lower: the covariance if all that can arrive
    always arrived; for position and velocity the larger of this and markov_translation_lower_bound. If position is
    never seen, the variances of position and velocity are inf, and attitude is solved alone; all are inf if the imu's
    own biases are states and nothing else sees attitude. The start is X of a neighbour, used if it has as many modes.
    """
    everywhere = np.full(N_X, np.inf)
    if never_seen(model, chain.probabilities):
        kept = _about_attitude(model)
        A, W, C = model.A[np.ix_(kept, kept)], model.W[np.ix_(kept, kept)], np.ascontiguousarray(model.C[:, kept])
        variances = np.full(len(model.A), np.inf)
        with suppress(InputError):  # only slow decay tells attitude from the imu's biases: as good as never seen
            variances[kept] = np.diag(_always(Model(A, C, W, model.V, model.rows), chain))
        return _Point(variances[:N_X], variances[:N_X].copy(), None)
    try:
        always = _always(model, chain)
    except InputError:  # as above
        return _Point(everywhere, everywhere.copy(), None)
    warm = start if start is not None and len(start) == len(chain.T) else np.repeat(always[None], len(chain.T), axis=0)
    X = solve_coupled(model, chain.probabilities, chain.backward, warm, "expected Riccati equation")
    lower = np.diag(always).copy()
    theory = np.einsum("m,mii->i", chain.stationary, markov_translation_lower_bound(model, chain))
    lower[TRANSLATION] = np.maximum(lower[TRANSLATION], theory)
    return _Point(np.diag(average_over_modes(chain, X))[:N_X].copy(), lower[:N_X], X)


def _about_attitude(model: Model) -> np.ndarray:
    """Return the indices of attitude, rates, the states that drive them and those in their rows (biases)."""
    about = np.isin(np.arange(len(model.A)), ROTATION)
    about |= model.A[about].any(axis=0)
    seeing = model.C[:, about].any(axis=1) & ~model.C[:, TRANSLATION].any(axis=1)
    return np.flatnonzero(about | model.C[seeing].any(axis=0))


def _always(model: Model, chain: ArrivalChain) -> np.ndarray:
    """Return the covariance (n, n) for the case that every row that can arrive arrives in every tick."""
    seen = model.rows[chain.probabilities.max(axis=0) > 0.0].any(axis=0)
    return solve(model.A.T, model.C[seen].T, model.W, model.V[np.ix_(seen, seen)], dual=True)


def _grid(
    rows: Sequence[float],
    columns: Sequence[float],
    model: Model,
    chain_at: Callable[[float, float], ArrivalChain | None],
) -> ArrivalMap:
    """Return the map over rows and columns; neighbours in a row start from each other, rows run in parallel."""

    def row(a: float) -> list[tuple[np.ndarray, np.ndarray]]:
        X, found = None, []
        for b in columns:
            chain = chain_at(a, b)
            upper, lower, X = _NO_POINT._replace(X=X) if chain is None else diagonals(model, chain, X)
            found.append((upper, lower))
        return found

    with ThreadPoolExecutor(os.cpu_count()) as threads:  # the compiled iteration runs without the interpreter's lock
        bounds = np.array(list(threads.map(row, rows)))
    return ArrivalMap(np.array(rows), np.array(columns), bounds[:, :, 0], bounds[:, :, 1])


def independent_chain(uwb: float, camera: float) -> ArrivalChain:
    """Return independent arrivals of uwb and camera as a chain of one mode; InputError for a rate outside [0, 1]."""
    one = np.ones((1, 1))
    return ArrivalChain(one, pattern_probabilities(uwb, camera)[None], np.ones(1), one)


def rate_map(model: Model, rates_uwb: Sequence[float], rates_camera: Sequence[float]) -> ArrivalMap:
    """Return the bounds over the arrival rates per tick of uwb (rows) and camera (columns), drawn independently.

    The model's patterns are none, uwb, camera and both, with all else. At rates (0, 0) position and velocity are inf.
    InputError if a rate lies outside [0, 1].
    """
    uwb = [check_rate(rate, "arrival rate of uwb") for rate in rates_uwb]
    camera = [check_rate(rate, "arrival rate of camera") for rate in rates_camera]
    return _grid(uwb, camera, model, independent_chain)


def burst_map(
    W: np.ndarray,
    V: np.ndarray,
    h: float,
    rates: Sequence[float],
    bursts: Sequence[float],
    sensor: str = SENSORS[0],
    other_rate: float = 0.0,
) -> ArrivalMap:
    """Return the bounds over one sensor's arrival rate (rows) and the mean length of its bursts of losses (columns).

    The sensor's link is a Gilbert-Elliott channel that loses everything while bad and nothing while good; the other
    position sensor arrives independently, at other_rate. NaN where no such channel exists (loss_chain.loss_of); a rate
    of 0 means no sensor, not a burst. W, V and h are those of vehicle_model, the rates per tick in [0, 1] (n), the
    bursts in s, at least a tick (m). InputError if a rate lies outside [0, 1], a burst is shorter than a tick, or the
    sensor is neither uwb nor camera.
    """
    if sensor not in SENSORS[:2]:
        raise InputError(f"sensor: {sensor}: must be uwb or camera")
    checked = [check_rate(rate, f"arrival rate of {sensor}") for rate in rates]
    for burst in bursts:
        if not h * (1 - 1e-9) <= burst < np.inf:
            raise InputError(f"mean burst: {burst} s: must be finite and at least a tick, {h:.4g} s")
    lost_other = 1.0 - check_rate(other_rate, "arrival rate of the other sensor")
    other = Link(loss=BernoulliLoss(kind="bernoulli", probability=lost_other))

    def chain_at(rate: float, burst: float) -> ArrivalChain | None:
        try:
            link = Link(loss=loss_of(1.0 - rate, max(burst / h, 1.0) if rate else None))
        except InputError:
            return None
        return link_chain(*((link, other) if sensor == SENSORS[0] else (other, link)), h)

    return _grid(checked, list(bursts), vehicle_model(W, V, h), chain_at)


def link_chain(uwb: Link | None, camera: Link | None, h: float) -> ArrivalChain:
    """Return the arrival chain of uwb and camera over PATTERN_ROWS, from their links; a link of None does not fly.

    A mode is a tick of h [s] within the sensors' common period, times a state of each loss chain; the chains step once
    a tick. Blackouts and delays are left out.
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
                probabilities.append(pattern_probabilities(u, c))
    return arrival_chain(T, np.array(probabilities))


PATTERNS = ((False, False), (True, False), (False, True), (True, True))  # of uwb and camera, as arrivals.PATTERN_ROWS


@dataclass(frozen=True)
class ArrivalReport:
    """Bounds of the expected Riccati equation on each state's variance over arrival rates of uwb (n) and camera (m).

    upper and lower (n, m, 12) are inf where a variance is unbounded. without_position_sensors names the modes that are
    unseen without uwb and camera. critical_rate is the classical one.
    """

    states: tuple[str, ...]
    rates_uwb: np.ndarray
    rates_camera: np.ndarray
    upper: np.ndarray
    lower: np.ndarray
    without_position_sensors: list[str]
    critical_rate: CriticalRate


def filter_model(loop: HoverLoop, V: np.ndarray) -> Model:
    """Return the model of a scenario's filter for the bounds; its patterns: none, uwb, camera, both, with all else.

    V is the covariance of all measurements that the filter gets (p x p), see hover_loop.filter_V.
    """
    sensors, mapped = loop.measurement.sensors, loop.measurement.positions[:2]
    patterns = [[arrive[mapped.index(s)] if s in mapped else True for s in sensors] for arrive in PATTERNS]
    return check_model(Model(loop.Phi, loop.C, loop.W, V, loop.measurement.by_row(np.array(patterns))))


def arrival_report(
    loop: HoverLoop, V: np.ndarray, rates_uwb: Sequence[float], rates_camera: Sequence[float]
) -> ArrivalReport:
    """Return the bounds over the arrival rates per tick of uwb (n) and camera (m), with the classical critical rate.

    V is the covariance of all measurements that the filter gets (p x p). InputError if a rate lies outside [0, 1], or V
    is no covariance.
    """
    model = filter_model(loop, V)
    grid = rate_map(model, rates_uwb, rates_camera)
    unseen = never_seen(model, pattern_probabilities(0.0, 0.0), loop.names)
    return ArrivalReport(
        states=tuple(STATE_NAMES),
        rates_uwb=grid.rows,
        rates_camera=grid.columns,
        upper=grid.upper,
        lower=grid.lower,
        without_position_sensors=[str(mode) for mode in unseen],
        critical_rate=critical_rate(model.A, model.C),
    )
