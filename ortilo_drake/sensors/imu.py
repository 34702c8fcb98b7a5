"""The complete description of the imu, which measures attitude, body rates and specific force.

The filter reads body rates and specific force only if its settings say so; only then does their information count.
"""

from collections.abc import Mapping
from functools import lru_cache
from math import radians
from typing import Any, Literal

import numpy as np

from ortilo_drake.loop.element import Box, Values
from ortilo_drake.model.hover import drag_D
from ortilo_drake.model.measurement import IMU, row
from ortilo_drake.model.parts import Sensor
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import IMU_SIZE, N_I, N_U, N_X, N_XBAR, PAYLOAD, STATE_NAMES
from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.model.white_noise import white_variances
from ortilo_drake.onboard.estimator.filter_model import filter_model, filter_of, initial_covariance
from ortilo_drake.onboard.estimator.intermittent_filter import filter_step
from ortilo_drake.scenario import Belief, Imu, Scenario, Truth
from ortilo_drake.sensors.envelope import SIGMAS, envelope_of
from ortilo_drake.sensors.information_rows import GRADIENT, SOURCE, TICK, Information, linear_rows, own_rows, rows_of
from ortilo_drake.sensors.mismatch import Mismatch, of_truth
from ortilo_drake.sensors.unknown_error import Error, one_per_source, spread, walk
from ortilo_drake.world.drawn_truth import AtStart, Drawn, draw_truth, of_seed
from ortilo_drake.world.sensors.ahrs import STREAM as AHRS_STREAM
from ortilo_drake.world.sensors.ahrs import ahrs_box
from ortilo_drake.world.sensors.imu import imu_box
from ortilo_drake.world.sensors.sensor_errors import factor_of
from ortilo_drake.world.sensors.standstill import left_at_rest, zero_at_rest

MISMATCHES = (
    Mismatch(
        "level of the IMU in roll [deg]",
        lambda value: (("truth.imu.level", (radians(value), 0.0)),),
        0.3,
        (0.1, 0.5),
        10.0,
    ),
    Mismatch("yaw of the IMU [deg]", of_truth("imu.yaw", radians(1.0)), 1.0, (2.0,), 64.0),
    Mismatch(
        "gyroscope biased by [mrad/s] about each axis",
        lambda value: (("truth.imu.rates", (1e-3 * value,) * 3),),
        0.3,
        (1.0,),
        100.0,
        of_rates=True,
    ),
)
SETTLED = 300  # number of ticks after which the attitude's covariance no longer changes
_RATES = tuple(row(name, **{name: 1.0}) for name in STATE_NAMES[9:])


def believed_V(scenario: Belief) -> np.ndarray | None:
    """Return the angles' noise covariance in the filter's settings, None for a filter without these settings."""
    its = scenario.linear_filter
    return None if its is None else np.diag(white_variances(its.V.imu, scenario.imu_period))


def angles_sd(scenario: Scenario, room: Room, states: np.ndarray) -> np.ndarray:
    """Return the noise sd of the angles (n, 3) [rad], which is the same at all states."""
    return np.full((len(states), 3), scenario.imu.sds(scenario.imu_period)[0])


@lru_cache(maxsize=16)
def attitude_covariance(scenario: Scenario) -> np.ndarray:
    """Return the filter's covariance of roll, pitch and yaw (3 x 3) [rad^2] with the imu alone, after settling."""
    settings = filter_of(scenario)
    model = filter_model(settings, scenario.vehicle, "estimate", scenario.h, scenario.yaw)
    measurement, every = scenario.measurement, scenario.every("imu")
    belief = np.concatenate((np.zeros(N_XBAR), initial_covariance(settings).ravel()))
    y, delta, V2 = (np.zeros(size) for size in measurement.sizes.values())
    V2[measurement.block_of("imu")] = np.diag(white_variances(settings.V.imu, scenario.h)).ravel()
    u, r, imu = np.zeros(N_U), np.zeros(N_I), measurement.inertial
    for k in range(SETTLED):
        delta[imu] = float("imu" in scenario.sensors and k % every == 0)
        belief = filter_step(belief, y, delta, V2, u, r, model, measurement.layout)
    return np.array(belief[N_XBAR:].reshape(N_XBAR, N_XBAR)[3:6, 3:6])


def specific_force_sd(scenario: Scenario) -> float:
    """Return the noise sd of the mean specific force of a tick, times the mass, as a force [N]."""
    return scenario.vehicle.mass * scenario.imu.sds(scenario.h)[2]


def reads(scenario: Scenario, what: Literal["rates", "force"]) -> bool:
    """Return whether the filter reads the body rates or the specific force, as its settings or its declaration say."""
    its = scenario.linear_filter or scenario.estimator  # the tight filter has no linear filter's settings
    return "imu" in scenario.sensors and getattr(its, what, "none") == "measured"


def rate_rows(scenario: Scenario, seen: np.ndarray) -> np.ndarray:
    """Return the rows of the body rates, to first order the Euler-angle rates, in the ticks marked in `seen`."""
    n = scenario.imu_samples
    sd = np.full((np.count_nonzero(seen), 3), scenario.imu.sds(scenario.h / n)[1])
    return linear_rows(scenario, n, _RATES, seen, sd)


def force_rows(scenario: Scenario, seen: np.ndarray) -> np.ndarray:
    """Return the rows of the specific force: on the lasting force and the force's bias, and through drag on x."""
    ticks = np.repeat(np.flatnonzero(seen), 3)
    axes, of_x = np.arange(len(ticks)) % 3, np.zeros((3, N_X))
    of_x[:, 6:9] = -drag_D(scenario.world.drag, scenario.yaw)
    variance = scenario.world.disturbance.sds(scenario.h)[0] ** 2 + specific_force_sd(scenario) ** 2
    return rows_of(ticks, of_x[axes], np.full(len(ticks), variance), axes)


def leaning(scenario: Scenario) -> np.ndarray:
    """Return M (3 x 3) of an AHRS with the angle error e_{k+1} = a e_k + M (v_{k+1} - v_k); zeros without an AHRS.

    At hover the specific force has the angles [phi + c_y / g, theta - c_x / g], with the acceleration c in the axes of
    the heading, see world/sensors/ahrs.py. c is the mean over the tick; in the world the force of a tick acts here one
    tick later. So e = s + M v and s_{k+1} = a s_k - (1 - a) M v_k.
    """
    if scenario.imu.ahrs is None:
        return np.zeros((3, 3))
    c, s = np.cos(scenario.yaw), np.sin(scenario.yaw)
    lags = -np.expm1(-scenario.h / scenario.imu.ahrs.time)
    return lags / (GRAVITY * scenario.h) * np.array([[-s, c, 0.0], [-c, -s, 0.0], [0.0, 0.0, 0.0]])


def information(scenario: Scenario, room: Room, truth: np.ndarray, seen: np.ndarray) -> Information:
    """Return the information of the angles, and of the 'rates' and the specific 'force' that the filter reads.

    The tilt of an attitude filter due to acceleration counts with the filter's own errors, the force with its lasting
    part.
    """
    rows = {"imu": own_rows(SENSOR, scenario, room, truth, seen)}
    angles = rows["imu"].copy()
    angles[:, GRADIENT][:, 6:9] += leaning(scenario)[angles[:, SOURCE].astype(int)]
    with_errors = {"imu": angles}
    if reads(scenario, "rates"):
        rows["rates"] = rate_rows(scenario, seen)
    if reads(scenario, "force"):
        with_errors["force"] = force_rows(scenario, seen)
    return Information(rows, with_errors=with_errors)


def inertial_biases(scenario: Scenario) -> tuple[np.ndarray, np.ndarray]:
    """Return the sds of the biases of body rates and specific force (3 each), after zeroing if the vehicle rested."""
    if scenario.samples_at_rest:
        return left_at_rest(scenario)
    imu = scenario.truth.imu
    return spread(imu.rates, imu.rates_sd), spread(imu.specific_force, imu.specific_force_sd)


def of_ahrs(scenario: Scenario) -> list[Error]:
    """Return the errors of an AHRS: s of `leaning`, with yaw 0, and the drift rate of the yaw."""
    ahrs, h = scenario.imu.ahrs, scenario.h
    if ahrs is None:
        return []
    keeps = np.full(3, np.exp(-h / ahrs.time))
    by_x = np.zeros((N_X, 3))
    by_x[6:9] = -((1.0 - keeps) * leaning(scenario).T)
    leans = walk(np.zeros(3), 0.0, {"imu": one_per_source(3)})._replace(keeps=keeps, by_x=by_x)
    drift = walk(np.array([ahrs.drift_sd]), 0.0, {"imu": lambda rows: h * rows[:, [TICK]] * (rows[:, [SOURCE]] == 2.0)})
    return [leans, drift]


def unknown(scenario: Scenario, room: Room) -> list[Error]:
    """Return the unknown errors of angles and body rates; floor/unknown_errors.py has those of the specific force."""
    imu, h = scenario.truth.imu, scenario.h
    angles = np.array([*spread(imu.level, imu.level_sd, number=2), np.hypot(imu.yaw, imu.yaw_sd)])
    walks = np.array([imu.level_walk, imu.level_walk, imu.yaw_walk]) * np.sqrt(h)
    return [
        walk(angles, walks, {"imu": one_per_source(3)}),
        walk(inertial_biases(scenario)[0], imu.rates_walk * np.sqrt(h), {"rates": one_per_source(3)}),
        *of_ahrs(scenario),
    ]


def element(scenario: Scenario, room: Room, whole: bool) -> Box:
    """Return the box of the imu."""
    return imu_box(scenario.imu, scenario.h, whole, scenario.imu_samples, instants=scenario.instants)


def bias_of(its: Drawn) -> np.ndarray:
    """Return the drawn biases of angles, body rates and specific force (9)."""
    return np.array([*its["imu.level"], its["imu.yaw"], *its["imu.rates"], *its["imu.specific_force"]])


def drawn(scenario: Scenario, room: Room, its: Drawn, boxes: Mapping[str, Box]) -> dict[str, Values]:
    """Return the true errors of the imu's messages as values of the imu's box."""
    return {"imu": Values(tables={"bias": bias_of(its)})}


def errors_drawn(its: Drawn) -> tuple[np.ndarray, np.ndarray]:
    """Return the biases and the factors of angles, rates and specific force (9 each); 0 and 1 for empty draws {}."""
    return (bias_of(its), factor_of(its, "imu", 9)) if its else (np.zeros(9), np.ones(9))


def zeroed(scenario: Scenario, its: Drawn, draw: AtStart) -> dict[str, Values]:
    """Return the imu's values after it was zeroed at rest: the subtracted means reduce the biases."""
    if scenario.samples_at_rest == 0:
        return {}
    bias, factor = errors_drawn(its)
    bias[3:] -= zero_at_rest(scenario, bias, factor, draw) / factor[3:]
    return {"imu": Values(tables={"bias": bias})}


def ahrs_drawn(scenario: Scenario, draw: AtStart) -> dict[str, Values]:
    """Return the drawn drift rate of the attitude filter's yaw."""
    if scenario.imu.ahrs is None:
        return {}
    return {"imu_ahrs": Values({"drift": scenario.imu.ahrs.drift_sd * float(draw(AHRS_STREAM, 1)[0])})}


def attitude_filter(scenario: Scenario, room: Room, message: Box, samples: int) -> Box | None:
    """Return the box of the attitude filter after the imu, None if the imu gives the angles of the body itself."""
    return None if scenario.imu.ahrs is None else ahrs_box(scenario.imu.ahrs, message, samples, scenario.h)


def standstill_of(scenario: Scenario, room: Room) -> dict[str, Any]:
    """Return the standstill of the scenario and its seed: duration, samples and measured means; {} without one."""
    if scenario.samples_at_rest == 0:
        return {}
    draw = of_seed(scenario.seed)
    its = draw_truth(scenario.truth, draw, room, {"imu": IMU_SIZE - PAYLOAD}) if scenario.truth != Truth() else {}
    zero = zero_at_rest(scenario, *errors_drawn(its), draw).tolist()
    how = {"seconds": scenario.imu.standstill, "samples": scenario.samples_at_rest}
    return how | {"rates": zero[:3], "specific_force": zero[3:]}


def members(scenario: Belief, payload: int) -> tuple[tuple[str, str], ...]:
    """Return the payload's members in C; () for a message of several samples."""
    if payload != IMU_SIZE - PAYLOAD:
        return ()
    return (
        ("double angles[3];", "roll, pitch, yaw [rad]: R_WB = R_z R_y R_x, W east, north, up, B forward, left, up"),
        ("double rates[3];", "w_WB_B [rad/s]"),
        ("double force[3];", "specific force f_B [m/s^2]: [0, 0, 9.81] at rest"),
    )


def limits(scenario: Scenario, room: Room) -> tuple[np.ndarray, np.ndarray]:
    """Return the smallest and the largest angles, rates and specific force (9 each)."""
    its, turned = envelope_of(scenario, room), 0.0 if scenario.imu.ahrs is None else np.pi
    angle_sd, rate_sd, force_sd = scenario.imu.sds(scenario.imu_period)
    rates, force = 2.0 * its.rate + SIGMAS * rate_sd, its.force + SIGMAS * force_sd
    most = np.concatenate((its.angles + SIGMAS * angle_sd + turned, rates * np.ones(3), force * np.ones(3)))
    return -most, most


SENSOR = Sensor(
    "imu",
    Imu,
    IMU,
    sd=angles_sd,
    payload=IMU_SIZE - PAYLOAD,
    members=members,
    limits=limits,
    V=believed_V,
    information=information,
    unknown=unknown,
    left_out=lambda scenario: ({"imu.ahrs": scenario.imu.ahrs is not None}, {}),
    mismatches=MISMATCHES,
    element=element,
    after_sensor=attitude_filter,
    drawn=drawn,
    needs_forces=True,
    is_wired=True,
    title="IMU",
    components="φθψ",
)
