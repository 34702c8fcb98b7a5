"""The report on Drake's matrices of a scenario: eigenvalues, controllability and observability.

Observability: the states that each set of sensors sees, and how well: Gramians over a horizon, their condition. A
sensor that sends only on every m-th tick sees the same states. The unobservable subspaces of (Phi^m, C) and (Phi, C)
are equal unless two eigenvalues of Phi differ by an m-th root of 1 (R. E. Kalman, Y. C. Ho, K. S. Narendra, 1963), and
here all eigenvalues are 1.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import svdvals

from ortilo_drake.model.hover import discretize, hover_A, hover_B
from ortilo_drake.model.signals import N_X, STATE_NAMES
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.servo.lq_gain import augmented_pair, gain_of
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.linearization.closed_forms import agreement, differentiate_closed_loop, sensors_without_noise
from ortilo_drake.studies.linearization.linearize import linearize
from ortilo_drake.studies.linearization.operating_point import check_sensors, frozen_gain, heading_ahead, rows_of
from ortilo_drake.studies.loop.hover_loop import hover_loop, sensor_subsets
from ortilo_drake.theory.modes.modes import (
    STATE_SHARE,
    Mode,
    modes,
    rescale,
    tick_scaling,
    unobservable_subspace,
    unreached_modes,
    unseen_modes,
)


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


# Units of the Gramians: 1 m, 0.1 rad, 1 m/s, 0.1 rad/s; 1 N, 0.1 N m; an output has the units of its states.
STATE_UNITS = np.repeat([1.0, 0.1, 1.0, 0.1], 3)
CONTROL_UNITS = np.array([1.0, 0.1, 0.1, 0.1])


@dataclass(frozen=True)
class Gramian:
    """Singular values (12), the largest first, of a Gramian in STATE_UNITS; its condition, inf if a state is hidden."""

    singular_values: np.ndarray
    condition: float


def gramian(A: np.ndarray, C: np.ndarray, ticks: int) -> np.ndarray:
    """Return sum_{k < ticks} (C A^k)^T C A^k, the observability Gramian; given A^T, B^T, the controllability Gramian.

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
    """Return the Gramian sum (C Phi^k)^T C Phi^k over a horizon [s], at least a tick, the sensors in every tick."""
    Phi, _, ticks = _in_units(scenario, horizon)
    C = rows_of(sensors) * STATE_UNITS
    C /= np.abs(C).sum(axis=1, keepdims=True)
    return _summary(Phi, C, ticks, tick_scaling(scenario.h) / STATE_UNITS)


def controllability_gramian(scenario: Scenario, horizon: float) -> Gramian:
    """Return the Gramian sum Phi^k Gamma Gamma^T (Phi^k)^T over a horizon [s]."""
    Phi, Gamma, ticks = _in_units(scenario, horizon)
    return _summary(Phi.T, Gamma.T, ticks, STATE_UNITS / tick_scaling(scenario.h))


def _in_units(scenario: Scenario, horizon: float) -> tuple[np.ndarray, np.ndarray, int]:
    """Return Phi and Gamma in STATE_UNITS and CONTROL_UNITS, and the horizon's ticks; InputError for less than one."""
    if not 0.999 * scenario.h <= horizon < np.inf:
        raise InputError(f"horizon: {horizon:g}: must be at least a tick, {scenario.h:g} s")
    Phi, Gamma = discretize(hover_A(scenario.yaw), hover_B(scenario.vehicle), scenario.h)
    units = STATE_UNITS[:, None]
    return Phi * STATE_UNITS / units, Gamma * CONTROL_UNITS / units, round(horizon / scenario.h)


HORIZON = 2.0  # horizon of the Gramians [s]


@dataclass(frozen=True)
class Gramians:
    """Gramians over a horizon [s]; the ones of observability by subset of the sensors."""

    horizon: float
    controllability: Gramian
    observability: dict[str, Gramian]


@dataclass(frozen=True)
class LinearizationReport:
    """Figures of Drake's matrices at hover and yaw 0."""

    scenario: str
    """the scenario's name."""
    h: float
    """tick [s]."""
    sensors: tuple[str, ...]
    """the scenario's sensors."""
    agreement: dict[str, dict[str, float]]
    """largest differences from the closed forms by part and matrix."""
    flown: dict[str, float]
    """largest difference of a tick of the flying diagram, by what arrives in it."""
    eigenvalues: dict[str, list[complex]]
    """eigenvalues, the largest modulus first, of plant (continuous), sampled_plant, servo_loop (15), filter (12, or as
    many as it has states) and closed_loop (27, or more), filter and loop with every sensor in every tick."""
    jordan_blocks: list[tuple[float, tuple[int, ...]]]
    """eigenvalue and block sizes of the sampled plant."""
    uncontrollable_modes: list[Mode]
    """modes that no control reaches."""
    unobservable_states: dict[str, list[str]]
    """states that each subset of the sensors leaves unknown."""
    unobservable_modes: dict[str, list[Mode]]
    """modes that each subset of the sensors does not see."""
    gramians: Gramians
    """Gramians over HORIZON."""


def _sorted(z: np.ndarray) -> list[complex]:
    """Return eigenvalues, the largest modulus first."""
    return sorted(z.astype(complex).tolist(), key=lambda w: (-round(abs(w), 12), -w.real, -w.imag))


def linearization_report(scenario: Scenario, V: np.ndarray | None = None) -> LinearizationReport:
    """Return the figures of Drake's matrices, eigenvalues, controllability and observability.

    The filter's gain follows from V, the covariance of the measurements (p x p), such as fix_noise gives; see
    frozen_gain. InputError naming the modes, if the sensors leave some unseen that do not decay.
    """
    check_sensors(scenario)
    loop, scale = hover_loop(scenario), tick_scaling(scenario.h)
    level = heading_ahead(scenario)
    K, delta = frozen_gain(scenario, V)
    Phibar, Gammabar = augmented_pair(scenario.vehicle, scenario.h, scenario.yaw)
    Phi, Gamma = loop.Phi[:N_X, :N_X], loop.Gamma[:N_X]  # the vehicle's own
    subsets = sensor_subsets(scenario.sensors)
    kept = sensors_without_noise(scenario)
    uwb, imu = (scenario.every(sensor) for sensor in kept)
    both = int(np.lcm(uwb, imu)) * 300  # a tick in which both are due; the next of the imu may be without uwb
    flown = {"+".join(kept): both} | ({kept[1]: both + imu} if imu % uwb else {})
    eigenvalues = {
        "plant": linearize(level, "plant").A,
        "sampled_plant": linearize(level, "sampled_plant").A,
        "servo_loop": Phibar - Gammabar @ gain_of(scenario),
        "filter": loop.Phi - K @ loop.C,
        "closed_loop": linearize(level, "closed_loop", frozen=(K, delta)).A,
    }
    return LinearizationReport(
        scenario=scenario.name,
        h=scenario.h,
        sensors=scenario.sensors,
        agreement=agreement(scenario),
        flown={name: differentiate_closed_loop(scenario, tick).largest_difference for name, tick in flown.items()},
        eigenvalues={name: _sorted(np.linalg.eigvals(A)) for name, A in eigenvalues.items()},
        jordan_blocks=[(m.eigenvalue.real, m.blocks) for m in modes(Phi, scale)],
        uncontrollable_modes=unreached_modes(Phi, Gamma, radius=0.0, scale=scale),
        unobservable_states=unobservable_states(scenario),
        unobservable_modes={
            name: unseen_modes(Phi, rows_of(some), radius=0.0, scale=scale) for name, some in subsets.items()
        },
        gramians=Gramians(
            horizon=HORIZON,
            controllability=controllability_gramian(scenario, HORIZON),
            observability={name: observability_gramian(scenario, some, HORIZON) for name, some in subsets.items()},
        ),
    )
