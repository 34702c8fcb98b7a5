"""The numbers by which a scenario states the filter's W and V: read from it, and put back.

Each number is named by its place in the scenario. A position sensor whose V is null takes its covariance from each fix.
Then the number that scales all these covariances is fitted in place of V: the ranges' noise, whose square scales the
covariance of multilateration, or the box centre's sd.

Two things are not exact. With 'known_attitude' the attitude error adds a part to a camera fix's covariance that does
not depend on center_sd; the fit scales this part, too. And center_sd enters the making of the fixes: a flight with the
fitted number gets other fixes than those to which it was fitted.
"""

from typing import Any

import numpy as np

from ortilo_drake.model.signals import SENSORS
from ortilo_drake.model.typed_yaml import InputError, validate
from ortilo_drake.onboard.estimator.filter_model import process_noise
from ortilo_drake.scenario import DiagonalW, IntermittentFilter, Scenario
from ortilo_drake.sensors.described import described, described_per_tick
from ortilo_drake.studies.tuning.noise_likelihood import NoiseModel

_DENSITIES = ("force_density", "torque_density")
_ALONE = (
    "noise is fitted to the paper's filter alone, as in nominal_imu_uwb; other filters' is searched by flying, `ortilo "
    "tune SEARCH.yaml --fly`, and that of a log fitted by `ortilo tune DIR --map DIR/map.yaml`"
)


def noise_numbers(scenario: Scenario) -> dict[str, float]:
    """Return the numbers that state W and V, by their place in the scenario; for V only of the sensors that fly.

    An entry of a triple is place.0 to place.2. A variance of 0 in a diagonal W is left out: it has no logarithm.
    InputError if the estimator is not the paper's filter.
    """
    if not isinstance(scenario.estimator, IntermittentFilter):
        kind = scenario.estimator.kind
        raise InputError(f"estimator.kind: {kind}: must be intermittent: {_ALONE}")
    W, V, found = scenario.estimator.W, scenario.estimator.V, {}
    for name in ("position", "angle", "velocity", "rate") if isinstance(W, DiagonalW) else _DENSITIES:
        found[f"estimator.W.{name}"] = float(getattr(W, name))
    for sensor in scenario.measurement.sensors:
        triple, numbers = getattr(V, sensor, None), described(sensor).noise_numbers
        if sensor in scenario.sensors and triple is None and numbers is not None:
            found |= numbers(scenario)
    for sensor in scenario.sensors:
        triple = getattr(V, sensor, None)
        if triple is not None:
            found |= {f"estimator.V.{sensor}.{i}": value for i, value in enumerate(triple)}
    return {name: value for name, value in found.items() if value > 0.0}


def sensor_of(name: str) -> str | None:
    """Return the sensor whose noise a number states; None for a number of W."""
    if name.startswith("estimator.W"):
        return None
    return next(s for s in SENSORS if name.startswith((f"estimator.V.{s}.", *described(s).noise_settings)))


def with_numbers(scenario: Scenario, numbers: dict[str, float]) -> Scenario:
    """Return the scenario with these numbers at their places."""
    data = scenario.model_dump(mode="json")
    for place, value in numbers.items():
        *parents, last = place.split(".")
        group: Any = data
        for parent in parents:
            group = group[parent]
        group[int(last) if isinstance(group, list) else last] = float(value)
    return validate(Scenario, data, scenario.name)


def noise_model(scenario: Scenario, recorded: Scenario, counted: tuple[str, ...] | None = None) -> NoiseModel:
    """Return W and V of a scenario's filter for a record that another scenario, `recorded`, flew.

    Both have the same sensors and sources of V. The likelihood counts the sensors `counted`, by default all. InputError
    if the filter estimates a force.
    """
    if scenario.estimator.force != "none":
        force = scenario.estimator.force
        raise InputError(f"estimator.force: {force}: must be none here: {_ALONE}")
    numbers, before = noise_numbers(scenario), noise_numbers(recorded)
    W = process_noise(scenario.estimator, scenario.vehicle, scenario.h, scenario.yaw)
    sensors, sizes = scenario.measurement.sensors, np.diff(scenario.measurement.layout.first)
    counts = np.array([float(counted is None or s in counted) for s in sensors])
    model = NoiseModel(W, np.zeros((len(sensors), max(sizes), max(sizes))), np.zeros(len(sensors)), counts)
    for s, sensor in enumerate(sensors):
        constant = described_per_tick(sensor, scenario).V(scenario)
        if constant is not None:
            model.V[s, : sizes[s], : sizes[s]] = constant
            continue
        scaled = next((name for name in numbers if sensor_of(name) == sensor), None)
        model.scale[s] = 1.0 if scaled is None else (numbers[scaled] / before[scaled]) ** 2
    return model
