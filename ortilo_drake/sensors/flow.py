"""Optical flow: a small camera that looks down and measures how fast the floor moves in view, with its own gyro.

At the distance d along the body's axis, the floor moves with (angular rates in B, x forward, y left)

    flow = [-v_x / d + w_y,  -v_y / d - w_x] + s v,   s = flow_sd / quality,   quality = 1 / (1 + (d / far)^2)

with v_B the velocity, w the body rates and v standard normal; the quality falls with the distance, as the texture
becomes coarser. There is no measurement below the distance `near` or for flow above max_flow. The onboard half
subtracts the gyro's rates and scales the rest with the estimated distance d = (z - z_floor) / (cos phi cos theta):

    v_B = -d [flow_x - w_y,  flow_y + w_x],   turned to W with the estimated attitude,

with V from the noise of flow and gyro and from the variance of the estimated distance. The distance's error is the
filter's own and not new in every tick, but V treats it as if it were new.
"""

from typing import Annotated, NamedTuple

import numpy as np
from numba.extending import register_jitable
from pydantic import Field

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.equations import body_rates, rotation_matrix
from ortilo_drake.model.measurement import row
from ortilo_drake.model.parts import Compiled, Sensor, register_sensor
from ortilo_drake.model.room import Room
from ortilo_drake.model.typed_yaml import Positive
from ortilo_drake.scenario import Belief, Scenario
from ortilo_drake.scenario.own_parts import SensorSettings
from ortilo_drake.sensors.altimeter import slant_range, slant_ranges
from ortilo_drake.world.vehicle.rotors import times

WORST = 0.05  # smallest quality of a measurement


class Flow(SensorSettings):
    """An optical-flow sensor; the defaults are our figures for the kind sold for small multirotors."""

    flow_sd: Positive = 0.02
    """noise sd of each component of the flow at quality 1 [rad/s]."""
    gyro_sd: Positive = 0.005
    """noise sd of the rates of the sensor's gyro [rad/s]."""
    far: Positive = 4.0
    """distance at which the quality is one half [m]."""
    near: Positive = 0.1
    """smallest distance at which the sensor measures [m]."""
    max_flow: Annotated[float, Field(gt=0.0, le=100.0)] = 7.4
    """largest flow that the sensor can measure [rad/s]."""


class FlowNumbers(NamedTuple):
    """The numbers of an optical-flow sensor, for compiled functions.

    The fields are those of Flow, and `floor`, the z of the floor [m].
    """

    floor: float
    flow_sd: float
    gyro_sd: float
    far: float
    near: float
    max_flow: float


def numbers_of(scenario: Belief, room: Room) -> FlowNumbers:
    """Return the numbers of the scenario's flow sensor in this room."""
    its = scenario.settings_of("flow")
    return FlowNumbers(float(room.interior.min[2]), its.flow_sd, its.gyro_sd, its.far, its.near, its.max_flow)


@register_jitable
def quality_at(far: float, d: float) -> float:
    """Return the quality, in (0, 1], at a distance d [m]."""
    return 1.0 / (1.0 + (d / far) ** 2)


@cached_njit
def flow_of(x: np.ndarray, d: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the noise-free flow (2) and the body rates w_x, w_y (2) [rad/s] at state x (12); the floor is at d [m]."""
    v_B = times(rotation_matrix(x[3:6]).T, x[6:9])
    w = body_rates(x[3:6], x[9:12])
    return np.array([-v_B[0] / d + w[1], -v_B[1] / d - w[0]]), np.array([w[0], w[1]])


@cached_njit
def measured_flow(numbers: FlowNumbers, x: np.ndarray, v: np.ndarray, t: float) -> np.ndarray:
    """Return the payload [flow_x, flow_y, w_x, w_y, quality], empty without a measurement; see model.parts.Compiled."""
    d = slant_range(x, numbers.floor)
    quality = quality_at(numbers.far, d)
    if not numbers.near <= d < np.inf or quality < WORST:
        return np.zeros(0)
    flow, w = flow_of(x, d)
    if max(abs(flow[0]), abs(flow[1])) > numbers.max_flow:
        return np.zeros(0)
    sd = numbers.flow_sd / quality
    said = np.array([flow[0] + sd * v[0], flow[1] + sd * v[1], w[0], w[1], quality])
    said[2] += numbers.gyro_sd * v[2]
    said[3] += numbers.gyro_sd * v[3]
    return said


@cached_njit
def velocity_over_ground(numbers: FlowNumbers, payload: np.ndarray, xhat: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Return the velocity in W (2) and its covariance (4), empty without a solution; see model.parts.Compiled."""
    d = slant_range(xhat, numbers.floor)
    if not numbers.near <= d < 1e3:
        return np.zeros(0)
    turning = np.array([payload[0] - payload[3], payload[1] + payload[2]])
    R_WB = rotation_matrix(xhat[3:6])
    v_B = np.array([-d * turning[0], -d * turning[1], times(R_WB.T, xhat[6:9])[2]])
    variance = d**2 * ((numbers.flow_sd / max(payload[4], WORST)) ** 2 + numbers.gyro_sd**2)
    to_W = R_WB[:2, :2]  # V = to_W V_B to_W^T with V_B = variance I + P_zz turning turning^T
    turning_W, v_W = times(to_W, turning), times(R_WB, v_B)
    fix = np.empty(6)
    fix[:2] = v_W[:2]
    for i in range(2):
        for j in range(2):
            own = to_W[i, 0] * to_W[j, 0] + to_W[i, 1] * to_W[j, 1]
            fix[2 + 2 * i + j] = variance * own + P[2, 2] * (turning_W[i] * turning_W[j])
    return fix


COMPILED = Compiled(numbers_of, 5, 4, measured_flow, velocity_over_ground)


def row_sd(scenario: Scenario, room: Room, states: np.ndarray) -> np.ndarray:
    """Return the noise sd of the velocity (n, 2) [m/s] at true states (n, 12), NaN without a measurement."""
    numbers = numbers_of(scenario, room)
    d = slant_ranges(states, numbers.floor)
    quality = quality_at(numbers.far, d)
    with np.errstate(invalid="ignore"):
        sd = d * np.hypot(numbers.flow_sd / quality, numbers.gyro_sd)
    there = (d >= numbers.near) & (quality >= WORST)
    return np.repeat(np.where(there, sd, np.nan)[:, np.newaxis], 2, axis=1)


def limits(scenario: Scenario, room: Room) -> tuple[np.ndarray, np.ndarray]:
    """Return the smallest and the largest payload that a packet may hold (5 each)."""
    settings = scenario.settings_of("flow")
    flow, rate = settings.max_flow + 10.0 * settings.flow_sd / WORST, 1e3
    high = np.array([flow, flow, rate, rate, 1.0])
    return np.array([-flow, -flow, -rate, -rate, 0.0]), high


register_sensor(
    Sensor(
        "flow",
        Flow,
        (row("x_dot_flow", x_dot=1.0), row("y_dot_flow", y_dot=1.0)),
        sd=row_sd,
        limits=limits,
        compiled=COMPILED,
    )
)
