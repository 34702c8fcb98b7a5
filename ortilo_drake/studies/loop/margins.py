"""Loop margins of a scenario at the plant's input, nominal and with sensors lost; defined in loop_margins.py.

If no sensor sees some states, the loop has modes of eigenvalue 1 that no measurement corrects. No output shows these
modes, so they do not change the loop's transfer function, and the other channels still have margins. Without position
these are the attitude loops, and the filter predicts velocity and position from attitude and control alone.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ortilo_drake.model.signals import CONTROL_NAMES, N_X
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.estimator.kalman import predictor_gain
from ortilo_drake.scenario import LqServo, Scenario, ServoWeights
from ortilo_drake.studies.loop.hover_loop import (
    VELOCITIES,
    HoverLoop,
    arrivals_of,
    arrived_rows,
    filter_V,
    hover_loop,
    message_of,
    open_loop,
)
from ortilo_drake.theory.margins.loop_margins import (
    LOWEST,
    SILENT,
    ChannelMargins,
    JointMargins,
    OpenLoop,
    channel_margins,
    closed,
    joint_margins,
    one_channel,
    response,
    spectral_radius,
)
from ortilo_drake.theory.modes.modes import STATE_SHARE, rescale, unobservable_subspace, unseen_modes
from ortilo_drake.theory.riccati.riccati import solve


class InputLoop(NamedTuple):
    """A loop opened at the plant's input, from the control a that reaches the plant to v = L [xhat; i].

    It is closed by a = -v. `lost` are the vehicle's states that no sensor sees: they feed nothing back and are left
    out. `names` are those of the loop's states: the vehicle's, the filter's with a hat, the integrals.
    """

    loop: OpenLoop
    lost: tuple[str, ...]
    names: tuple[str, ...]


def steady_gain(Phi: np.ndarray, C: np.ndarray, W: np.ndarray, V: np.ndarray, units: np.ndarray) -> np.ndarray:
    """Return the steady predictor's gain K (N x p) for the rows of C (p x N) with covariance V (p x p).

    The covariance of unseen modes may grow without bound, yet the gain has a limit. Let T = [T_s, T_l] be orthogonal,
    T_l a basis of the unobservable subspace: x = T [s; l], s seen and l lost, T^T Phi T = [[Phi_s, 0], [Phi_ls, Phi_l]]
    and C T = [C_s, 0]. P_s solves s's own Riccati equation. The covariance between l and s has the limit

        P_ls = Phi_l P_ls F^T + Phi_ls P_s F^T + W_ls,   F = Phi_s - K_s C_s,

    because the radius of Phi_l times that of F is below 1. Then K_l = (Phi_ls P_s + Phi_l P_ls) C_s^T (C_s P_s C_s^T +
    V)^-1. Whether a state is seen is judged in these units of the states (N). InputError if nothing is seen, or the
    seen part's equation is ill-posed.
    """
    hidden = np.linalg.qr(units[:, None] * unobservable_subspace(*rescale(Phi, C, units)))[0]
    seen, lost = len(Phi) - hidden.shape[1], hidden.shape[1]
    if not seen:
        raise InputError("margins: no sensor sees any state")
    is_hidden = np.linalg.norm(hidden, axis=1) > STATE_SHARE
    if is_hidden.sum() == lost:  # whole states: only their order changes, which keeps zeros exact
        T = np.eye(len(Phi))[:, np.argsort(is_hidden, kind="stable")]
    else:
        T = np.roll(np.linalg.svd(hidden)[0], -lost, axis=1)
    Phi, C, W = T.T @ Phi @ T, C @ T, T.T @ W @ T
    s, l = slice(seen), slice(seen, None)  # noqa: E741 - the letter of the equations
    names = tuple(f"combination {k + 1}" for k in range(seen))
    P_s = solve(Phi[s, s].T, C[:, s].T, W[s, s], V, names=names, dual=True)
    F = Phi[s, s] - predictor_gain(Phi[s, s], C[:, s], V, P_s) @ C[:, s]
    driven = Phi[l, s] @ P_s @ F.T + W[l, s]
    P_ls = np.linalg.solve(np.eye(driven.size) - np.kron(Phi[l, l], F), driven.ravel()).reshape(driven.shape)
    P = np.block([[P_s, P_ls.T], [P_ls, np.zeros((lost, lost))]])  # C does not read P_ll
    return np.asarray(T @ predictor_gain(Phi, C, V, P))


def input_loop(
    hover: HoverLoop, V: np.ndarray, sensors: tuple[str, ...], true_states: tuple[int, ...] = ()
) -> InputLoop:
    """Return the loop at the plant's input with the steady predictor of these sensors, each in every tick.

    It is hover_loop.open_loop without the states that no sensor sees, and without those that nothing drives, such as
    the integral where there is no fix. V is the covariance of all measurements that the filter gets (p x p), see
    hover_loop.filter_V. true_states are the indices of the states that the servo gets from the truth, in place of
    hover's own: VELOCITIES for the paper's scenarios, all twelve for full state feedback, whose integral then follows
    the true position. InputError if the unseen modes are not whole states, or the filter's equation is ill-posed.
    """
    hover = hover._replace(true_states=true_states)
    delta = arrivals_of(sensors, hover.measurement)
    rows, V = arrived_rows(sensors, V, hover.measurement)
    world, names = np.array(hover.world), hover.state_names
    lost = _lost_states(hover.Phi[np.ix_(world, world)], hover.C[rows][:, world], names[: len(world)])
    K = np.zeros((len(hover.names), len(hover.C)))
    K[:, rows] = steady_gain(hover.Phi, hover.C[rows], hover.W, V, hover.units)
    lost = tuple(name for name in lost if names.index(name) not in true_states)
    whole = open_loop(hover, K, delta)
    holds_still = (np.eye(len(names)) == whole.A).all(axis=1) & ~whole.B.any(axis=1)  # nothing drives it
    keep = [k for k, name in enumerate(names) if name not in lost and not holds_still[k]]
    if len(true_states) == N_X:  # the servo then uses nothing from the filter
        keep = [*range(N_X), *range(hover.hats.stop, len(names))]
    kept = OpenLoop(whole.A[np.ix_(keep, keep)], whole.B[keep], whole.C[:, keep])
    return InputLoop(kept, lost, tuple(names[k] for k in keep))


def _lost_states(Phi: np.ndarray, C: np.ndarray, names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names of the states that no sensor sees, in their order; InputError if they are not whole states."""
    hidden = {name for mode in unseen_modes(Phi, C, names) for name in mode.states}
    is_lost = np.array([name in hidden for name in names])
    if is_lost.all() or Phi[np.ix_(~is_lost, is_lost)].any() or C[:, is_lost].any():
        raise InputError("margins: the modes that no sensor sees are not apart from the others")
    return tuple(name for name in names if name in hidden)


STILL = 1e-9  # a closed loop's radius this near 1 counts as 1: what drifts keeps drifting


@dataclass(frozen=True)
class LoopMargins:
    """One loop's margins, with the spectral radius of the closed loop, None where the filter has no steady gain.

    `lost` are the states that no sensor sees. channels holds the margins by control, None where nothing is fed back;
    joint holds those of all controls at once; both are None for a loop that is not stable. note says what is lost or
    not stable.
    """

    spectral_radius: float | None
    lost: tuple[str, ...]
    channels: dict[str, ChannelMargins | None] | None
    joint: JointMargins | None
    note: str | None


def _explain(inner: InputLoop, silent: list[str]) -> str | None:
    if not inner.lost:
        return None
    text = (
        f"no sensor sees {', '.join(inner.lost)}: their modes have eigenvalue 1 and are"
        " left out; the margins are those of what is still seen (position lost: the attitude), with the filter"
        " predicting the rest from it"
    )
    return text + (f"; nothing is fed back to {', '.join(silent)}" if silent else "")


def loop_margins(inner: InputLoop, h: float, R: np.ndarray) -> LoopMargins:
    """Return one loop's margins; h is its tick [s], R the diagonal of the controls' weights for the joint ones."""
    loop = inner.loop
    radius = spectral_radius(closed(loop))
    lost = tuple(inner.lost)
    if not radius < 1.0 - STILL:
        note = f"the closed loop is not stable (radius {radius:.6g}): it has no margins"
        return LoopMargins(radius, lost, None, None, note)
    L = response(loop, np.geomspace(LOWEST, math.pi, 40))
    silent = [name for k, name in enumerate(CONTROL_NAMES) if abs(L[:, k, k]).max() < SILENT]
    channels = {
        name: None if name in silent else channel_margins(one_channel(loop, k), h)
        for k, name in enumerate(CONTROL_NAMES)
    }
    return LoopMargins(radius, lost, channels, joint_margins(loop, h, R), _explain(inner, silent))


def loops_by_case(hover: HoverLoop, V: np.ndarray, sensors: tuple[str, ...]) -> dict[str, InputLoop | LoopMargins]:
    """Return the loops of a scenario: nominal, each sensor lost, all position sensors lost, and with true states.

    If a sensor is lost and the filter has no steady gain without it, the entry is LoopMargins that say so.
    """
    known = [s for s in hover.measurement.sensors if message_of(s, hover.measurement) == s]
    present = tuple(s for s in known if s in sensors)
    if not present:
        raise InputError(f"sensors: none: margins need at least one of {', '.join(known)}")
    lost: dict[str, tuple[str, ...]] = {f"without {s}": (s,) for s in present}
    is_position = dict(zip(hover.measurement.sensors, hover.measurement.layout.is_position, strict=True))
    fixes = tuple(s for s in present if is_position[s])
    if len(fixes) > 1:
        lost[f"without {' and '.join(fixes)}"] = fixes
    loops: dict[str, InputLoop | LoopMargins] = {"nominal": input_loop(hover, V, present)}
    for name, these in lost.items():
        left = tuple(s for s in present if s not in these)
        if not left:
            continue
        try:
            loops[name] = input_loop(hover, V, left)
        except InputError:
            loops[name] = LoopMargins(None, (), None, None, "the filter has no steady gain with these sensors")
    loops["true velocities"] = input_loop(hover, V, present, VELOCITIES)
    loops["full state"] = input_loop(hover, V, present, tuple(range(N_X)))
    return loops


def margins_report(scenario: Scenario, V: np.ndarray) -> dict[str, LoopMargins]:
    """Return loop_margins of every case of a scenario, by name; V is the covariance of all measurements (p x p).

    The cases are 'nominal', 'without uwb', ..., 'true velocities' (the paper's: velocities and rates from the truth)
    and 'full state' (the LQ loop by itself). For a servo of one's own, the joint margins are scaled by the default
    weights of an LQ servo.
    """
    hover = hover_loop(scenario)
    weights = scenario.servo.weights if isinstance(scenario.servo, LqServo) else ServoWeights()
    R = np.array(weights.control)
    loops = loops_by_case(hover, filter_V(scenario, V), scenario.sensors)
    return {
        name: inner if isinstance(inner, LoopMargins) else loop_margins(inner, hover.h, R)
        for name, inner in loops.items()
    }
