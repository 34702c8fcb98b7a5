"""The flying loop opened at the plant's input, nominal and with sensors lost."""

from typing import NamedTuple

import numpy as np

from ortilo_drake.model.signals import N_X
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.loop.arrived_rows import arrived_rows
from ortilo_drake.studies.loop.hover_loop import HoverLoop, arrivals_of, open_loop
from ortilo_drake.theory.margins.loop_response import OpenLoop
from ortilo_drake.theory.modes.modes import STATE_SHARE, unseen_modes
from ortilo_drake.theory.modes.staircase import rescale, unobservable_subspace
from ortilo_drake.theory.riccati.riccati import solve


class InputLoop(NamedTuple):
    """A loop opened at the plant's input.

    Attributes:
        loop: from the control that reaches the plant, a, to v = L [xhat; i]; closed by a = -v.
        lost: names of the vehicle's states that no sensor sees; they feed nothing back and are left out of the loop.
        names: names of the loop's states: the vehicle's, the filter's with a hat, the integrals.
    """

    loop: OpenLoop
    lost: tuple[str, ...]
    names: tuple[str, ...]


def steady_gain(Phi: np.ndarray, C: np.ndarray, W: np.ndarray, V: np.ndarray, units: np.ndarray) -> np.ndarray:
    """Return the steady predictor's gain K (N x p) of the rows of C.

    The covariance of unseen modes may grow without bound, yet the gain has a limit. Let T = [T_s, T_l] be orthogonal,
    T_l a basis of the unobservable subspace: x = T [s; l], s seen and l lost, T^T Phi T = [[Phi_s, 0], [Phi_ls, Phi_l]]
    and C T = [C_s, 0]. P_s solves s's own Riccati equation. The covariance between l and s has the limit

        P_ls = Phi_l P_ls F^T + Phi_ls P_s F^T + W_ls,   F = Phi_s - K_s C_s,

    because the radius of Phi_l times that of F is below 1. Then
    K_l = (Phi_ls P_s + Phi_l P_ls) C_s^T (C_s P_s C_s^T + V)^-1.

    Args:
        Phi: (N x N).
        C: (p x N), the rows that arrive.
        W: (N x N).
        V: (p x p).
        units: of the states, in which to tell what is seen (N).

    Raises:
        InputError: if nothing is seen, or the seen part's equation is ill-posed.
    """
    hidden = np.linalg.qr(units[:, None] * unobservable_subspace(*rescale(Phi, C, units)))[0]
    seen, lost = len(Phi) - hidden.shape[1], hidden.shape[1]
    if not seen:
        raise InputError("margins: no sensor sees any state")
    is_hidden = np.linalg.norm(hidden, axis=1) > STATE_SHARE
    if is_hidden.sum() == lost:  # whole states: then by their order alone, which keeps zeros what they are
        T = np.eye(len(Phi))[:, np.argsort(is_hidden, kind="stable")]
    else:
        T = np.roll(np.linalg.svd(hidden)[0], -lost, axis=1)
    Phi, C, W = T.T @ Phi @ T, C @ T, T.T @ W @ T
    s, l = slice(seen), slice(seen, None)  # noqa: E741 - the letter of the equations
    names = tuple(f"combination {k + 1}" for k in range(seen))
    P_s = solve(Phi[s, s].T, C[:, s].T, W[s, s], V, names=names, dual=True)
    S = C[:, s] @ P_s @ C[:, s].T + V
    K_s = np.linalg.solve(S, C[:, s] @ P_s @ Phi[s, s].T).T
    F = Phi[s, s] - K_s @ C[:, s]
    driven = Phi[l, s] @ P_s @ F.T + W[l, s]
    P_ls = np.linalg.solve(np.eye(driven.size) - np.kron(Phi[l, l], F), driven.ravel()).reshape(driven.shape)
    K_l = np.linalg.solve(S, C[:, s] @ (Phi[l, s] @ P_s + Phi[l, l] @ P_ls).T).T
    return np.asarray(T @ np.vstack([K_s, K_l]))


def input_loop(
    hover: HoverLoop, V: np.ndarray, sensors: tuple[str, ...], true_states: tuple[int, ...] = ()
) -> InputLoop:
    """Return the loop at the plant's input with the steady predictor of those sensors, each in every tick.

    It is hover_loop.open_loop without the states that no sensor sees, and without those that nothing drives, such as
    the integral where there is no fix.

    Args:
        hover: the scenario's matrices; its own true_states are not used.
        V: covariance of all measurements that the filter gets (p x p), see hover_loop.filter_V.
        sensors: which sensors arrive.
        true_states: numbers of the states that the servo has from the truth; VELOCITIES for the paper's scenarios,
            all twelve for full state feedback, whose integral then follows the true position.

    Raises:
        InputError: if the unseen modes are not whole states, or the filter's equation is ill-posed.
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
    if len(true_states) == N_X:  # the servo then uses nothing of the filter
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
