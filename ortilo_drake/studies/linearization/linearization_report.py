"""The report on Drake's matrices of a scenario, their eigenvalues, controllability and observability."""

from dataclasses import dataclass

import numpy as np

from ortilo_drake.model.signals import N_X
from ortilo_drake.onboard.servo.lq_gain import augmented_pair, gain_of
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.linearization.closed_forms import agreement
from ortilo_drake.studies.linearization.flown_tick import differentiate_closed_loop, sensors_without_noise
from ortilo_drake.studies.linearization.linearize import linearize
from ortilo_drake.studies.linearization.observability import (
    Gramian,
    check_sensors,
    controllability_gramian,
    observability_gramian,
    rows_of,
    unobservable_states,
)
from ortilo_drake.studies.linearization.operating_point import frozen_gain, heading_ahead
from ortilo_drake.studies.loop.hover_loop import hover_loop, sensor_subsets
from ortilo_drake.theory.modes.modes import Mode, modes, tick_scaling, unreached_modes, unseen_modes

HORIZON = 2.0  # of the Gramians [s]


@dataclass(frozen=True)
class Gramians:
    """Gramians over a horizon [s]; that of observability by subset of the sensors."""

    horizon: float
    controllability: Gramian
    observability: dict[str, Gramian]


@dataclass(frozen=True)
class LinearizationReport:
    """Figures of Drake's matrices at hover and yaw 0.

    Attributes:
        scenario: its name.
        h: tick [s].
        sensors: of the scenario.
        agreement: largest differences from the closed forms by part and matrix.
        flown: largest difference of a tick of the flying diagram, by what arrives in it.
        eigenvalues: the largest modulus first, of plant (continuous), sampled_plant, servo_loop (15), filter (12, or as
            many as it has states) and closed_loop (27, or more), filter and loop with every sensor in every tick.
        jordan_blocks: eigenvalue and block sizes of the sampled plant.
        uncontrollable_modes: that no control reaches.
        unobservable_states: by subset of the sensors.
        unobservable_modes: by subset of the sensors.
        gramians: over the horizon.
    """

    scenario: str
    h: float
    sensors: tuple[str, ...]
    agreement: dict[str, dict[str, float]]
    flown: dict[str, float]
    eigenvalues: dict[str, list[complex]]
    jordan_blocks: list[tuple[float, tuple[int, ...]]]
    uncontrollable_modes: list[Mode]
    unobservable_states: dict[str, list[str]]
    unobservable_modes: dict[str, list[Mode]]
    gramians: Gramians


def _sorted(z: np.ndarray) -> list[complex]:
    """Return eigenvalues, the largest modulus first."""
    return sorted(z.astype(complex).tolist(), key=lambda w: (-round(abs(w), 12), -w.real, -w.imag))


def linearization_report(scenario: Scenario, V: np.ndarray | None = None) -> LinearizationReport:
    """Return the figures of Drake's matrices, eigenvalues, controllability and observability.

    The filter's gain is by V, the covariance of the measurements (p x p), such as fix_noise gives; see frozen_gain.
    InputError naming the modes, if the sensors leave some unseen that do not decay.
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
