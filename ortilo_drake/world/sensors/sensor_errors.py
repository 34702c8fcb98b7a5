"""The errors that a scenario's `truth` gives each sensor's payload: a bias, a slow part, and a factor on the sum."""

from typing import Any, NamedTuple

import numpy as np

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.placing import put, sample_of
from ortilo_drake.model.signals import ARRIVED, PAYLOAD
from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.truth import ImuTruth, SensorTruth, UwbTruth
from ortilo_drake.world.drawn_truth import Drawn
from ortilo_drake.world.noise import SlowNoise, gauss_markov, random_walk, slow_step, stream_id


class SensorErrors(NamedTuple):
    """Errors of the first n numbers of a payload."""

    noise: SlowNoise
    """the slowly changing part (n)."""
    flagged: bool
    """whether n flags follow these numbers."""


def errors_of(scenario: Scenario, sensor: str, payload: int) -> SensorErrors | None:
    """Return the lasting errors of a sensor's payload of this size, or None.

    None is for a sensor without errors, and for camera and range differences, whose errors are applied elsewhere.
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
    """Return the drawn biases (n) of a registered sensor's numbers; zeros for imu and uwb, which add their own."""
    return drawn.get(f"sensors.{sensor}.bias", np.zeros(n))


def errors_out(
    n: Any, message: np.ndarray, x: np.ndarray, bias: np.ndarray, factor: np.ndarray, out: np.ndarray
) -> None:
    """Output a message with c_j (y_j + b_j + x_j) in place of the first numbers y_j of each sample that has arrived.

    If they are flagged, as many flags follow them, as in the uwb message: a missing number is left as it is, and the
    others, which are distances, are at least 0.
    """
    put(message, out)
    for i in range(n.samples):
        sample = sample_of(out, i, n.samples)
        if sample[ARRIVED] == 0.0:
            continue
        for j in range(factor.size):
            there = not n.flagged or sample[PAYLOAD + factor.size + j] != 0.0
            if there:
                sample[PAYLOAD + j] = factor[j] * (sample[PAYLOAD + j] + (bias[j] + x[j]))
            if there and n.flagged and sample[PAYLOAD + j] < 0.0:
                sample[PAYLOAD + j] = 0.0 * sample[PAYLOAD + j]


ERRORS = Element("message_errors", out=errors_out, step=slow_step, allocates=True)


def errors_box(sensor: str, message: Box, errors: SensorErrors, samples: int, h: float) -> Box:
    """Return the box that adds lasting errors to a sensor's messages of `samples` samples; zero unless drawn."""
    noise, nothing = errors.noise, np.zeros(len(errors.noise.a))
    numbers = {
        "samples": samples,
        "flagged": errors.flagged,
        "stream": stream_id(f"slow error/{sensor}_slow_error"),
        "h": h,
    }
    tables = {"bias": nothing, "factor": np.ones(len(nothing)), "a": noise.a, "q": noise.q}
    given = Values(numbers, start={"x": nothing}, tables=tables)
    return Box(f"{sensor}_error", ERRORS, message.size, given, reads={"message": message.name})
