"""Maximum likelihood estimates of W and V from recorded flights.

R. K. Mehra, "On the identification of variances and adaptive Kalman filtering", IEEE Trans. Automatic Control 15, 1970;
K. J. Åström, "Maximum likelihood and prediction error methods", Automatica 16, 1980. The numbers that state W and V
(noise_settings.py) are positive, so their logarithms theta are fitted, starting at the scenario's values:

    maximise log L(theta) = sum over flights log L_f(theta),    cov(theta) = H^-1,    H = -d2 log L / d theta2.

That covariance assumes that the model is true. Where it is not (box errors that persist, fixes that come late), the
flights' own scores s_f = d log L_f / d theta give the spread: cov(theta) = H^-1 (sum_f s_f s_f^T) H^-1 (H. White,
"Maximum likelihood estimation of misspecified models", Econometrica 50, 1982). Both are given.

Errors of boxes persist from picture to picture, and the likelihood would take that for precision. So with UWB the
camera's fixes are used but not counted (noise_likelihood.py): the camera's noise is judged by how well the other
sensors are predicted.

W describes the disturbance, not the error of the hover model. Tilted by phi and theta the vehicle loses 1 - cos phi cos
theta of its lift. The model ignores this, and the likelihood would take it for a large disturbance. So ticks with a
loss above LIFT_LOST are filtered but not counted, and neither are the ticks in which the filter still remembers one.
The tilt is that of the prediction xhat_k|k-1 with the scenario's own W and V. Whether y_k counts thus depends only on
earlier data; the score stays a martingale, and the choice of ticks makes no bias (D. R. Cox, "Partial likelihood",
Biometrika 62, 1975).

A number keeps its value if the record says nothing about it: its sensor never arrived, its likelihood is flat, or the
fit would change it by more than LARGEST_CHANGE (such as a disturbance hidden by the noise).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from ortilo_drake.model.hover import discretize, hover_A, hover_B
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario
from ortilo_drake.sensors.described import measuring
from ortilo_drake.studies.tuning.noise_likelihood import Record, log_likelihood, refilter
from ortilo_drake.studies.tuning.noise_settings import noise_model, noise_numbers, sensor_of, with_numbers

LIFT_LOST = 0.01  # of the weight: a tilt of 0.14 rad, 0.26 N of 2.7 kg - as much as the disturbance flown by default
LARGEST_CHANGE = 1e3  # factor by which a number may change
FLATTEST = 0.7  # a logarithm with a larger standard error (a factor of two) counts as unknown
_STEP = 0.02  # step of the central differences, in logarithms


@dataclass(frozen=True)
class Number:
    """A number before and after a fit, its standard errors and, if it stays, why.

    standard_error comes from the likelihood's curvature, robust_error from the spread of the flights' scores; the
    latter is None unless there are more flights than numbers. Both are None for a number that stays.
    """

    before: float
    after: float
    standard_error: float | None = None
    robust_error: float | None = None
    stays: str | None = None


@dataclass(frozen=True)
class Likelihood:
    """The logarithm of the likelihood before and after a fit."""

    before: float
    after: float


class NoiseFit(NamedTuple):
    """The result of a fit: the numbers by their place in the scenario, and the likelihood's logarithm before and after.

    counted are the sensors whose innovations the likelihood counted; tilted is the share of ticks left out for tilt.
    The scenario has the fitted numbers.
    """

    numbers: dict[str, Number]
    log_likelihood: Likelihood
    counted: tuple[str, ...]
    tilted: float
    scenario: Scenario


def _differences(f: Callable[[np.ndarray], np.ndarray], theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the gradients of f's components (p, n) and the Hessian of its sum (p, p), by central differences."""
    p, steps = len(theta), _STEP * np.eye(len(theta))
    middle = f(theta).sum()
    plus, minus = [f(theta + s) for s in steps], [f(theta - s) for s in steps]
    gradients = np.array([(a - b) / (2.0 * _STEP) for a, b in zip(plus, minus, strict=True)])
    H = np.empty((p, p))
    for i in range(p):
        H[i, i] = (plus[i].sum() - 2.0 * middle + minus[i].sum()) / _STEP**2
        for j in range(i):
            both = f(theta + steps[i] + steps[j]).sum() + f(theta - steps[i] - steps[j]).sum()
            alone = plus[i].sum() + minus[i].sum() + plus[j].sum() + minus[j].sum()
            H[i, j] = H[j, i] = (both - alone + 2.0 * middle) / (2.0 * _STEP**2)
    return gradients, H


def _maximise(f: Callable[[np.ndarray], np.ndarray], theta: np.ndarray, ticks: int) -> np.ndarray:
    """Return the theta that maximises the sum of f, each entry within a factor of LARGEST_CHANGE of its start."""

    def cost(change: np.ndarray) -> tuple[float, np.ndarray]:
        at = theta + change
        slope = [(f(at + s).sum() - f(at - s).sum()) / (2.0 * 1e-4) for s in 1e-4 * np.eye(len(at))]
        return -f(at).sum() / ticks, -np.array(slope) / ticks

    limits, options = np.log([1.0 / LARGEST_CHANGE, LARGEST_CHANGE]), {"maxiter": 200, "ftol": 1e-12, "gtol": 1e-7}
    bounds = [limits] * len(theta)
    found = minimize(cost, np.zeros(len(theta)), jac=True, method="L-BFGS-B", bounds=bounds, options=options)
    return np.asarray(theta + found.x)


def near_hover(xhat: np.ndarray, settle: int) -> np.ndarray:
    """Return a mask (n) of the ticks up to which the hover model held for `settle` ticks: the filter forgot any tilt.

    The model counts as not valid before the first of the predictions xhat (n, 12).
    """
    ticks = np.arange(len(xhat))
    tilted = np.cos(xhat[:, 3]) * np.cos(xhat[:, 4]) < 1.0 - LIFT_LOST
    return ticks - np.maximum.accumulate(np.where(tilted, ticks, -1)) > settle


def fit_noise(
    scenario: Scenario,
    records: Sequence[Record],
    settle: int,
    progress: Callable[[int], None] = lambda evaluations: None,
) -> NoiseFit:
    """Fit W and V of a scenario's filter to flights of it, with one record of the filter's inputs per flight.

    The first `settle` ticks, in which a flight has less error than P_0 says, do not count, nor do as many after a tilt.
    `progress` gets the number of likelihoods computed so far. InputError if nothing arrived near hover, or if the
    arrivals determine no number.
    """
    before = noise_numbers(scenario)
    Phi, Gamma = discretize(hover_A(scenario.yaw), hover_B(scenario.vehicle), scenario.h)
    flying = noise_model(scenario, scenario)
    counts = [near_hover(refilter(record, flying, Phi, Gamma)[0], settle) for record in records]
    ticks, settled = sum(map(np.sum, counts)), sum(max(len(c) - settle, 0) for c in counts)
    seen = np.any([r.delta[c].any(axis=0) for r, c in zip(records, counts, strict=True)], axis=0)
    arrived = [s for s, there in zip(scenario.measurement.sensors, seen, strict=True) if there]
    if not arrived:
        raise InputError(
            f"{scenario.name}: no measurement arrived near hover (less than {LIFT_LOST:.0%} of the lift lost to tilt "
            f"for {settle * scenario.h:.1f} s) in these flights: nothing to fit noise to"
        )
    kept = {name: f"{sensor_of(name)} never arrived" for name in before if sensor_of(name) not in (None, *arrived)}
    boxes, ranges = measuring("landmarks"), measuring("anchors")
    counted = tuple(s for s in arrived if s != boxes or ranges not in arrived)
    evaluations = 0

    def likelihoods(numbers: dict[str, float]) -> np.ndarray:
        nonlocal evaluations
        evaluations += 1
        progress(evaluations)
        noise = noise_model(with_numbers(scenario, numbers), scenario, counted)
        return np.array([log_likelihood(r, noise, Phi, Gamma, c) for r, c in zip(records, counts, strict=True)])

    start = likelihoods(before).sum()
    if not np.isfinite(start):
        raise InputError(f"{scenario.name}: the recorded measurements have no finite likelihood under the scenario")
    while True:
        free = [name for name in before if name not in kept]
        if not free:
            raise InputError(f"{scenario.name}: nothing about W or V can be told from these flights")

        def of_theta(theta: np.ndarray, free: list[str] = free) -> np.ndarray:
            return likelihoods(before | dict(zip(free, np.exp(theta).tolist(), strict=True)))

        theta_0 = np.log([before[name] for name in free])
        theta = _maximise(of_theta, theta_0, ticks)
        at_limit = np.abs(theta - theta_0) > np.log(LARGEST_CHANGE) - 0.1
        gradients, H = _differences(of_theta, theta)
        curvature, directions = np.linalg.eigh(-H)
        curvature = np.maximum(curvature, 1e-12)
        covariance = (directions / curvature) @ directions.T
        sd = np.sqrt(np.diag(covariance))
        worst = int(np.argmax(np.where(at_limit, np.inf, sd)))
        if not at_limit[worst] and sd[worst] <= FLATTEST:
            break
        kept[free[worst]] = (
            f"would change by more than a factor of {LARGEST_CHANGE:g}" if at_limit[worst] else "its likelihood is flat"
        )
    values = np.exp(theta)
    spread = covariance @ (gradients @ gradients.T) @ covariance
    robust = (values * np.sqrt(np.diag(spread))).tolist() if len(records) > len(free) else [None] * len(free)
    numbers = {name: Number(value, value, stays=kept.get(name)) for name, value in before.items()}
    for name, value, error, by_flights in zip(free, values.tolist(), (values * sd).tolist(), robust, strict=True):
        numbers[name] = Number(before[name], value, error, by_flights)
    after = {name: number.after for name, number in numbers.items()}
    likelihood = Likelihood(float(start), float(likelihoods(after).sum()))
    return NoiseFit(numbers, likelihood, counted, float(1.0 - ticks / settled), with_numbers(scenario, after))
