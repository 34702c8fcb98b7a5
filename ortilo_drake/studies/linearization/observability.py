"""Observability: the states that each set of sensors sees, and how well: Gramians over a horizon, their condition.

A sensor that sends only on every m-th tick sees the same states. The unobservable subspaces of (Phi^m, C) and (Phi, C)
are equal unless two eigenvalues of Phi differ by an m-th root of 1 (R. E. Kalman, Y. C. Ho, K. S. Narendra, 1963), and
here all eigenvalues are 1.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import svdvals

from ortilo_drake.model.hover import discretize, hover_A, hover_B
from ortilo_drake.model.parts import measurement_of
from ortilo_drake.model.signals import N_X, STATE_NAMES
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.loop.hover_loop import sensor_subsets
from ortilo_drake.theory.modes.modes import (
    STATE_SHARE,
    check_detectable,
    rescale,
    tick_scaling,
    unobservable_subspace,
    unseen_modes,
)


def rows_of(sensors: tuple[str, ...]) -> np.ndarray:
    """Return the rows of C (m x 12) of the sensors named, in the order of the measurement."""
    measurement = measurement_of(sensors)
    return measurement.layout.C[measurement.by_row(np.isin(measurement.sensors, sensors))]


def check_sensors(scenario: Scenario) -> None:
    """Raise InputError naming the modes that the scenario's sensors leave unseen, all of them where it has none."""
    Phi, _ = discretize(hover_A(scenario.yaw), hover_B(scenario.vehicle), scenario.h)
    what = f"sensors: [{', '.join(scenario.sensors)}]"
    check_detectable(Phi, rows_of(scenario.sensors), what, scale=tick_scaling(scenario.h))


def unobservable_states(scenario: Scenario) -> dict[str, list[str]]:
    """Return the states that stay unknown with each subset of the scenario's sensors.

    State j is listed if its unit vector e_j is not orthogonal to the unobservable subspace N. For every other state
    e_j lies in N's complement, the row space of [C; C Phi; C Phi^2; ...], so the state is a combination of the outputs
    of finitely many ticks.
    """
    Phi, _ = discretize(hover_A(scenario.yaw), hover_B(scenario.vehicle), scenario.h)
    table = {}
    for name, sensors in sensor_subsets(scenario.sensors).items():
        N = unobservable_subspace(*rescale(Phi, rows_of(sensors), tick_scaling(scenario.h)))
        table[name] = [STATE_NAMES[j] for j in range(N_X) if np.linalg.norm(N[j]) > STATE_SHARE]
    return table


# Units in which the Gramians are given: 1 m, 0.1 rad, 1 m/s, 0.1 rad/s; 1 N, 0.1 N m; outputs as what they see.
STATE_UNITS = np.repeat([1.0, 0.1, 1.0, 0.1], 3)
CONTROL_UNITS = np.array([1.0, 0.1, 0.1, 0.1])


@dataclass(frozen=True)
class Gramian:
    """Singular values (12), the largest first, of a Gramian in STATE_UNITS; its condition, inf of a hidden state."""

    singular_values: np.ndarray
    condition: float


def gramian(A: np.ndarray, C: np.ndarray, ticks: int) -> np.ndarray:
    """Return sum_{k < ticks} (C A^k)^T C A^k, the observability Gramian; with A^T, B^T that of controllability.

    The infinite Gramian does not exist here. Every eigenvalue is 1, so the sum diverges, as k^7 where a position is
    seen and as k^3 where an angle is, and X = Phi^T X Phi + C^T C has no solution. The numbers depend on the horizon.
    """
    total, row = np.zeros_like(A), C
    for _ in range(ticks):
        total += row.T @ row
        row = row @ A
    return total


def _summary(A: np.ndarray, C: np.ndarray, ticks: int, scale: np.ndarray) -> Gramian:
    s = svdvals(gramian(A, C, ticks))
    is_whole = not unseen_modes(A, C, radius=0.0, scale=scale)
    return Gramian(s, float(s[0] / s[-1]) if is_whole and s[-1] > 0.0 else np.inf)


def observability_gramian(scenario: Scenario, sensors: tuple[str, ...], horizon: float) -> Gramian:
    """Return that of sum (C Phi^k)^T C Phi^k over a horizon [s] of a tick or more, the sensors named in every tick."""
    Phi, _, ticks = _in_units(scenario, horizon)
    C = rows_of(sensors) * STATE_UNITS
    C /= np.abs(C).sum(axis=1, keepdims=True)
    return _summary(Phi, C, ticks, tick_scaling(scenario.h) / STATE_UNITS)


def controllability_gramian(scenario: Scenario, horizon: float) -> Gramian:
    """Return that of sum Phi^k Gamma Gamma^T (Phi^k)^T over a horizon [s]."""
    Phi, Gamma, ticks = _in_units(scenario, horizon)
    return _summary(Phi.T, Gamma.T, ticks, STATE_UNITS / tick_scaling(scenario.h))


def _in_units(scenario: Scenario, horizon: float) -> tuple[np.ndarray, np.ndarray, int]:
    """Return Phi and Gamma in STATE_UNITS and CONTROL_UNITS, and the horizon's ticks; InputError below one."""
    if not 0.999 * scenario.h <= horizon < np.inf:
        raise InputError(f"horizon: {horizon:g}: must be at least a tick, {scenario.h:g} s")
    Phi, Gamma = discretize(hover_A(scenario.yaw), hover_B(scenario.vehicle), scenario.h)
    units = STATE_UNITS[:, None]
    return Phi * STATE_UNITS / units, Gamma * CONTROL_UNITS / units, round(horizon / scenario.h)
