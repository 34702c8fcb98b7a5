"""Observability and controllability Gramians over a finite horizon, and their condition numbers.

The infinite Gramian does not exist here. Every eigenvalue is 1, so the sum diverges, as k^7 where a position is seen
and as k^3 where an angle is, and X = Phi^T X Phi + C^T C has no solution. The numbers depend on the horizon.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import svdvals

from ortilo_drake.model.hover import discretize, hover_A, hover_B
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.linearization.observability import rows_of
from ortilo_drake.theory.modes.modes import unseen_modes
from ortilo_drake.theory.modes.staircase import tick_scaling

# Units in which the Gramians are given: 1 m, 0.1 rad, 1 m/s, 0.1 rad/s; 1 N, 0.1 N m; outputs as what they see.
STATE_UNITS = np.repeat([1.0, 0.1, 1.0, 0.1], 3)
CONTROL_UNITS = np.array([1.0, 0.1, 0.1, 0.1])


class Gramian(NamedTuple):
    """A Gramian over a finite horizon, in STATE_UNITS.

    Attributes:
        matrix: (12 x 12).
        singular_values: the largest first (12).
        condition: the largest over the smallest; inf where a state is hidden.
    """

    matrix: np.ndarray
    singular_values: np.ndarray
    condition: float


def gramian(A: np.ndarray, C: np.ndarray, ticks: int) -> np.ndarray:
    """Return sum_{k < ticks} (C A^k)^T C A^k, the observability Gramian; with A^T, B^T that of controllability."""
    total, row = np.zeros_like(A), C
    for _ in range(ticks):
        total += row.T @ row
        row = row @ A
    return total


def _summary(A: np.ndarray, C: np.ndarray, ticks: int, scale: np.ndarray) -> Gramian:
    W = gramian(A, C, ticks)
    s = svdvals(W)
    is_whole = not unseen_modes(A, C, radius=0.0, scale=scale)
    return Gramian(W, s, float(s[0] / s[-1]) if is_whole and s[-1] > 0.0 else np.inf)


def observability_gramian(scenario: Scenario, sensors: tuple[str, ...], horizon: float) -> Gramian:
    """Return sum (C Phi^k)^T C Phi^k over a horizon, every sensor named in every tick.

    Args:
        scenario: vehicle and tick.
        sensors: whose rows of C.
        horizon: [s], at least a tick.
    """
    Phi, _, ticks = _in_units(scenario, horizon)
    C = rows_of(sensors) * STATE_UNITS
    C /= np.abs(C).sum(axis=1, keepdims=True)
    return _summary(Phi, C, ticks, tick_scaling(scenario.h) / STATE_UNITS)


def controllability_gramian(scenario: Scenario, horizon: float) -> Gramian:
    """Return sum Phi^k Gamma Gamma^T (Phi^k)^T over a horizon [s]."""
    Phi, Gamma, ticks = _in_units(scenario, horizon)
    return _summary(Phi.T, Gamma.T, ticks, STATE_UNITS / tick_scaling(scenario.h))


def _in_units(scenario: Scenario, horizon: float) -> tuple[np.ndarray, np.ndarray, int]:
    """Return Phi and Gamma in STATE_UNITS and CONTROL_UNITS, and the horizon's ticks; InputError below one."""
    if not 0.999 * scenario.h <= horizon < np.inf:
        raise InputError(f"horizon: {horizon:g}: must be at least a tick, {scenario.h:g} s")
    Phi, Gamma = discretize(hover_A(scenario.yaw), hover_B(scenario.vehicle), scenario.h)
    return (
        Phi * STATE_UNITS / STATE_UNITS[:, None],
        Gamma * CONTROL_UNITS / STATE_UNITS[:, None],
        round(horizon / scenario.h),
    )
