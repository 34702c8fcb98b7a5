"""The altimeter: a range finder that looks down along the body's axis at the floor.

    r = (z - z_floor) / (cos phi cos theta) + s(r) v,   s(r)^2 = sd^2 + (fraction r)^2,   v standard normal

It sees the floor and nothing that stands on it; the planned paths keep the vehicle's radius off those things. Onboard
the range is turned upright by the estimated attitude:

    z = z_floor + r cos phi cos theta,   V = (s(r) cos phi cos theta)^2 + (dz/dphi)^2 P_phi + (dz/dtheta)^2 P_theta
"""

from typing import Annotated

import numpy as np
from pydantic import Field, NonNegativeFloat

from ortilo_drake.model.measurement import row
from ortilo_drake.model.parts import Sensor, register_sensor
from ortilo_drake.model.room import Room
from ortilo_drake.model.typed_yaml import Positive
from ortilo_drake.onboard.fix_solver import FixSolver
from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.own_parts import SensorSettings
from ortilo_drake.world.sensors.state_sensor import StateSensor

MAX_TILT = 1.2  # beyond which the beam meets the floor too far away [rad]


class Altimeter(SensorSettings):
    """A range finder that looks down; by default a small lidar's, ours.

    Attributes:
        link: how its messages reach the vehicle.
        sd: noise that does not depend on the range [m].
        fraction: noise over the range [1].
        max_range: farther floors give no range [m].
    """

    sd: Positive = 0.02
    fraction: NonNegativeFloat = 0.01
    max_range: Annotated[float, Field(gt=0.0, le=1000.0)] = 8.0


def noise_sd(settings: Altimeter, r: np.ndarray) -> np.ndarray:
    """Return s(r) [m] at ranges r [m]."""
    return np.hypot(settings.sd, settings.fraction * r)


def slant_range(states: np.ndarray, floor: float) -> np.ndarray:
    """Return the distance to the floor along the beam [m] at states (..., 12); inf where the beam does not meet it."""
    upright = np.cos(states[..., 3]) * np.cos(states[..., 4])
    return np.where(upright > np.cos(MAX_TILT), (states[..., 2] - floor) / np.maximum(upright, 1e-3), np.inf)


def make_world(scenario: Scenario, room: Room) -> StateSensor:
    """Return the sensor in the world; payload [r]."""
    settings, floor = scenario.settings_of("altimeter"), room.interior.min[2]

    def measure(x: np.ndarray, v: np.ndarray, t: float) -> list[float] | None:
        r = float(slant_range(x, floor))
        measured = r + float(noise_sd(settings, np.array(r))) * v[0] if r <= settings.max_range else 0.0
        return [measured] if 0.0 < r <= settings.max_range and measured > 0.0 else None

    return StateSensor("altimeter", 1, 1, measure, scenario.seed, scenario.h)


def make_onboard(scenario: Scenario, room: Room) -> FixSolver:
    """Return what turns the range upright."""
    settings, floor = scenario.settings_of("altimeter"), room.interior.min[2]

    def solve(payload: np.ndarray, xhat: np.ndarray, P: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        r, phi, theta = float(payload[0]), float(xhat[3]), float(xhat[4])
        upright = np.cos(phi) * np.cos(theta)
        if not upright > np.cos(MAX_TILT):
            return None
        slope = r * np.array([np.sin(phi) * np.cos(theta), np.cos(phi) * np.sin(theta)])
        variance = (float(noise_sd(settings, np.array(r))) * upright) ** 2 + slope @ P[3:5, 3:5] @ slope
        return np.array([floor + r * upright]), np.array([[variance]])

    return FixSolver("altimeter", 1, 1, solve)


def row_sd(scenario: Scenario, room: Room, states: np.ndarray) -> np.ndarray:
    """Return the noise of z (n, 1) [m] at true states (n, 12), NaN where there is no range."""
    settings = scenario.settings_of("altimeter")
    r = slant_range(states, room.interior.min[2])
    upright = np.cos(states[:, 3]) * np.cos(states[:, 4])
    with np.errstate(invalid="ignore"):
        sd = noise_sd(settings, r) * upright
    return np.where((r > 0.0) & (r <= settings.max_range), sd, np.nan)[:, np.newaxis]


def limits(scenario: Scenario, room: Room) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and the greatest range that a packet may hold."""
    settings = scenario.settings_of("altimeter")
    return np.zeros(1), np.array([settings.max_range + 10.0 * noise_sd(settings, np.array(settings.max_range))])


register_sensor(
    Sensor(
        "altimeter",
        Altimeter,
        (row("z_alt", z=1.0),),
        make_world=make_world,
        make_onboard=make_onboard,
        sd=row_sd,
        limits=limits,
    )
)
