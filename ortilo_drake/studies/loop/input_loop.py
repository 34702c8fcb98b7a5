"""The flying loop opened at the plant's input, nominal and with sensors lost."""

from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_sylvester

from ortilo_drake.model.signals import INTEGRAL_NAMES, N_X, STATE_NAMES
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.loop.arrived_rows import arrived_rows
from ortilo_drake.studies.loop.hover_loop import N_LOOP, HoverLoop, arrivals_of, open_loop
from ortilo_drake.theory.margins.loop_response import OpenLoop
from ortilo_drake.theory.modes.modes import unseen_modes
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


def steady_gain(Phi: np.ndarray, C: np.ndarray, W: np.ndarray, V: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return the steady predictor's gain K (12 x p) of the rows of C, and the names of the states that are not seen.

    The covariance of unseen modes grows without bound, yet the gain has a limit. Split the state as x = [s; l], s seen
    and l lost, with Phi = [[Phi_s, 0], [Phi_ls, Phi_l]] and C = [C_s, 0]. P_s solves s's own Riccati equation. The
    covariance between l and s has the limit

        P_ls = Phi_l P_ls F^T + Phi_ls P_s F^T + W_ls,   F = Phi_s - K_s C_s,

    because the radius of Phi_l times that of F is below 1. Then
    K_l = (Phi_ls P_s + Phi_l P_ls) C_s^T (C_s P_s C_s^T + V)^-1.

    Args:
        Phi: (12 x 12).
        C: (p x 12), the rows that arrive.
        W: (12 x 12).
        V: (p x p).

    Raises:
        InputError: if the unseen modes are not whole states, or the seen part's equation is ill-posed.
    """
    lost_names = {name for mode in unseen_modes(Phi, C, STATE_NAMES) for name in mode.states}
    l = np.array([name in lost_names for name in STATE_NAMES])  # noqa: E741 - the letter of the equations
    s = ~l
    if not s.any() or Phi[np.ix_(s, l)].any() or C[:, l].any():
        raise InputError("margins: the modes that no sensor sees are not apart from the others")
    names = tuple(np.array(STATE_NAMES)[s])
    Phi_s, Phi_ls, Phi_l, C_s = Phi[np.ix_(s, s)], Phi[np.ix_(l, s)], Phi[np.ix_(l, l)], C[:, s]
    P_s = solve(Phi_s.T, C_s.T, W[np.ix_(s, s)], V, names=names, dual=True)
    S = C_s @ P_s @ C_s.T + V
    K = np.zeros((N_X, len(C)))
    K[s] = np.linalg.solve(S, C_s @ P_s @ Phi_s.T).T
    if l.any():
        F = Phi_s - K[s] @ C_s
        # Phi_l P F^T - P = -(Phi_ls P_s F^T + W_ls), a Sylvester equation in Phi_l P - P F^-T after F^-T on the right.
        F_inverse = np.linalg.inv(F.T)
        P_ls = solve_sylvester(Phi_l, -F_inverse, -(Phi_ls @ P_s @ F.T + W[np.ix_(l, s)]) @ F_inverse)
        K[l] = np.linalg.solve(S, C_s @ (Phi_ls @ P_s + Phi_l @ P_ls).T).T
    return K, tuple(name for name in STATE_NAMES if name in lost_names)


def input_loop(
    hover: HoverLoop, V: np.ndarray, sensors: tuple[str, ...], true_states: tuple[int, ...] = ()
) -> InputLoop:
    """Return the loop at the plant's input with the steady predictor of those sensors, each in every tick.

    It is hover_loop.open_loop without the states that no sensor sees.

    Args:
        hover: the scenario's matrices; its own true_states are not used.
        V: covariance of all measurements (p x p).
        sensors: which sensors arrive.
        true_states: numbers of the states that the servo has from the truth; VELOCITIES for the paper's scenarios,
            all twelve for full state feedback, whose integral then follows the true position.
    """
    hover = hover._replace(true_states=true_states)
    delta = arrivals_of(sensors, hover.measurement)
    rows, V = arrived_rows(sensors, V, hover.measurement)
    K = np.zeros((N_X, len(hover.C)))
    K[:, rows], unseen = steady_gain(hover.Phi, hover.C[rows], hover.W, V)
    lost = tuple(name for name in unseen if STATE_NAMES.index(name) not in true_states)
    whole = open_loop(hover, K, delta)
    names = (*STATE_NAMES, *(f"{name}^" for name in STATE_NAMES), *INTEGRAL_NAMES)
    keep = [k for k, name in enumerate(names) if name not in lost]
    if len(true_states) == N_X:  # the servo then uses nothing of the filter
        keep = [*range(N_X), *range(2 * N_X, N_LOOP)]
    elif (
        hover.integrator != "estimate" and not (delta * hover.measurement.layout.is_position).any()
    ):  # no fix: the integral holds still
        keep = [k for k in keep if k < 2 * N_X]
    kept = OpenLoop(whole.A[np.ix_(keep, keep)], whole.B[keep], whole.C[:, keep])
    return InputLoop(kept, lost, tuple(names[k] for k in keep))
