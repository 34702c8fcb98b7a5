"""The altimeter: a range finder that looks down along the body's axis at the floor.

    r = (z - z_floor) / (cos phi cos theta) + s(r) v,   s(r)^2 = sd^2 + (fraction r)^2,   v standard normal

The altimeter measures the distance to the floor, not to objects on it; planned paths keep the vehicle's radius from
such objects. The onboard half turns the range to the vertical with the estimated attitude:

    z = z_floor + r cos phi cos theta,   V = (s(r) cos phi cos theta)^2 + (dz/dphi)^2 P_phi + (dz/dtheta)^2 P_theta
"""

from typing import Annotated, NamedTuple

import numpy as np
from numba.extending import register_jitable
from pydantic import Field, NonNegativeFloat

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.elementary import cos, sin
from ortilo_drake.model.measurement import row
from ortilo_drake.model.parts import Compiled, Sensor, register_sensor
from ortilo_drake.model.room import Room
from ortilo_drake.model.typed_yaml import Positive
from ortilo_drake.scenario import Belief, Scenario
from ortilo_drake.scenario.own_parts import SensorSettings

LEAST_UPRIGHT = cos(1.2)  # the largest tilt is 1.2 rad; beyond it the beam meets the floor too far away


class Altimeter(SensorSettings):
    """A range finder that looks down; the defaults are our figures for a small lidar."""

    sd: Positive = 0.02
    """noise sd that does not depend on the range [m]."""
    fraction: NonNegativeFloat = 0.01
    """noise sd that grows with the range, as a share of the range [1]."""
    max_range: Annotated[float, Field(gt=0.0, le=1000.0)] = 8.0
    """largest range: a floor farther away gives no range [m]."""


class AltimeterNumbers(NamedTuple):
    """The numbers of an altimeter, for compiled functions.

    The fields are those of Altimeter, and `floor`, the z of the floor [m].
    """

    floor: float
    sd: float
    fraction: float
    max_range: float


def numbers_of(scenario: Belief, room: Room) -> AltimeterNumbers:
    """Return the numbers of the scenario's altimeter in this room."""
    settings = scenario.settings_of("altimeter")
    return AltimeterNumbers(float(room.interior.min[2]), settings.sd, settings.fraction, settings.max_range)


@register_jitable
def noise_sd(numbers: AltimeterNumbers, r: float) -> float:
    """Return the noise sd s(r) [m] of a range r [m]."""
    return np.sqrt(numbers.sd**2 + (numbers.fraction * r) ** 2)


@cached_njit
def slant_range(x: np.ndarray, floor: float) -> float:
    """Return the distance to the floor along the beam [m] at a state (12); inf if the beam does not meet the floor."""
    upright = cos(x[3]) * cos(x[4])
    return (x[2] - floor) / upright if upright > LEAST_UPRIGHT else np.inf


@cached_njit
def measured_range(numbers: AltimeterNumbers, x: np.ndarray, v: np.ndarray, t: float) -> np.ndarray:
    """Return the payload [r], an empty array if there is no range; see `measure` of model.parts.Compiled."""
    r = slant_range(x, numbers.floor)
    if not 0.0 < r <= numbers.max_range:
        return np.zeros(0)
    measured = r + noise_sd(numbers, r) * v[0]
    return np.array([measured]) if measured > 0.0 else np.zeros(0)


@cached_njit
def upright_range(numbers: AltimeterNumbers, payload: np.ndarray, xhat: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Return z and its variance, an empty array if the tilt is too large; see `solve` of model.parts.Compiled."""
    r, phi, theta = payload[0], xhat[3], xhat[4]
    upright = cos(phi) * cos(theta)
    if not upright > LEAST_UPRIGHT:
        return np.zeros(0)
    by_phi, by_theta = r * (sin(phi) * cos(theta)), r * (cos(phi) * sin(theta))
    of_attitude = by_phi**2 * P[3, 3] + by_phi * by_theta * (P[3, 4] + P[4, 3]) + by_theta**2 * P[4, 4]
    return np.array([numbers.floor + r * upright, (noise_sd(numbers, r) * upright) ** 2 + of_attitude])


COMPILED = Compiled(numbers_of, 1, 1, measured_range, upright_range)


def slant_ranges(states: np.ndarray, floor: float) -> np.ndarray:
    """Return the distances to the floor along the beam (n) [m] at states (n, 12)."""
    return np.array([slant_range(x, floor) for x in np.ascontiguousarray(states)])


def row_sd(scenario: Scenario, room: Room, states: np.ndarray) -> np.ndarray:
    """Return the noise sd of z (n, 1) [m] at true states (n, 12), NaN if there is no range."""
    numbers = numbers_of(scenario, room)
    r = slant_ranges(states, numbers.floor)
    upright = np.cos(states[:, 3]) * np.cos(states[:, 4])
    with np.errstate(invalid="ignore"):
        sd = noise_sd(numbers, r) * upright
    return np.where((r > 0.0) & (r <= numbers.max_range), sd, np.nan)[:, np.newaxis]


def limits(scenario: Scenario, room: Room) -> tuple[np.ndarray, np.ndarray]:
    """Return the smallest and the largest range that a packet may hold (1 each) [m]."""
    numbers = numbers_of(scenario, room)
    return np.zeros(1), np.array([numbers.max_range + 10.0 * noise_sd(numbers, numbers.max_range)])


register_sensor(Sensor("altimeter", Altimeter, (row("z_alt", z=1.0),), sd=row_sd, limits=limits, compiled=COMPILED))
