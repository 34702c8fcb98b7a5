"""Warn of a rotor lag that neither servo nor filter models, and name the settings that fit it.

The loop is the linear one that flies: hover model, rotors with one lag, servo, and the filter with its steady gains.
The filter matters: without the gyroscope, a larger W that covers the lag leaves the loop less margin. The lag is the
mean of rotor_time_constant, since about hover each rotor speeds up half of the time.
"""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from scipy.linalg import expm, solve_discrete_lyapunov

from ortilo_drake.model.hover import discretize, hover_A, hover_B, hover_B_d
from ortilo_drake.model.signals import N_I, N_U, N_X, N_XBAR
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.estimator.extra_states import extra_states
from ortilo_drake.onboard.estimator.filter_model import filter_of, initial_covariance
from ortilo_drake.onboard.servo.lq_gain import servo_gain
from ortilo_drake.scenario import DisturbanceW, IntermittentFilter, LqServo, Scenario, ServoWeights
from ortilo_drake.studies.command_link.command_loop import over_arrivals, schedule
from ortilo_drake.studies.linearization.operating_point import believed_V
from ortilo_drake.studies.loop.hover_loop import filter_V, hover_loop, open_loop, why_no_loop
from ortilo_drake.theory.margins.loop_margins import spectral_radius

W_MARGIN = 1.5  # the lag's torque is no white noise
MORE_LAG = 1.25  # the loop must be stable with this multiple of the lag
_ON_CIRCLE = 1e-6
_SETTLED = 20.0  # flight time after which the filter's gains are steady [s]
_NO_LAG = 1e-4  # [s]
_STEPS = (3.0, 10.0, 30.0, 100.0, 1e3, 1e4, 1e5)  # factors on servo weights that are tried against a lag

_AS_TIGHT = IntermittentFilter(force="measured", rates="measured", integrator="estimate")  # with gyroscope, too

Gains = list[tuple[np.ndarray, np.ndarray]]  # predictor gain K (N x p) and arrivals delta (s), tick by tick


def lagging(scenario: Scenario) -> list[str]:
    """Return a line if the rotors' lag makes the loop unstable, or if a quarter more lag would.

    The linear filter that uses the gyroscope stands for the tight filter, which has no linear form.
    """
    is_tight = scenario.estimator.kind == "tight"
    if is_tight:
        scenario = scenario.model_copy(update={"estimator": _AS_TIGHT})
    tau, gains = _lag(scenario), settled_gains(scenario)
    if _bears(scenario, gains, MORE_LAG * tau) or not _bears(scenario, gains, _NO_LAG):
        return []  # also unstable without lag, which is then not the cause
    whose = "servo and rotors" if gains is None else "servo, filter and rotors"
    radius, mend = loop_radius(scenario, gains, tau), _mend(scenario, gains, not is_tight)
    if radius < 1.0 + _ON_CIRCLE:
        said = f"is stable, but with {MORE_LAG * tau:.2g} s it would not be"
    else:
        said = f"is unstable, spectral radius {radius:.3f}"
    better = "no servo's weights that were tried bear this" if mend is None else f"these bear a quarter more: {mend}"
    return [
        f"vehicle.rotor_time_constant: with a lag of {tau:.3g} s, the mean of up and down, the loop of {whose} {said}; "
        f"{better}"
    ]


def filter_for_lag(scenario: Scenario) -> str | None:
    """Return a line with an estimator.W.torque_density that covers the rotors' lag, if there is one to cover.

    It is W_MARGIN times the root sum square of the disturbance's and the lag's torque; docs/how_to/own_vehicle.md has
    measurements. If the loop is not stable with it, the line names servo weights that make it stable.
    """
    named = _named_W(scenario)
    W = getattr(scenario.estimator, "W", None)
    if named is None or not isinstance(W, DisturbanceW) or named == digits(W.torque_density):
        return None
    if _bears(*_with_W(scenario, named), MORE_LAG * _lag(scenario)):
        return f"for rotors that lag so, estimator.W.torque_density={named} fits; here it is {digits(W.torque_density)}"
    mend = _mend(scenario, settled_gains(scenario))
    return None if mend is None else f"for rotors that lag so these fit together: {mend}"


def lag_torque_sd(scenario: Scenario) -> float:
    """Return the larger sd, about x or y, of a tick's mean torque that lagging rotors are short of the command [N m].

    The loop is the servo's linear one under the world's disturbance, with the state known. After a command u, u - y
    decays with e^(-t / tau), where y is the wrench, so the mean of y over a tick is short of u by (u - y) (1 - e^(-h /
    tau)) tau / h. The sd is infinite if the loop is unstable.
    """
    tau, h = _lag(scenario), scenario.h
    Phi, K = _servo_loop(scenario, tau)
    if spectral_radius(Phi) >= 1.0:
        return float("inf")
    _, Gamma_d = discretize(hover_A(scenario.yaw), hover_B_d(scenario.vehicle), h)
    Gamma_d = np.vstack([Gamma_d, np.zeros((N_U + N_I, Gamma_d.shape[1]))])
    X = solve_discrete_lyapunov(
        Phi, Gamma_d @ np.diag(np.repeat(scenario.world.disturbance.sds(h), 3) ** 2) @ Gamma_d.T
    )
    short = K + np.eye(len(Phi))[N_X : N_X + N_U]  # times [x; y; i] it is y - u
    variances = np.diag(short @ X @ short.T)[1:3]
    return float(np.sqrt(variances.max()) * _share(tau, h))


def settled_gains(scenario: Scenario) -> Gains | None:
    """Return the filter's gains after _SETTLED, for each tick of a period of the sensors, if every due message arrives.

    None for an estimator that is no linear filter, or whose noise in the middle of the room is unknown.
    """
    try:
        if why_no_loop(scenario):
            return None
        loop, V = hover_loop(scenario), filter_V(scenario, believed_V(scenario))
    except InputError:
        return None
    settings, N = filter_of(scenario), len(loop.Phi)
    extras = extra_states(settings, scenario.vehicle, scenario.h, scenario.flown_rows, scenario.yaw)
    P = initial_covariance(settings, extras, None, scenario.yaw)[:N, :N]
    deltas = schedule(scenario)
    there, Ks = loop.measurement.by_row(deltas), np.empty((0, N, 0))
    for _ in range(math.ceil(_SETTLED / (len(deltas) * scenario.h))):
        Ks, _, P = over_arrivals(loop.Phi, loop.C, loop.W, V, there, P)
    return list(zip(Ks, deltas, strict=True))


def loop_radius(scenario: Scenario, gains: Gains | None, tau: float) -> float:
    """Return the loop's spectral radius per tick with rotors that lag by tau [s].

    If gains is None, the loop is of servo and rotors alone, with the state known. Else its state is [x; xhat; i; y],
    where the wrench y lags the control. hover_loop.open_loop gives a tick's matrices; their product is the period's.
    """
    if gains is None:
        return spectral_radius(_servo_loop(scenario, tau)[0])
    loop, held, left = hover_loop(scenario), _held(scenario, tau), _share(tau, scenario.h)
    y = slice(N_X, N_X + N_U)
    product = None
    for K, delta in gains:
        A, B, C = open_loop(loop, K, delta)
        by_y, by_u = left * B, (1.0 - left) * B  # the force just flown, a state besides x, takes the tick's mean
        by_y[:N_X], by_u[:N_X] = held[:N_X, y], held[:N_X, y.stop :]
        tick = np.block([[A - by_u @ C, by_y], [-held[y, y.stop :] @ C, held[y, y]]])
        product = tick if product is None else tick @ product
    assert product is not None
    return float(spectral_radius(product) ** (1.0 / len(gains)))


def digits(value: float) -> str:
    """Return a number with two digits as YAML reads it: with a decimal point if it has an exponent."""
    text = f"{value:.2g}"
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


def _lag(scenario: Scenario) -> float:
    return float(np.mean(scenario.vehicle.rotor_time_constant))


def _share(tau: float, h: float) -> float:
    """Return the fraction of u - y at a tick's start by which the tick's mean wrench is short of u."""
    return float(tau / h * -np.expm1(-h / tau))


def _bears(scenario: Scenario, gains: Gains | None, tau: float) -> bool:
    return loop_radius(scenario, gains, tau) < 1.0 + _ON_CIRCLE


def _mend(scenario: Scenario, gains: Gains | None, names_W: bool = True) -> str | None:
    """Return settings that keep the loop stable with MORE_LAG times the lag: the least change of servo weights, and W.

    W is named if it follows from the lag, as in filter_for_lag, under those weights.
    """
    tau = _lag(scenario)
    for changed in _calmer(scenario.servo.weights):
        weights = scenario.servo.weights.model_copy(update=changed)
        calmer = scenario.model_copy(update={"servo": scenario.servo.model_copy(update={"weights": weights})})
        if not _bears(calmer, gains, tau) or not _bears(calmer, gains, MORE_LAG * tau):
            continue
        settings = [f"servo.weights.{name}={_listed(its)}" for name, its in changed.items()]
        named = _named_W(calmer) if names_W else None
        if named is not None:
            if not _bears(*_with_W(calmer, named), MORE_LAG * tau):
                continue
            settings.append(f"estimator.W.torque_density={named}")
        return " ".join(f"--set {one}" for one in settings)
    return None


def _calmer(weights: ServoWeights) -> Iterator[dict[str, tuple[float, ...]]]:
    """Yield weights under which the servo turns the vehicle less quickly, the smallest change first."""
    for factor in _STEPS:
        rate, control = (tuple(factor * one for one in its) for its in (weights.rate, weights.control))
        yield {"rate": rate}
        yield {"control": control}
        yield {"rate": rate, "control": control}


def _listed(values: Sequence[float]) -> str:
    return f"[{','.join(f'{one:g}' for one in values)}]"


def _named_W(scenario: Scenario) -> str | None:
    """Return the torque_density that covers the disturbance and the rotors' lag; None if the filter uses none."""
    settings, world = scenario.linear_filter, scenario.world
    if settings is not scenario.estimator or not isinstance(settings.W, DisturbanceW):
        return None
    if world.rotors.kind != "first_order" or not isinstance(scenario.servo, LqServo):
        return None
    lag = lag_torque_sd(scenario) * np.sqrt(scenario.h)
    return digits(W_MARGIN * float(np.hypot(world.disturbance.torque_density, lag))) if np.isfinite(lag) else None


def _with_W(scenario: Scenario, torque_density: str) -> tuple[Scenario, Gains | None]:
    """Return the scenario with a filter that assumes this torque density, and the filter's gains."""
    estimator = scenario.estimator
    W = estimator.W.model_copy(update={"torque_density": float(torque_density)})
    other = scenario.model_copy(update={"estimator": estimator.model_copy(update={"W": W})})
    return other, settled_gains(other)


def _held(scenario: Scenario, tau: float) -> np.ndarray:
    """Return the matrix of [x; y; u] over a tick (20 x 20): the wrench y lags the control u by tau [s], u is held."""
    n = N_X + N_U
    A = np.zeros((n + N_U, n + N_U))
    A[:N_X, :N_X], A[:N_X, N_X:n] = hover_A(scenario.yaw), hover_B(scenario.vehicle)
    A[N_X:n, N_X:] = np.hstack([-np.eye(N_U), np.eye(N_U)]) / tau
    return np.asarray(expm(scenario.h * A))


def _servo_loop(scenario: Scenario, tau: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the servo's loop with a first-order lag tau [s] of the wrench y behind the control, with the state known.

    The loop is [x; y; i]_{k+1} = Phi [x; y; i]_k, and the control u_k = -K [x; y; i]_k.
    """
    held, n = _held(scenario, tau), N_X + N_U
    Phi = np.eye(n + N_I)
    Phi[:n, :n], Phi[n:, :N_I] = held[:n, :n], -np.eye(N_I)
    L = servo_gain(scenario.vehicle, scenario.servo.weights, scenario.h, scenario.yaw)
    K = np.hstack([L[:, :N_X], np.zeros((N_U, N_U)), L[:, N_X:N_XBAR]])
    Phi[:n] -= held[:n, n:] @ K
    return Phi, K
