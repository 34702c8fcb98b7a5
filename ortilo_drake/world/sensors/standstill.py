"""The zeroing of gyroscope and accelerometer while the vehicle rests on the floor before take-off.

The averages of N samples in T seconds, at rest and level, with factors c, are

    rpy_0 = c_rpy ([0, 0, psi] + b_rpy + nu_rpy),   w_0 = c_w (b_w + nu_w),   f_0 = c_f (g e_z + b_f + nu_f)

where nu has the variance s^2 / N + q^2 T / 3: s is the noise of a sample, and b the bias at take-off, from which the
mean of a random walk of rate q differs by sd q sqrt(T / 3). In flight w_0 and f_0 - R(rpy_0)^T g e_z are subtracted.
"""

import numpy as np

from ortilo_drake.model.equations import rotation_rows
from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.scenario import Scenario
from ortilo_drake.world.drawn_truth import AtStart


def variances_at_rest(scenario: Scenario) -> np.ndarray:
    """Return the variances of nu for angles, rates and specific force (9), for a scenario with a standstill."""
    imu, walks = scenario.imu, scenario.truth.imu
    s = np.repeat(imu.sds(scenario.imu_period), 3)
    q = np.array([walks.level_walk] * 2 + [walks.yaw_walk] + [walks.rates_walk] * 3 + [walks.specific_force_walk] * 3)
    return np.asarray(s**2 / scenario.samples_at_rest + q**2 * imu.standstill / 3.0)


def left_at_rest(scenario: Scenario) -> tuple[np.ndarray, np.ndarray]:
    """Return the sds of the biases that zeroing leaves in rates and specific force (3 each), with b_rpy known.

    They are the sds of nu_w, and of nu_f less gravity rotated by nu_rpy.
    """
    rpy, rates, forces = np.split(variances_at_rest(scenario), 3)
    return np.sqrt(rates), np.sqrt(forces + GRAVITY**2 * np.array([rpy[1], rpy[0], 0.0]))


def zero_at_rest(scenario: Scenario, bias: np.ndarray, factor: np.ndarray, draw: AtStart) -> np.ndarray:
    """Return the offsets that zeroing subtracts from the body rates [rad/s] and the specific force [m/s^2] (6).

    Bias b and factor c are of angles, rates and specific force (9 each); the scenario has a standstill.
    """
    nu = np.sqrt(variances_at_rest(scenario)) * draw("standstill", 9)
    at_rest = np.array([0.0] * 8 + [GRAVITY])
    said = factor * (at_rest + bias + nu)
    return said[3:] - np.concatenate((np.zeros(3), GRAVITY * np.array(rotation_rows(said[:3])[2])))
