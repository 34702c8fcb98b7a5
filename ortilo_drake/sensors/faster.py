"""The description of a sensor faster than the tick, for the filter: the mean of the samples in each tick.

The n samples of a tick are taken at t_k - h + h / n, ..., t_k. Their mean measures the state (n - 1) h / (2 n) ago, to
first order in the state's change over a tick, with 1 / n of one sample's noise covariance. The rows of C include this
age (model/measurement.py, seen_earlier), so filter, gates, theory bench and tube know it; nothing is corrected with the
estimate. A solver gets the mean payload. A covariance that comes with a fix is divided by n as a whole. But the part
due to the filter's own error is common to all samples, so this covariance is too small. An integrator of measured
positions does not use a mean over the tick.
"""

from dataclasses import replace

import numpy as np

from ortilo_drake.model.parts import Sensor
from ortilo_drake.model.room import Room
from ortilo_drake.scenario import Belief


def with_samples(sensor: Sensor, n: int) -> Sensor:
    """Return the description of a sensor that sends n samples per tick, given the description of a single sample.

    Rows, limits, messages and solvers stay those of a sample: Scenario.measurement has the rows with their age, and
    onboard/sample_mean.py makes the mean.
    """

    def V(scenario: Belief) -> np.ndarray | None:
        of_one = sensor.V(scenario)
        return None if of_one is None else of_one / n

    def covariance(scenario: Belief, room: Room, x: np.ndarray) -> np.ndarray | None:
        of_one = None if sensor.covariance is None else sensor.covariance(scenario, room, x)
        return None if of_one is None else of_one / n

    def sd(scenario: Belief, room: Room, states: np.ndarray) -> np.ndarray:
        assert sensor.sd is not None
        return np.asarray(sensor.sd(scenario, room, states) / np.sqrt(n))

    return replace(
        sensor,
        V=V,
        sd=None if sensor.sd is None else sd,
        covariance=None if sensor.covariance is None else covariance,
    )
