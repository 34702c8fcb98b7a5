"""Bounds on the mean error covariance over a grid of arrival rates, or of arrival rate and burst length."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from ortilo_drake.model.signals import N_X, SENSORS
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario.link import BernoulliLoss, Link
from ortilo_drake.scenario.loss_chain import loss_of
from ortilo_drake.studies.arrivals.link_chain import link_chain
from ortilo_drake.theory.arrivals.arrivals import Model, check_rate, never_seen, pattern_probabilities
from ortilo_drake.theory.arrivals.expected_riccati import ROTATION, TRANSLATION, solve_coupled, vehicle_model
from ortilo_drake.theory.arrivals.markov_riccati import ArrivalChain, average_over_modes, markov_translation_lower_bound
from ortilo_drake.theory.riccati.riccati import solve


class ArrivalMap(NamedTuple):
    """Bounds on the limit of E[P_k]'s diagonal over a grid; inf where a state is never seen.

    Attributes:
        rows: values of the first argument (n).
        columns: values of the second (m).
        upper: variances of the twelve states, from above (n, m, 12); NaN where there is no such arrival process.
        lower: the same from below (n, m, 12).
    """

    rows: np.ndarray
    columns: np.ndarray
    upper: np.ndarray
    lower: np.ndarray


class _Point(NamedTuple):
    """The two diagonals (12) at a grid point, and every mode's covariance, from which a neighbour starts."""

    upper: np.ndarray
    lower: np.ndarray
    X: np.ndarray | None


def diagonals(model: Model, chain: ArrivalChain, start: np.ndarray | None = None) -> _Point:
    """Return the bounds' diagonals for one arrival process.

    Upper: the fixed point of the (coupled) expected Riccati equation. Lower: for position and velocity the larger of
    THEORY's bound and that of the rest; for the rest the covariance if whatever can arrive always arrived.
    Where position is never seen its variances and those of velocity are inf, and attitude stands by itself; inf too
    where the imu's own biases are states and nothing else sees it.

    Args:
        model: from expected_riccati.vehicle_model.
        chain: over arrivals.PATTERN_ROWS.
        start: X of a neighbour, if it has as many modes.
    """
    everywhere = np.full(N_X, np.inf)
    if never_seen(model, chain.probabilities):
        kept = _about_attitude(model)
        A, W, C = model.A[np.ix_(kept, kept)], model.W[np.ix_(kept, kept)], np.ascontiguousarray(model.C[:, kept])
        variances = np.full(len(model.A), np.inf)
        with suppress(InputError):  # told from the imu's biases by their slow decay alone: as good as never seen
            variances[kept] = np.diag(_always(Model(A, C, W, model.V, model.rows), chain))
        return _Point(variances[:N_X], variances[:N_X].copy(), None)
    try:
        always = _always(model, chain)
    except InputError:  # likewise
        return _Point(everywhere, everywhere.copy(), None)
    warm = start if start is not None and len(start) == len(chain.T) else np.repeat(always[None], len(chain.T), axis=0)
    X = solve_coupled(model, chain.probabilities, chain.backward, warm, "expected Riccati equation")
    lower = np.diag(always).copy()
    theory = np.einsum("m,mii->i", chain.stationary, markov_translation_lower_bound(model, chain))
    lower[TRANSLATION] = np.maximum(lower[TRANSLATION], theory)
    return _Point(np.diag(average_over_modes(chain, X))[:N_X].copy(), lower[:N_X], X)


def _about_attitude(model: Model) -> np.ndarray:
    """Return the numbers of attitude, rates, what drives them and what their rows see: torque and the imu's biases."""
    about = np.isin(np.arange(len(model.A)), ROTATION)
    about |= model.A[about].any(axis=0)
    seeing = model.C[:, about].any(axis=1) & ~model.C[:, TRANSLATION].any(axis=1)
    return np.flatnonzero(about | model.C[seeing].any(axis=0))


def _always(model: Model, chain: ArrivalChain) -> np.ndarray:
    """Return the covariance (n, n) if every row that can arrive arrived in every tick."""
    seen = model.rows[chain.probabilities.max(axis=0) > 0.0].any(axis=0)
    return solve(model.A.T, model.C[seen].T, model.W, model.V[np.ix_(seen, seen)], dual=True)


def _grid(
    rows: Sequence[float],
    columns: Sequence[float],
    model: Model,
    chain_at: Callable[[float, float], ArrivalChain | None],
) -> ArrivalMap:
    """Return the map over rows and columns; neighbours in a row start from each other, rows run in parallel."""

    def row(a: float) -> tuple[list[np.ndarray], list[np.ndarray]]:
        X, upper, lower = None, [], []
        for b in columns:
            chain = chain_at(a, b)
            if chain is None:
                upper.append(np.full(N_X, np.nan))
                lower.append(np.full(N_X, np.nan))
                continue
            point = diagonals(model, chain, X)
            X = point.X
            upper.append(point.upper)
            lower.append(point.lower)
        return upper, lower

    with ThreadPoolExecutor(os.cpu_count()) as threads:  # the compiled iteration runs without the interpreter's lock
        upper, lower = zip(*threads.map(row, rows), strict=True)
    return ArrivalMap(np.array(rows), np.array(columns), np.array(upper), np.array(lower))


def independent_chain(uwb: float, camera: float) -> ArrivalChain:
    """Return independent arrivals of uwb and camera as a chain of one mode; InputError for a rate outside [0, 1]."""
    one = np.ones((1, 1))
    return ArrivalChain(one, pattern_probabilities(uwb, camera)[None], np.ones(1), one)


def riccati_map(
    W: np.ndarray,
    V: np.ndarray,
    h: float,
    rates_uwb: Sequence[float],
    rates_camera: Sequence[float],
    C: np.ndarray | None = None,
) -> ArrivalMap:
    """Return the bounds over the arrival rates per tick of uwb (rows) and camera (columns), drawn independently.

    At rates (0, 0) position and velocity are inf.

    Args:
        W: process noise per tick (12 x 12).
        V: measurement noise of uwb, camera, imu and what else flies (p x p), which arrives in every tick.
        h: tick [s].
        rates_uwb: in [0, 1] (n).
        rates_camera: in [0, 1] (m).
        C: rows of y over the states (p x 12); by default those of the paper's three sensors.

    Raises:
        InputError: if a rate lies outside [0, 1], or W or V is no covariance.
    """
    return rate_map(vehicle_model(W, V, h, C), rates_uwb, rates_camera)


def rate_map(model: Model, rates_uwb: Sequence[float], rates_camera: Sequence[float]) -> ArrivalMap:
    """Return riccati_map of a filter's model, whose patterns are none, uwb, camera and both with all else."""
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
    position sensor arrives independently. NaN where no such channel exists (loss_chain.loss_of); a rate of 0 is
    no burst but no sensor.

    Args:
        W: process noise per tick (12 x 12).
        V: measurement noise of uwb, camera, imu and what else flies (p x p), which arrives in every tick.
        h: tick [s].
        rates: arrival rates per tick, in [0, 1] (n).
        bursts: mean lengths [s], at least a tick (m).
        sensor: uwb or camera.
        other_rate: arrival rate of the other.

    Raises:
        InputError: if a rate lies outside [0, 1], a burst is shorter than a tick, or the sensor is none of the two.
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
