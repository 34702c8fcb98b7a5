"""Warnings about a flight before it is flown: settings that are allowed, but hardly what the user meant.

Some warn that disturbance, filter and servo, tuned for the M100, do not fit another vehicle. Under the servo's gain L
the state [x; i] about hover obeys x_{k+1} = (Phibar - Gammabar L) x_k + Gamma_d d_k, whose stationary covariance is
that of a discrete Lyapunov equation. The estimate's error comes on top. The M100's tilt has a standard deviation of
0.004 rad; no vehicle that its own disturbance tilts by more than MOST_TILT was seen to fly on.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.linalg import block_diag, solve_discrete_lyapunov

from ortilo_drake.flight.late import late_messages
from ortilo_drake.model.hover import discretize, hover_A, hover_B_d
from ortilo_drake.model.signals import N_I
from ortilo_drake.model.vehicle import M100, mixing_inverse
from ortilo_drake.model.vehicle_units import vehicle_units
from ortilo_drake.onboard.servo.lq_gain import augmented_pair, servo_gain
from ortilo_drake.scenario import Disturbance, DisturbanceW, LqServo, Scenario
from ortilo_drake.scenario.load import Setting
from ortilo_drake.scenario.unread import unread_settings
from ortilo_drake.sensors.uwb_theory import believed_noise
from ortilo_drake.studies.cautions.lagging import digits, lagging


def cautions(scenario: Scenario, name_or_file: str | Path | None = None, settings: Sequence[Setting] = ()) -> list[str]:
    """Return a line for each warning, beginning with the setting; none for a usual scenario.

    Settings that are given but not read are among them: those of name_or_file, of which the scenario was made (None
    leaves this check out), and `settings` laid over it.
    """
    unread = [] if name_or_file is None else unread_settings(scenario, name_or_file, settings)
    vehicle = vehicle_units(scenario.vehicle) or vehicle_fit(scenario)  # for a wrong vehicle other checks say nothing
    return unread + believed_noise(scenario) + late_messages(scenario) + vehicle


MOST_TILT = 0.1  # [rad]
_SIGMAS = 3.0
_PARTS = {"force_density": lambda vehicle: vehicle.mass, "torque_density": lambda vehicle: vehicle.inertia[0]}


def vehicle_fit(scenario: Scenario) -> list[str]:
    """Return a line for each setting that does not fit the vehicle: its name, its effect, and a better value."""
    if not isinstance(scenario.servo, LqServo):
        return []
    shaken = found = _disturbed(scenario, "world.disturbance", scenario.world.disturbance)
    W, force = getattr(scenario.estimator, "W", None), getattr(scenario.estimator, "force", "none")
    if isinstance(W, DisturbanceW) and force == "none":
        believed = Disturbance(force_density=W.force_density, torque_density=W.torque_density)
        found = found + _disturbed(scenario, "estimator.W", believed)
    if scenario.world.rotors.kind == "first_order":
        lag = [] if found else lagging(scenario)  # with a wrong W the lag check would say little
        found = found + lag + ([] if shaken else _saturated(scenario))
    return found


def stationary(scenario: Scenario, disturbance: Disturbance) -> tuple[np.ndarray, np.ndarray]:
    """Return the covariances of [x; i] (15 x 15) and of the control (4 x 4) under a disturbance, for a known state."""
    vehicle, h, yaw = scenario.vehicle, scenario.h, scenario.yaw
    Phibar, Gammabar = augmented_pair(vehicle, h, yaw)
    L = servo_gain(vehicle, scenario.servo.weights, h, yaw)
    _, Gamma_d = discretize(hover_A(yaw), hover_B_d(vehicle), h)
    sd = np.repeat(disturbance.sds(h), 3)
    W = block_diag(Gamma_d @ np.diag(sd**2) @ Gamma_d.T, np.zeros((N_I, N_I)))
    X = solve_discrete_lyapunov(Phibar - Gammabar @ L, W)
    return X, L @ X @ L.T


def tilt_sd(scenario: Scenario, disturbance: Disturbance) -> float:
    """Return the standard deviation of roll or pitch [rad], the larger one."""
    X, _ = stationary(scenario, disturbance)
    return float(np.sqrt(max(X[3, 3], X[4, 4])))


def _disturbed(scenario: Scenario, field: str, disturbance: Disturbance) -> list[str]:
    """Return a line if a disturbance, or the one that the filter assumes, is too much for the vehicle."""
    tilt = tilt_sd(scenario, disturbance)
    if tilt <= MOST_TILT:
        return []
    force, torque = disturbance.sds(scenario.h)
    share = force / scenario.vehicle.hover_thrust
    now = {name: float(getattr(disturbance, name)) for name in _PARTS}
    less = {name: min(now[name], now[name] * of(scenario.vehicle) / of(M100)) for name, of in _PARTS.items()}
    while tilt_sd(scenario, Disturbance(**less)) > MOST_TILT:
        less = {name: density / 2.0 for name, density in less.items()}
    mend = " ".join(f"--set {field}.{name}={digits(its)}" for name, its in less.items() if its < now[name])
    what = "would tilt" if field.startswith("world") else "is what the filter assumes: it would tilt"
    return [
        f"{field}: a force of {force:.3g} N, {share:.0%} of the weight, and a torque of "
        f"{torque:.3g} N m in every tick {what} this vehicle by {np.degrees(tilt):.0f} degrees (sd), it "
        f"will hardly fly; with these it does: {mend}"
    ]


def _saturated(scenario: Scenario) -> list[str]:
    """Return a line if the disturbance alone asks rotors for more speed than they have."""
    vehicle = scenario.vehicle
    M_inverse, hover = mixing_inverse(vehicle), vehicle.hover_rotor_speeds**2
    _, U = stationary(scenario, scenario.world.disturbance)
    sd = np.sqrt(np.diag(M_inverse @ U @ M_inverse.T))
    asked = hover + _SIGMAS * sd
    if np.all(asked <= vehicle.rotor_max_speed**2):
        return []
    return [
        f"vehicle.rotor_max_speed: {vehicle.rotor_max_speed:g} rad/s lifts {vehicle.largest_thrust:.3g} N, the "
        f"weight is {vehicle.hover_thrust:.3g} N: against the disturbance rotors are asked for "
        f"{np.sqrt(asked.max()):.4g} rad/s"
    ]
