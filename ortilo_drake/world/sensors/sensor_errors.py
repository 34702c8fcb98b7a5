"""The errors that a scenario's `truth` gives each sensor, as slow_error.py and message_error.py take them."""

from typing import NamedTuple

import numpy as np

from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.truth import ImuTruth, SensorTruth, UwbTruth
from ortilo_drake.world.drawn_truth import Drawn
from ortilo_drake.world.slow_error import SlowNoise, gauss_markov, random_walk


class SensorErrors(NamedTuple):
    """Errors of the first n numbers of a payload.

    Attributes:
        noise: what changes slowly (n).
        flagged: whether n flags follow them.
    """

    noise: SlowNoise
    flagged: bool


def errors_of(scenario: Scenario, sensor: str, payload: int) -> SensorErrors | None:
    """Return a sensor's errors; None if it has none, or, as camera and differences of ranges, none of its messages.

    Args:
        scenario: the scenario.
        sensor: its name.
        payload: how many numbers its payload has.
    """
    truth, h = scenario.truth, scenario.h
    its: ImuTruth | UwbTruth | SensorTruth
    if sensor == "imu" and truth.imu != ImuTruth():
        its = truth.imu
        walks = [its.level_walk, its.level_walk, its.yaw_walk, *[its.rates_walk] * 3, *[its.specific_force_walk] * 3]
        return SensorErrors(random_walk(np.array(walks), h), False)
    if sensor == "uwb" and truth.uwb != UwbTruth() and scenario.uwb.kind == "ranges":
        n = payload // 2
        return SensorErrors(gauss_markov(np.full(n, truth.uwb.slow_sd), truth.uwb.slow_time, h), True)
    if sensor in dict(truth.sensors):
        its = dict(truth.sensors)[sensor]
        return SensorErrors(gauss_markov(np.array(its.slow_sd or (0.0,) * payload), its.slow_time, h), False)
    return None


def factor_of(drawn: Drawn, sensor: str, n: int) -> np.ndarray:
    """Return the drawn factors (n) of a sensor's numbers."""
    if sensor == "imu":
        return np.repeat([drawn[f"imu.{name}_factor"] for name in ("angles", "rates", "specific_force")], 3)
    return np.full(n, drawn["uwb.factor"]) if sensor == "uwb" else drawn[f"sensors.{sensor}.factor"]


def bias_of(drawn: Drawn, sensor: str, n: int) -> np.ndarray:
    """Return the drawn biases (n) of a registered sensor's numbers; imu and uwb have theirs themselves, so zeros."""
    return drawn.get(f"sensors.{sensor}.bias", np.zeros(n))
