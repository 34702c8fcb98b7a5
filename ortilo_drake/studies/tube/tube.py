"""The tube about the planned path: where the linear theory expects the vehicle under intermittent measurements.

The equations, and what is approximate in them, are in tube_recursion.py; the radius is in disc_radius.py.
"""

from typing import NamedTuple

import numpy as np

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.estimator.intermittent_filter import INTEGRATORS
from ortilo_drake.onboard.estimator.kalman_filter import initial_covariance
from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.loss_chain import loss_parameters
from ortilo_drake.studies.loop.hover_loop import hover_loop
from ortilo_drake.studies.tube.disc_radius import THREE_SIGMA, disc_radii
from ortilo_drake.studies.tube.nominal_flight import NominalFlight, nominal_flight
from ortilo_drake.studies.tube.tube_recursion import propagate


class Tube(NamedTuple):
    """Where the vehicle is expected about r_k.

    Attributes:
        time: t_k [s] (n).
        r: the planned path [m] (n, 3).
        mean: expected deviation of the true position from r_k [m] (n, 3).
        covariance: of that deviation [m^2] (n, 3, 3).
        X: expected covariance of the filter's position error [m^2] (n, 3, 3).
        radius: of the horizontal disc about r_k that the vehicle is outside of with the probability of 3 sigma,
            0.27 % [m] (n).
        height: |mean| and 3 sigma of the vertical deviation [m] (n).
    """

    time: np.ndarray
    r: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray
    X: np.ndarray
    radius: np.ndarray
    height: np.ndarray


def horizontal_and_vertical(mean: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a tube's radius and height (n) from means (n, 3) and covariances (n, 3, 3) of the deviation."""
    plane = np.ascontiguousarray(mean[:, :2]), np.ascontiguousarray(covariance[:, :2, :2])
    return disc_radii(*plane, THREE_SIGMA), np.abs(mean[:, 2]) + 3.0 * np.sqrt(covariance[:, 2, 2])


def predict_tube(scenario: Scenario, nominal: NominalFlight | None = None) -> Tube:
    """Return the tube that the linear theory predicts for a scenario.

    Args:
        scenario: the scenario; its losses, gains and weights count.
        nominal: the nominal flight, if at hand; it depends on anything but the losses and the servo's gains.

    Raises:
        InputError: where the theory has no answer (a servo fed true velocities, messages late at random), no path, or
            no gain.
    """
    nominal = nominal_flight(scenario) if nominal is None else nominal
    mean, covariance, X = deviation(scenario, nominal)
    return Tube(nominal.time, nominal.r, mean, covariance, X, *horizontal_and_vertical(mean, covariance))


def deviation(scenario: Scenario, nominal: NominalFlight) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return mean (n, 3) and covariance (n, 3, 3) of the position's deviation from r_k, and X of the position.

    Where nothing is lost at random, so that the arrivals are those of the nominal flight, X is the filter's own P_k.
    Arguments and errors as in predict_tube.
    """
    if scenario.servo.velocities == "truth":
        raise InputError("servo.velocities: 'truth': the tube is that of a servo fed by the filter, give 'estimate'")
    loop = hover_loop(scenario)
    x_ref, u_ff = nominal.x_ref, nominal.u_ff
    d = x_ref[:-1] @ loop.Phi.T + u_ff[:-1] @ loop.Gamma.T - x_ref[1:]
    d = np.vstack([d, np.zeros((1, d.shape[1]))])
    loss = np.array([loss_parameters(scenario.link_of(s).loss, scenario.h) for s in scenario.measurement.sensors])
    means, covariances, errors = propagate(
        loop.Phi,
        loop.Gamma,
        loop.L,
        loop.W,
        nominal.V,
        nominal.there,
        loss,
        initial_covariance(scenario.estimator),
        d,
        nominal.r,
        np.ascontiguousarray(x_ref[:, :3]),
        INTEGRATORS[loop.integrator],
        tuple(loop.measurement.layout),
    )
    X = errors[:, :3, :3]
    mean = means[:, :3] + x_ref[:, :3] - nominal.r
    return mean, covariances[:, :3, :3] + X, X
