"""The report on Drake's matrices of a scenario, their eigenvalues, controllability and observability, for JSON."""

from typing import Any

import numpy as np

from ortilo_drake.onboard.servo.lq_gain import augmented_pair
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.linearization.closed_forms import agreement
from ortilo_drake.studies.linearization.flown_tick import difference_closed_loop
from ortilo_drake.studies.linearization.gramians import Gramian, controllability_gramian, observability_gramian
from ortilo_drake.studies.linearization.linearize import linearize
from ortilo_drake.studies.linearization.observability import check_sensors, rows_of, unobservable_states
from ortilo_drake.studies.linearization.operating_point import frozen_gain, heading_ahead
from ortilo_drake.studies.loop.arrived_rows import sensor_subsets
from ortilo_drake.studies.loop.hover_loop import hover_loop
from ortilo_drake.theory.modes.modes import Mode, modes, unreached_modes, unseen_modes
from ortilo_drake.theory.modes.staircase import tick_scaling


def _listed(z: np.ndarray) -> list[list[float]]:
    """Return eigenvalues as [real, imaginary], the largest modulus first."""
    return [[float(w.real), float(w.imag)] for w in sorted(z, key=lambda w: (-round(abs(w), 12), -w.real, -w.imag))]


def _modes(modes: list[Mode]) -> list[dict[str, Any]]:
    return [
        {
            "eigenvalue": [m.eigenvalue.real, m.eigenvalue.imag],
            "multiplicity": m.multiplicity,
            "deficiency": m.deficiency,
            "states": list(m.states),
        }
        for m in modes
    ]


def _gramian(gramian: Gramian) -> dict[str, Any]:
    condition = gramian.condition if np.isfinite(gramian.condition) else None
    return {"singular_values": gramian.singular_values.tolist(), "condition": condition}


def linearization_report(scenario: Scenario, horizon: float = 2.0, V: np.ndarray | None = None) -> dict[str, Any]:
    """Return the figures of Drake's matrices, eigenvalues, controllability and observability, ready for JSON.

    Keys: scenario, h, sensors; agreement (largest differences by part and matrix); flown (that of a tick of the flying
    diagram, by what arrives in it); eigenvalues as [real, imaginary] of plant (continuous), sampled_plant, servo_loop
    (15), filter (12) and closed_loop (27), filter and loop with every sensor in every tick; jordan_blocks of the
    sampled plant; uncontrollable_modes; unobservable_modes and unobservable_states by subset of the sensors; gramians
    over the horizon, a condition of None where a state is hidden. Everything is at yaw 0.

    Args:
        scenario: the scenario.
        horizon: of the Gramians [s].
        V: covariance of the measurements (p x p) for the filter's gain, such as fix_noise gives;
            see frozen_gain.

    Raises:
        InputError: naming the modes, if the sensors leave some unseen that do not decay.
    """
    check_sensors(scenario)
    loop, scale = hover_loop(scenario), tick_scaling(scenario.h)
    level = heading_ahead(scenario)
    K, delta = frozen_gain(scenario, V)
    Phibar, Gammabar = augmented_pair(scenario.vehicle, scenario.h)
    subsets = sensor_subsets(scenario.sensors)
    uwb, imu = scenario.every("uwb"), scenario.every("imu")
    both = int(np.lcm(uwb, imu)) * 300  # a tick in which both are due; the next of the imu may be without uwb
    flown = {"uwb+imu": both} | ({"imu": both + imu} if imu % uwb else {})
    eigenvalues = {
        "plant": linearize(level, "plant").A,
        "sampled_plant": linearize(level, "sampled_plant").A,
        "servo_loop": Phibar - Gammabar @ loop.L,
        "filter": loop.Phi - K @ loop.C,
        "closed_loop": linearize(level, "closed_loop", frozen=(K, delta)).A,
    }
    return {
        "scenario": scenario.name,
        "h": scenario.h,
        "sensors": list(scenario.sensors),
        "agreement": agreement(scenario),
        "flown": {name: difference_closed_loop(scenario, tick).largest_difference for name, tick in flown.items()},
        "eigenvalues": {name: _listed(np.linalg.eigvals(A)) for name, A in eigenvalues.items()},
        "jordan_blocks": [[m.eigenvalue.real, list(m.blocks)] for m in modes(loop.Phi, scale)],
        "uncontrollable_modes": _modes(unreached_modes(loop.Phi, loop.Gamma, radius=0.0, scale=scale)),
        "unobservable_states": unobservable_states(scenario),
        "unobservable_modes": {
            name: _modes(unseen_modes(loop.Phi, rows_of(some), radius=0.0, scale=scale))
            for name, some in subsets.items()
        },
        "gramians": {
            "horizon": horizon,
            "controllability": _gramian(controllability_gramian(scenario, horizon)),
            "observability": {
                name: _gramian(observability_gramian(scenario, some, horizon)) for name, some in subsets.items()
            },
        },
    }
