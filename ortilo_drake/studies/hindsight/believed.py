"""The graph's noise models of the sensors: those of the scenario's tight filter, or else its own filter's."""

import numpy as np

from ortilo_drake.model.white_noise import USUAL_ROOT
from ortilo_drake.scenario import Belief
from ortilo_drake.scenario.tight import InertialNoise, TightFilter, TightRanges


def believed(scenario: Belief) -> TightFilter:
    """Return the noise models of the sensors, as settings of the tight filter.

    Of a scenario that flies the paper's filter, or an estimator that declares which one it is, they are that filter's
    V, walks and biases and what its multilateration believes of ranges; of boxes it says nothing, and the defaults
    stand. So it is of another estimator, of which nothing else is known either. Neither gate nor horizon is read: late
    messages count at their stamps.
    """
    if isinstance(scenario.estimator, TightFilter):
        return scenario.estimator
    settings = scenario.linear_filter
    ranges = TightRanges(noise=scenario.multilateration.noise, bias_sd=scenario.multilateration.bias_sd)
    if settings is None:
        return TightFilter(kind="tight", ranges=ranges)
    V, walks, biases = settings.V, settings.walks, settings.biases
    imu = InertialNoise(
        rate_density=_density(V.rates),
        specific_force_density=_density(V.specific_force),
        angle_density=_density(V.imu),
        gyroscope_sd=walks.gyroscope_sd,
        gyroscope_rate=walks.gyroscope_rate,
        accelerometer_sd=walks.accelerometer_sd,
        accelerometer_rate=walks.accelerometer_rate,
        level_sd=biases.level_sd,
        yaw_sd=biases.yaw_sd,
    )
    return TightFilter(kind="tight", imu=imu, ranges=ranges, initial_sd=settings.initial_sd[:3])


def _density(variances: tuple[float, float, float]) -> float:
    """Return the density that three axes have on average, of the variances of a sample of the usual period."""
    return float(np.sqrt(np.mean(variances))) * USUAL_ROOT
