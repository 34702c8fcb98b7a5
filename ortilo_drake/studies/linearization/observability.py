"""Observability: the states that each set of sensors sees.

A sensor that sends only on every m-th tick sees the same states. The unobservable subspaces of (Phi^m, C) and (Phi, C)
are equal unless two eigenvalues of Phi differ by an m-th root of 1 (R. E. Kalman, Y. C. Ho, K. S. Narendra, 1963), and
here all eigenvalues are 1.
"""

import numpy as np

from ortilo_drake.model.hover import discretize, hover_A, hover_B
from ortilo_drake.model.parts import measurement_of
from ortilo_drake.model.signals import N_X, STATE_NAMES
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.loop.arrived_rows import sensor_subsets
from ortilo_drake.theory.modes.modes import STATE_SHARE, check_detectable
from ortilo_drake.theory.modes.staircase import rescale, tick_scaling, unobservable_subspace


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
