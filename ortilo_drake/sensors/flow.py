"""Optical flow: a small camera that looks down and tells how fast the floor passes, with a gyro of its own.

At distance d along the body's axis the floor passes at (angular rates in B, x forward, y left)

    flow = [-v_x / d + w_y,  -v_y / d - w_x] + s v,   s = flow_sd / quality,   quality = 1 / (1 + (d / far)^2)

with v_B the velocity, w the body rates and v standard normal: the farther the floor, the coarser its texture. It gives
nothing nearer than near, or where the flow is faster than max_flow. Onboard the gyro's rates are taken out and the rest
is scaled by the distance that the estimate tells, d = (z - z_floor) / (cos phi cos theta):

    v_B = -d [flow_x - w_y,  flow_y + w_x],   turned into W by the estimated attitude,

with V from the noise of flow and gyro, and from the estimate's own uncertainty of the distance. That uncertainty is the
filter's own error and not new in every tick, so V treats it as if it were.
"""

from typing import Annotated

import numpy as np
from pydantic import Field

from ortilo_drake.model.equations import body_rates, rotation_matrix
from ortilo_drake.model.measurement import row
from ortilo_drake.model.parts import Sensor, register_sensor
from ortilo_drake.model.room import Room
from ortilo_drake.model.typed_yaml import Positive
from ortilo_drake.onboard.fix_solver import FixSolver
from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.own_parts import SensorSettings
from ortilo_drake.sensors.altimeter import slant_range
from ortilo_drake.world.sensors.state_sensor import StateSensor

WORST = 0.05  # quality below which there is no measurement


class Flow(SensorSettings):
    """An optical-flow sensor; by default of the kind sold for small multirotors, figures ours.

    Attributes:
        link: how its messages reach the vehicle.
        flow_sd: noise of each component at quality 1 [rad/s].
        gyro_sd: noise of its gyro's rates [rad/s].
        far: distance at which the quality is one half [m].
        near: least distance [m].
        max_flow: fastest flow that it can follow [rad/s].
    """

    flow_sd: Positive = 0.02
    gyro_sd: Positive = 0.005
    far: Positive = 4.0
    near: Positive = 0.1
    max_flow: Annotated[float, Field(gt=0.0, le=100.0)] = 7.4


def quality_at(settings: Flow, d: np.ndarray) -> np.ndarray:
    """Return the quality, in (0, 1], at distances d [m]."""
    return np.asarray(1.0 / (1.0 + (d / settings.far) ** 2))


def times(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return A b, summed in order: BLAS leaves other last bits on another processor."""
    return np.asarray((A * b).sum(axis=1))


def flow_of(x: np.ndarray, d: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the flow without noise (2) and the body rates w_x, w_y (2) [rad/s] at state x (12), the floor at d [m]."""
    v_B = times(rotation_matrix(x[3:6]).T, x[6:9])
    w = body_rates(x[3:6], x[9:12])
    return np.array([-v_B[0] / d + w[1], -v_B[1] / d - w[0]]), np.array([w[0], w[1]])


def make_world(scenario: Scenario, room: Room) -> StateSensor:
    """Return the sensor in the world; payload [flow_x, flow_y, w_x, w_y, quality]."""
    settings, floor = scenario.settings_of("flow"), room.interior.min[2]

    def measure(x: np.ndarray, v: np.ndarray, t: float) -> list[float] | None:
        d = float(slant_range(x, floor))
        quality = float(quality_at(settings, np.array(d)))
        if not settings.near <= d < np.inf or quality < WORST:
            return None
        flow, w = flow_of(np.ascontiguousarray(x), d)
        if np.max(np.abs(flow)) > settings.max_flow:
            return None
        flow, w = flow + settings.flow_sd / quality * v[0:2], w + settings.gyro_sd * v[2:4]
        return [*flow.tolist(), *w.tolist(), quality]

    return StateSensor("flow", 5, 4, measure, scenario.seed, scenario.h)


def make_onboard(scenario: Scenario, room: Room) -> FixSolver:
    """Return what turns the flow into the velocity over ground."""
    settings, floor = scenario.settings_of("flow"), room.interior.min[2]

    def solve(payload: np.ndarray, xhat: np.ndarray, P: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        d = float(slant_range(xhat, floor))
        if not settings.near <= d < 1e3:
            return None
        turning = np.array([payload[0] - payload[3], payload[1] + payload[2]])
        R_WB = rotation_matrix(np.ascontiguousarray(xhat[3:6]))
        v_B = np.array([*(-d * turning), times(R_WB.T, xhat[6:9])[2]])
        variance = d**2 * ((settings.flow_sd / max(payload[4], WORST)) ** 2 + settings.gyro_sd**2)
        to_W = R_WB[:2, :2]  # of which V_B = variance I + P_zz turning turning^T takes both sides
        turning_W = times(to_W, turning)
        own = np.array([times(to_W, row) for row in to_W])
        return times(R_WB, v_B)[:2], variance * own + P[2, 2] * np.outer(turning_W, turning_W)

    return FixSolver("flow", 5, 2, solve)


def row_sd(scenario: Scenario, room: Room, states: np.ndarray) -> np.ndarray:
    """Return the noise of the velocity (n, 2) [m/s] at true states (n, 12), NaN where there is none."""
    settings = scenario.settings_of("flow")
    d = slant_range(states, room.interior.min[2])
    quality = quality_at(settings, d)
    with np.errstate(invalid="ignore"):
        sd = d * np.hypot(settings.flow_sd / quality, settings.gyro_sd)
    there = (d >= settings.near) & (quality >= WORST)
    return np.repeat(np.where(there, sd, np.nan)[:, np.newaxis], 2, axis=1)


def limits(scenario: Scenario, room: Room) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and the greatest payload that a packet may hold."""
    settings = scenario.settings_of("flow")
    flow, rate = settings.max_flow + 10.0 * settings.flow_sd / WORST, 1e3
    high = np.array([flow, flow, rate, rate, 1.0])
    return np.array([-flow, -flow, -rate, -rate, 0.0]), high


register_sensor(
    Sensor(
        "flow",
        Flow,
        (row("x_dot_flow", x_dot=1.0), row("y_dot_flow", y_dot=1.0)),
        make_world=make_world,
        make_onboard=make_onboard,
        sd=row_sd,
        limits=limits,
    )
)
