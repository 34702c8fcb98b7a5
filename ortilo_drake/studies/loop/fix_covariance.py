"""Covariance of each sensor's measurement at a place, as the filter would receive it there.

Each sensor gives it (model/parts.py, `covariance` and `sd`); nothing is derived here. Noiseless ranges and boxes of the
place go through the very solvers that fly.
"""

import numpy as np

from ortilo_drake.scenario import Scenario
from ortilo_drake.sensors.described import covariance_at, described_per_tick


def value_noise(scenario: Scenario, name: str, x: np.ndarray) -> tuple[np.ndarray, bool]:
    """Return the covariance (m, m) of a flying sensor's value at state x (12), and whether the sensor gives a value."""
    found = covariance_at(name, scenario, scenario.load_room(), x)
    believed = described_per_tick(name, scenario).V(scenario)
    if believed is None:
        believed = np.eye(len(scenario.measurement.C_of(name))) if found is None else found
    return believed, found is not None


def fix_noise(scenario: Scenario, x: np.ndarray) -> tuple[dict[str, np.ndarray], dict[str, bool]]:
    """Return the covariance of each sensor's value [m^2], [rad^2] at state x (12), and whether the sensor gives one.

    Without a value it is the identity. Links and blackouts are left out.
    """
    V, there = {}, {}
    for name in scenario.measurement.sensors:
        V[name], there[name] = np.eye(len(scenario.measurement.C_of(name))), name in scenario.sensors
        if there[name]:
            V[name], there[name] = value_noise(scenario, name, x)
    return V, there
