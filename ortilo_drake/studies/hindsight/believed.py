"""The graph's noise models of the sensors: those of the scenario's tight filter, or else its own filter's."""

import numpy as np

from ortilo_drake.model.white_noise import USUAL_ROOT
from ortilo_drake.scenario import Belief, IntermittentFilter
from ortilo_drake.scenario.tight import InertialNoise, TightFilter, TightRanges


def believed(scenario: Belief) -> TightFilter:
    """Return the noise models of the sensors, as settings of the tight filter.

    For the paper's filter they are its V, walks and biases and its multilateration's noise of ranges. It has none for
    boxes, so these keep the defaults; so do all numbers of a registered estimator. Neither gate nor horizon is read:
    late messages count at their stamps.
    """
    settings = scenario.estimator
    if isinstance(settings, TightFilter):
        return settings
    ranges = TightRanges(noise=scenario.multilateration.noise, bias_sd=scenario.multilateration.bias_sd)
    if not isinstance(settings, IntermittentFilter):
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
