"""The tube about the planned path: where the linear theory expects the vehicle under intermittent measurements.

The equations, and what is approximate in them, are in tube_recursion.py; the radius is in disc_radius.py.
"""

import math
import os
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from ortilo_drake.model.signals import N_X
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.estimator.filter_model import filter_of, initial_covariance
from ortilo_drake.onboard.estimator.intermittent_filter import INTEGRATORS
from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.loss_chain import loss_parameters
from ortilo_drake.studies.loop.hover_loop import hover_loop
from ortilo_drake.studies.tube.disc_radius import THREE_SIGMA, disc_radii
from ortilo_drake.studies.tube.nominal_flight import NominalFlight, nominal_flight
from ortilo_drake.studies.tube.tube_recursion import propagate

AT_ONCE = 50  # cases side by side; more do not fit into a processor's nearer memory


class Tube(NamedTuple):
    """The predicted deviation of the vehicle from the planned path r_k [m] (n, 3) at t_k [s] (n).

    Attributes:
        mean: expected deviation of the true position from r_k [m] (n, 3).
        covariance: of that deviation [m^2] (n, 3, 3).
        X: expected covariance of the filter's position error [m^2] (n, 3, 3).
        radius: of the horizontal disc about r_k that the vehicle is outside of with 0.27 %, as of 3 sigma [m] (n).
        height: |mean| and 3 sigma of the vertical deviation [m] (n).
    """

    time: np.ndarray
    r: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray
    X: np.ndarray
    radius: np.ndarray
    height: np.ndarray


def tube_height(mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return |mean| and 3 sigma (...) of the vertical deviation, from means (..., 3) and covariances (..., 3, 3)."""
    return np.asarray(np.abs(mean[..., 2]) + 3.0 * np.sqrt(covariance[..., 2, 2]))


def predict_tube(scenario: Scenario, nominal: NominalFlight | None = None) -> Tube:
    """Return the tube that the linear theory predicts for a scenario.

    Its nominal flight, if at hand, depends on all but the losses and the servo's gains. InputError where the theory has
    no answer (a servo fed true velocities, messages late at random), or there is no path or no gain.
    """
    nominal = nominal_flight(scenario) if nominal is None else nominal
    mean, covariance, X = (part[0] for part in deviations(scenario, nominal, losses_of(scenario)[None]))
    radius = disc_radii(np.ascontiguousarray(mean[:, :2]), np.ascontiguousarray(covariance[:, :2, :2]), THREE_SIGMA)
    return Tube(nominal.time, nominal.r, mean, covariance, X, radius, tube_height(mean, covariance))


def losses_of(scenario: Scenario) -> np.ndarray:
    """Return the parameters of the losses on the links of the sensors (s, 4), see loss_parameters."""
    return np.array([loss_parameters(scenario.link_of(s).loss, scenario.h) for s in scenario.measurement.sensors])


def deviations(
    scenario: Scenario, nominal: NominalFlight, losses: np.ndarray, there: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return mean (B, n, 3) and covariance (B, n, 3, 3) of the position's deviation from r_k, and X of the position.

    Where nothing is lost at random, so that the arrivals are those that are there, X is the filter's own P_k. Cases go
    through the recursion side by side, and some of them on each of the machine's cores.

    The losses are of the links in each case (B, s, 4), see losses_of, in place of the scenario's own; `there` says
    whether a message can arrive in each case (B, n, s), by default as in the nominal flight. InputError as
    predict_tube.
    """
    if scenario.lends_velocities:
        raise InputError("servo.velocities: 'truth': the tube is that of a servo fed by the filter, give 'estimate'")
    loop = hover_loop(scenario)
    if len(loop.names) != N_X:
        force = filter_of(scenario).force
        raise InputError(f"estimator.force: {force}: must be none: the tube is the paper's filter's")
    x_ref, u_ff = nominal.x_ref, nominal.u_ff
    d = x_ref[:-1] @ loop.Phi.T + u_ff[:-1] @ loop.Gamma.T - x_ref[1:]
    d = np.vstack([d, np.zeros((1, d.shape[1]))])
    layout = tuple(loop.measurement.layout)
    r_servo, X_0 = np.ascontiguousarray(x_ref[:, :3]), initial_covariance(filter_of(scenario))
    there = np.broadcast_to(nominal.there, (len(losses), *nominal.there.shape)) if there is None else there

    def some(cases: slice) -> tuple[np.ndarray, ...]:
        # Copies, never read-only: numba would compile the recursion once more for arrays that cannot be written.
        arrives, loss = (np.array(np.moveaxis(part[cases], 0, -1), order="C") for part in (there, losses))
        found = propagate(
            loop.Phi, loop.Gamma, loop.L, loop.W, nominal.V, arrives, loss, X_0, d, nominal.r, r_servo,
            INTEGRATORS[loop.integrator], layout, 3,
        )  # fmt: skip
        return tuple(np.ascontiguousarray(np.moveaxis(part, -1, 0)) for part in found)

    with ThreadPoolExecutor(os.cpu_count()) as threads:  # the recursion runs without the interpreter's lock
        ends = np.linspace(0, len(losses), math.ceil(len(losses) / AT_ONCE) + 1).astype(int)
        parts = list(threads.map(some, map(slice, ends[:-1], ends[1:])))
    means, covariances, X = (np.concatenate(part) for part in zip(*parts, strict=True))
    return means + (x_ref[:, :3] - nominal.r), covariances + X, X
