"""Warn where disturbance, filter and servo, tuned for the M100, do not fit another vehicle.

Under the servo's gain L the state [x; i] about hover obeys x_{k+1} = (Phibar - Gammabar L) x_k + Gamma_d d_k, whose
stationary covariance is that of a discrete Lyapunov equation. The estimate's error comes on top. The M100 is tilted by
0.004 rad, standard deviation; of vehicles that are tilted by more than MOST_TILT by their own disturbance none was seen
to fly on.
"""

import numpy as np
from scipy.linalg import block_diag, expm, solve_discrete_lyapunov

from ortilo_drake.model.hover import discretize, hover_A, hover_B, hover_B_d
from ortilo_drake.model.signals import N_I, N_U, N_X, N_XBAR
from ortilo_drake.model.vehicle import M100, mixing_inverse
from ortilo_drake.onboard.servo.lq_gain import augmented_pair, servo_gain
from ortilo_drake.scenario import Disturbance, DisturbanceW, LqServo, Scenario, ServoWeights

MOST_TILT = 0.1  # [rad]
LAG_MARGIN = 1.5  # the lag's torque is no white noise
_SIGMAS = 3.0
_SOFTER = (10.0, 100.0, 1e3, 1e4, 1e5)  # factors on the weights of the control that are tried against a lag
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
        found = found + _lagging(scenario) + ([] if shaken else _saturated(scenario))
    return found


def stationary(scenario: Scenario, disturbance: Disturbance) -> tuple[np.ndarray, np.ndarray]:
    """Return the covariances of [x; i] (15 x 15) and of the control (4 x 4) under a disturbance, the state known."""
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
    """Return a line if a disturbance, or what the filter believes of it, is too much for the vehicle."""
    tilt = tilt_sd(scenario, disturbance)
    if tilt <= MOST_TILT:
        return []
    force, torque = disturbance.sds(scenario.h)
    share = force / scenario.vehicle.hover_thrust
    now = {name: float(getattr(disturbance, name)) for name in _PARTS}
    less = {name: min(now[name], now[name] * of(scenario.vehicle) / of(M100)) for name, of in _PARTS.items()}
    while tilt_sd(scenario, Disturbance(**less)) > MOST_TILT:
        less = {name: density / 2.0 for name, density in less.items()}
    mend = " ".join(f"--set {field}.{name}={_number(its)}" for name, its in less.items() if its < now[name])
    what = "would tilt" if field.startswith("world") else "is what the filter assumes: it would tilt"
    return [
        f"{field}: a force of {force:.3g} N, {share:.0%} of the weight, and a torque of "
        f"{torque:.3g} N m in every tick {what} this vehicle by {np.degrees(tilt):.0f} degrees (sd), it "
        f"will hardly fly; with these it does: {mend}"
    ]


def _lagged(scenario: Scenario, weights: ServoWeights, tau: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the servo's loop where the wrench y lags the control by tau [s], first order.

    The loop is [x; y; i]_{k+1} = Phi [x; y; i]_k, and the control u_k = -K [x; y; i]_k.
    """
    vehicle, h, yaw = scenario.vehicle, scenario.h, scenario.yaw
    A, B = np.zeros((N_X + N_U, N_X + N_U)), np.zeros((N_X + N_U, N_U))
    A[:N_X, :N_X], A[:N_X, N_X:] = hover_A(yaw), hover_B(vehicle)
    A[N_X:, N_X:], B[N_X:] = -np.eye(N_U) / tau, np.eye(N_U) / tau
    n = len(A)
    held = expm(h * np.block([[A, B], [np.zeros((N_U, n + N_U))]]))
    Phi = np.eye(n + N_I)
    Phi[:n, :n], Phi[n:, :N_I] = held[:n, :n], -np.eye(N_I)
    L = servo_gain(vehicle, weights, h, yaw)
    K = np.hstack([L[:, :N_X], np.zeros((N_U, N_U)), L[:, N_X:N_XBAR]])
    Phi[:n] -= held[:n, n:] @ K
    return Phi, K


def _radius(scenario: Scenario, weights: ServoWeights, tau: float) -> float:
    """Return the spectral radius of the servo's loop with lag."""
    Phi, _ = _lagged(scenario, weights, tau)
    return float(np.abs(np.linalg.eigvals(Phi)).max())


def lag_torque_sd(scenario: Scenario) -> float:
    """Return the sd of the torque about x or y, the larger, that lagging rotors leave out in a tick, on average [N m].

    In the linear loop under the world's disturbance. After a command u the wrench y follows as u - y falls by
    e^(-t / tau), so its mean over a tick is short of u by (u - y) (1 - e^(-h / tau)) tau / h. It is infinite where the
    loop is unstable.
    """
    tau, h = float(np.mean(scenario.vehicle.rotor_time_constant)), scenario.h
    Phi, K = _lagged(scenario, scenario.servo.weights, tau)
    if np.abs(np.linalg.eigvals(Phi)).max() >= 1.0:
        return float("inf")
    _, Gamma_d = discretize(hover_A(scenario.yaw), hover_B_d(scenario.vehicle), h)
    Gamma_d = np.vstack([Gamma_d, np.zeros((N_U + N_I, Gamma_d.shape[1]))])
    X = solve_discrete_lyapunov(
        Phi, Gamma_d @ np.diag(np.repeat(scenario.world.disturbance.sds(h), 3) ** 2) @ Gamma_d.T
    )
    short = K + np.eye(len(Phi))[N_X : N_X + N_U]  # times [x; y; i] it is y - u
    variances = np.diag(short @ X @ short.T)[1:3]
    return float(np.sqrt(variances.max()) * tau / h * -np.expm1(-h / tau))


def filter_for_lag(scenario: Scenario) -> str | None:
    """Return a line with an estimator.W.torque_density that covers the rotors' lag, if there is one to cover.

    It is LAG_MARGIN times the root sum square of the disturbance's torque and the lag's. With it the true angles and
    rates of eight vehicles were within 3 sigma 97 to 100 % of the time (docs/how_to/own_vehicle.md).
    """
    world, estimator = scenario.world, scenario.estimator
    W = getattr(estimator, "W", None)
    if not isinstance(W, DisturbanceW) or getattr(estimator, "force", "none") != "none":
        return None
    if world.rotors.kind != "first_order" or not isinstance(scenario.servo, LqServo):
        return None
    lag = lag_torque_sd(scenario) * np.sqrt(scenario.h)
    if not np.isfinite(lag):
        return None
    fits = _number(LAG_MARGIN * float(np.hypot(world.disturbance.torque_density, lag)))
    return f"for rotors that lag so, estimator.W.torque_density={fits} fits; here it is {_number(W.torque_density)}"


def _lagging(scenario: Scenario) -> list[str]:
    """Return a line if the rotors' lag, which the servo does not know, makes its loop unstable."""
    weights, tau = scenario.servo.weights, max(scenario.vehicle.rotor_time_constant)
    radius = _radius(scenario, weights, tau)
    if radius < 1.0:
        return []
    for factor in _SOFTER:
        softer = weights.model_copy(update={"control": tuple(factor * weight for weight in weights.control)})
        if _radius(scenario, softer, tau) < 1.0:
            control = ", ".join(f"{weight:g}" for weight in softer.control)
            mend = f": --set servo.weights.control=[{control}] makes it stable"
            break
    else:
        mend = ": no softer servo is stable"
    return [
        f"vehicle.rotor_time_constant: rotors that lag by {tau:g} s make the servo's loop unstable, spectral radius "
        f"{radius:.3f}{mend}"
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


def _number(value: float) -> str:
    """Return a number of two digits as YAML takes it: with a point where it has an exponent."""
    text = f"{value:.2g}"
    return text.replace("e", ".0e") if "e" in text and "." not in text else text
