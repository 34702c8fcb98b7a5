"""The descriptions of a scenario's sensors, both built-in and registered ones."""

from collections.abc import Iterable

import numpy as np

from ortilo_drake.model.parts import Sensor, find_sensor
from ortilo_drake.model.room import Room
from ortilo_drake.scenario import Belief, Scenario
from ortilo_drake.sensors import camera, imu, uwb
from ortilo_drake.sensors.faster import with_samples
from ortilo_drake.sensors.information_rows import Information, own_rows

BUILT_IN = {sensor.name: sensor for sensor in (uwb.SENSOR, camera.SENSOR, imu.SENSOR)}


def described(name: str) -> Sensor:
    """Return the description of the sensor with this name; KeyError if it is neither built in nor registered."""
    found = BUILT_IN.get(name) or find_sensor(name)
    if found is None:
        raise KeyError(name)
    return found


def port_of(name: str) -> str:
    """Return the name of a sensor's messages at the ports of Drake's diagrams; other names are returned unchanged."""
    found = BUILT_IN.get(name) or find_sensor(name)
    return name if found is None else found.port or name


def title_of(name: str) -> str:
    """Return a sensor's title in texts and figures."""
    return described(name).title or name


def measuring(things: str) -> str:
    """Return the name of the built-in sensor that measures the room's `things`, 'anchors' or 'landmarks'."""
    return next(sensor.name for sensor in BUILT_IN.values() if sensor.measures == things)


def unwired(names: Iterable[str]) -> tuple[str, ...]:
    """Return the names of the sensors whose messages go over a radio."""
    return tuple(name for name in names if not described(name).is_wired)


def described_per_tick(name: str, scenario: Belief) -> Sensor:
    """Return the description of a sensor per tick; for a sensor faster than the tick, of the mean of its samples."""
    n = scenario.samples(name)
    return described(name) if n == 1 else with_samples(described(name), n)


def covariance_at(name: str, scenario: Scenario, room: Room, x: np.ndarray) -> np.ndarray | None:
    """Return the covariance of the value that a sensor gives at true state x (12), None if it gives none."""
    sensor = described_per_tick(name, scenario)
    if sensor.covariance is not None:
        return sensor.covariance(scenario, room, x)
    assert sensor.sd is not None
    sd = sensor.sd(scenario, room, x[np.newaxis])[0]
    return np.diag(sd**2) if np.isfinite(sd).all() else None


def information_of(
    name: str, scenario: Scenario, room: Room, truth: np.ndarray, seen: np.ndarray
) -> Information | None:
    """Return the Fisher information of a sensor's messages, None if it is not known.

    The messages reached the vehicle in the ticks marked in `seen` (n), at true states (n, 12).
    """
    sensor = described(name)
    if sensor.information is None:
        return Information({name: own_rows(sensor, scenario, room, truth, seen)})
    found: Information | None = sensor.information(scenario, room, truth, seen)
    return found


def as_learned(scenario: Scenario, x: np.ndarray) -> Scenario:
    """Return the scenario with the settings that its filter learns at hover at state x (12)."""
    room = scenario.load_room()
    for name in scenario.sensors:
        scenario = described(name).learned(scenario, room, x)
    return scenario
